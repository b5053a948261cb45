// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/tube_ends.h"

#include <gtest/gtest.h>

#include "pipeline/fit/bends_with_bows.h"
#include "pipeline/fit/end_forms.h"
#include "tests/support/real_tube.h"
#include "tests/support/shapes.h"
#include "tests/unit/fit/three_bends.h"

namespace bendloop::pipeline {
namespace {

using tests::kPi;
using tests::Points;
using tests::Random;
using tests::Uniform;

constexpr double kRadius = 4;
constexpr double kNoise = 0.03;

hal::Tube Truth(int bends, Random& random) {
  return tests::RandomTube({.pipe_radius_mm = kRadius, .bends = bends, .max_straight = 12}, random);
}

// A tube that says the ends wrong by up to a radius, as the structure leaves it.
hal::Tube EndsUnknown(hal::Tube tube, Random& random) {
  const auto segments = hal::SpineSegments(tube.program, tube.X_WT);
  const double before = Uniform(random, -kRadius, kRadius);
  tube.X_WT.position_mm -= before * segments.front().tangent;
  tube.program.rows.front().length_mm += before;
  tube.program.rows.back().length_mm += Uniform(random, -kRadius, kRadius);
  return tube;
}

Points Stripes(const hal::Tube& tube, double spacing, Random& random) {
  std::normal_distribution<double> noise(0, kNoise);
  const double total = hal::SpineLength(tube.program);
  Points points;
  const auto segments = hal::SpineSegments(tube.program, tube.X_WT);
  for (double s = Uniform(random, 0, spacing); s < total; s += spacing) {
    const auto* segment = &segments.back();
    for (const auto& k : segments) {
      if (s < k.from_start_mm + k.length_mm) {
        segment = &k;
        break;
      }
    }
    const double along = s - segment->from_start_mm;
    const Eigen::Vector3d inward = segment->normal.cross(segment->TangentAt(along));
    for (int i = 0; i < 40; ++i) {
      const double phi = Uniform(random, 0, 2 * kPi);
      points.push_back(segment->PointAt(along) +
                       (kRadius + noise(random)) *
                           (std::cos(phi) * inward + std::sin(phi) * segment->normal));
    }
  }
  return points;
}

struct Errors {
  double first, last;
};

Errors EndErrors(const hal::Tube& truth, const TubeEnds& ends) {
  return {ends.tube.program.rows.front().length_mm - truth.program.rows.front().length_mm,
          ends.tube.program.rows.back().length_mm - truth.program.rows.back().length_mm};
}

// Where the tube ends between two laser lines is anyone's guess: half a spacing at most, and over
// many scans 0.29 of it (a uniform deviate) with little more for the estimate of the spacing.
TEST(TubeEnds, StripesAreWithinHalfASpacing) {
  Random random(1);
  for (const double spacing : {0.4, 1.0, 1.6}) {
    double sum2 = 0, bias = 0, reported2 = 0;
    int count = 0;
    for (int run = 0; run < 40; ++run) {
      const hal::Tube tube = Truth(1 + run % 3, random);
      const auto blocks = tests::Blocks(Stripes(tube, spacing, random), kRadius);
      const TubeEnds ends = FindTubeEnds(EndsUnknown(tube, random), kNoise, blocks);
      const Errors errors = EndErrors(tube, ends);
      for (const double e : {errors.first, errors.last}) {
        EXPECT_LT(std::abs(e), 0.75 * spacing) << "spacing " << spacing << " run " << run;
        sum2 += e * e;
        bias += e;
        ++count;
      }
      reported2 += 0.5 * (std::pow(ends.first_sigma_mm, 2) + std::pow(ends.last_sigma_mm, 2));
    }
    EXPECT_LT(std::sqrt(sum2 / count), 0.35 * spacing);
    EXPECT_LT(std::abs(bias / count), 0.15 * spacing);
    EXPECT_LT(sum2 / count, 2 * reported2 / 40) << "the ends are less sure than they say";
  }
}

// Nodes end before a nut, and the plain tube behind it.
TEST(TubeEnds, AreFoundFarBeyondTheNodes) {
  Random random(3);
  for (const double beyond : {1.0, 2.4, 3.5, 6.0}) {
    SCOPED_TRACE(beyond);
    const hal::Tube tube = Truth(2, random);
    const auto cloud = tests::SyntheticCloud(tube, {.points = 20'000, .noise_mm = kNoise}, random);
    hal::Tube nodes = tube;
    nodes.program.rows.front().length_mm -= beyond * kRadius;
    nodes.program.rows.back().length_mm -= beyond * kRadius;
    nodes.X_WT.position_mm +=
        beyond * kRadius * hal::SpineSegments(tube.program, tube.X_WT).front().tangent;
    const TubeEnds ends = FindTubeEnds(nodes, kNoise, tests::Blocks(cloud, kRadius));
    const Errors errors = EndErrors(tube, ends);
    EXPECT_LT(std::abs(errors.first), 6 * ends.first_sigma_mm);
    EXPECT_LT(std::abs(errors.last), 6 * ends.last_sigma_mm);
  }
}

// Of many points a part is looked at: that made ends look thin, and a few fliers beyond like a tube
// that goes on.
TEST(TubeEnds, OfManyPointsAreNotThin) {
  Random random(5);
  constexpr std::size_t kPoints = 300'000;
  constexpr double kLong = 40;
  const auto on_tube = [&random](double x) {
    const double turn = Uniform(random, 0, 2 * kPi);
    return Eigen::Vector3d(x, kRadius * std::cos(turn), kRadius * std::sin(turn));
  };
  Points near, fliers;
  for (std::size_t i = 0; i < kPoints; ++i) near.push_back(on_tube(Uniform(random, -kLong, 0)));
  for (int i = 0; i < 8; ++i) fliers.push_back(on_tube(Uniform(random, 2, 4)));
  const PlainEnd end{Eigen::Vector3d::Zero(), Eigen::Vector3d::UnitX()};
  const FoundEnd found =
      FindEndForm(end, kRadius, kNoise, tests::Blocks(near, kRadius),
                  tests::Blocks(fliers, kRadius), static_cast<double>(kPoints) / kLong);
  EXPECT_EQ(found.form.continues_mm, 0);
}

TEST(TubeEnds, ScatteredPointsAreWithinTheirSpacing) {
  Random random(2);
  for (const std::size_t points : {1500U, 6000U, 30000U}) {
    for (int run = 0; run < 8; ++run) {
      const hal::Tube tube = Truth(1 + run % 3, random);
      const double area = 2 * kPi * kRadius * hal::SpineLength(tube.program);
      const double spacing = std::sqrt(area / static_cast<double>(points));
      const auto cloud =
          tests::SyntheticCloud(tube, {.points = points, .noise_mm = kNoise}, random);
      const TubeEnds ends =
          FindTubeEnds(EndsUnknown(tube, random), kNoise, tests::Blocks(cloud, kRadius));
      const Errors errors = EndErrors(tube, ends);
      EXPECT_LT(std::abs(errors.first), 0.3 * spacing) << points << " run " << run;
      EXPECT_LT(std::abs(errors.last), 0.3 * spacing) << points << " run " << run;
    }
  }
}

// Behind the end of a tube the first of scattered points comes as an exponential deviate.
TEST(TubeEnds, OfScatteredPointsAreAsSureAsTheySay) {
  Random random(12);
  double squares = 0;
  int count = 0;
  for (const std::size_t points : {800U, 1500U, 3000U, 6000U}) {
    for (int run = 0; run < 100; ++run) {
      const hal::Tube tube = Truth(1 + run % 3, random);
      const auto cloud = tests::SyntheticCloud(tube, {.points = points, .noise_mm = 0.001}, random);
      const TubeEnds ends =
          FindTubeEnds(EndsUnknown(tube, random), kNoise, tests::Blocks(cloud, kRadius));
      const Errors errors = EndErrors(tube, ends);
      squares += std::pow(errors.first / ends.first_sigma_mm, 2) +
                 std::pow(errors.last / ends.last_sigma_mm, 2);
      count += 2;
    }
  }
  const double ratio = std::sqrt(squares / count);
  EXPECT_GT(ratio, 0.85);
  EXPECT_LT(ratio, 1.1);
}

// As where a scan fades out: a third as dense at the end as three pipe radii before it.
TEST(TubeEnds, WherePointsGrowThinnerAreAsSureAsTheLastOfThem) {
  Random random(13);
  double squares = 0;
  int beyond = 0;
  constexpr int kRuns = 400;
  for (int run = 0; run < kRuns; ++run) {
    const hal::Tube tube = Truth(1 + run % 3, random);
    auto cloud = tests::SyntheticCloud(tube, {.points = 8000, .noise_mm = 0.001}, random);
    const hal::SpineSegment first = hal::SpineSegments(tube.program, tube.X_WT).front();
    std::erase_if(cloud, [&](const Eigen::Vector3d& point) {
      const double along = (point - first.start_mm).dot(first.tangent) / kRadius;
      const bool is_beside = along < 4 && (point - first.start_mm).norm() < 5 * kRadius;
      return is_beside && std::uniform_real_distribution<double>(0, 1)(random) >
                              0.25 + 0.19 * std::max(0.0, along);
    });
    const TubeEnds ends =
        FindTubeEnds(EndsUnknown(tube, random), kNoise, tests::Blocks(cloud, kRadius));
    const double ratio = EndErrors(tube, ends).first / ends.first_sigma_mm;
    squares += ratio * ratio;
    beyond += std::abs(ratio) > 6 ? 1 : 0;
  }
  EXPECT_LT(std::sqrt(squares / kRuns), 1.35);
  EXPECT_LE(beyond, kRuns / 100);
}

TEST(TubeEnds, TheStartMovesWithTheFirstLength) {
  Random random(3);
  const hal::Tube tube = Truth(2, random);
  const auto cloud = tests::SyntheticCloud(tube, {.points = 20000, .noise_mm = kNoise}, random);
  const TubeEnds ends =
      FindTubeEnds(EndsUnknown(tube, random), kNoise, tests::Blocks(cloud, kRadius));
  EXPECT_NEAR((ends.tube.X_WT.position_mm - tube.X_WT.position_mm).norm(), 0, 0.2);
  const auto a = hal::SpineSegments(tube.program, tube.X_WT);
  const auto b = hal::SpineSegments(ends.tube.program, ends.tube.X_WT);
  EXPECT_NEAR((a[1].start_mm - b[1].start_mm).norm(), 0, 1e-9) << "the bend stays where it is";
}

TEST(TubeEnds, StraightTubesHaveTwoEndsInOneRow) {
  Random random(4);
  hal::Tube tube;
  tube.pipe_radius_mm = kRadius;
  tube.program.rows = {{120, 0, 0, std::nullopt}};
  const auto cloud = tests::SyntheticCloud(tube, {.points = 12000, .noise_mm = kNoise}, random);
  hal::Tube guess = tube;
  guess.X_WT.position_mm.x() = -3;
  guess.program.rows[0].length_mm = 120;
  const TubeEnds ends = FindTubeEnds(guess, kNoise, tests::Blocks(cloud, kRadius));
  EXPECT_NEAR(ends.tube.program.rows[0].length_mm, 120, 0.2);
  EXPECT_NEAR(ends.tube.X_WT.position_mm.x(), 0, 0.1);
}

TEST(TubeEnds, FliersBeyondTheEndsAreIgnored) {
  Random random(5);
  for (int run = 0; run < 10; ++run) {
    const hal::Tube tube = Truth(2, random);
    Points cloud = tests::SyntheticCloud(tube, {.points = 12000, .noise_mm = kNoise}, random);
    const auto segments = hal::SpineSegments(tube.program, tube.X_WT);
    // Exactly on the cylinder that goes on, where nothing else can tell them apart.
    for (int i = 0; i < 3; ++i) {
      const double phi = Uniform(random, 0, 2 * kPi);
      const Eigen::Vector3d out = std::cos(phi) * segments[0].normal +
                                  std::sin(phi) * segments[0].normal.cross(segments[0].tangent);
      cloud.push_back(segments[0].start_mm -
                      Uniform(random, 0.3, 5) * kRadius * segments[0].tangent + kRadius * out);
      const auto& last = segments.back();
      cloud.push_back(last.PointAt(last.length_mm + Uniform(random, 0.3, 5) * kRadius) +
                      kRadius * last.normal);
    }
    const TubeEnds ends =
        FindTubeEnds(EndsUnknown(tube, random), kNoise, tests::Blocks(cloud, kRadius));
    const Errors errors = EndErrors(tube, ends);
    EXPECT_NEAR(errors.first, 0, 0.3) << run;
    EXPECT_NEAR(errors.last, 0, 0.3) << run;
  }
}

// Of few points the outermost stands so far before the next one by chance, now and then.
TEST(TubeEnds, ALonePointThatMayBeTheTubesMakesTheEndUnsure) {
  Random random(6);
  const hal::Tube tube = Truth(2, random);
  Points cloud = tests::SyntheticCloud(tube, {.points = 2000, .noise_mm = kNoise}, random);
  const TubeEnds sure =
      FindTubeEnds(EndsUnknown(tube, random), kNoise, tests::Blocks(cloud, kRadius));
  const hal::SpineSegment last = hal::SpineSegments(tube.program, tube.X_WT).back();
  const double mean_gap_mm = hal::SpineLength(tube.program) / 2000;
  const double before_mm = 10 * mean_gap_mm;
  cloud.push_back(last.PointAt(last.length_mm + before_mm) + kRadius * last.normal);
  const TubeEnds unsure =
      FindTubeEnds(EndsUnknown(tube, random), kNoise, tests::Blocks(cloud, kRadius));
  EXPECT_GT(unsure.last_sigma_mm, 0.4 * before_mm);
  EXPECT_LT(sure.last_sigma_mm, 0.2 * before_mm);
  EXPECT_NEAR(unsure.first_sigma_mm, sure.first_sigma_mm, 0.1 * sure.first_sigma_mm);
}

TEST(TubeEnds, WithoutPointsNothingMoves) {
  Random random(6);
  const hal::Tube tube = Truth(2, random);
  EXPECT_EQ(FindTubeEnds(tube, kNoise, {}).tube.program, tube.program);
}

// What goes on beyond the end along a part of the turn only is a table and not the tube, though few
// points on another part make it hard to say where they end.
TEST(TubeEnds, ATableGoesOnBeyondTheEnd) {
  Random random(9);
  for (int run = 0; run < 10; ++run) {
    const hal::Tube tube = Truth(2, random);
    Points cloud = tests::SyntheticCloud(tube, {.points = 12000, .noise_mm = kNoise}, random);
    const auto last = hal::SpineSegments(tube.program, tube.X_WT).back();
    const Eigen::Vector3d across = last.normal.cross(last.tangent);
    std::erase_if(cloud, [&](const Eigen::Vector3d& p) {
      const Eigen::Vector3d from = p - last.start_mm;
      return from.dot(last.tangent) > 0 && from.dot(last.normal) > 0.7 * kRadius &&
             Uniform(random, 0, 1) < 0.95;
    });
    for (int i = 0; i < 400; ++i) {
      cloud.push_back(last.PointAt(last.length_mm + Uniform(random, -1.5, 1.5) * kRadius) -
                      1.01 * kRadius * last.normal + Uniform(random, -2, 2) * kRadius * across);
    }
    const TubeEnds ends =
        FindTubeEnds(EndsUnknown(tube, random), kNoise, tests::Blocks(cloud, kRadius));
    EXPECT_NEAR(EndErrors(tube, ends).last, 0, 0.4) << run;
  }
}

// Presses a dent into the points of the last straight: a Gaussian of these pipe radii.
void Press(const hal::Tube& tube, double before_end_r, double depth_r, double width_r,
           double around_rad, Points& cloud) {
  const auto last = hal::SpineSegments(tube.program, tube.X_WT).back();
  const Eigen::Vector3d across = last.normal.cross(last.tangent);
  for (Eigen::Vector3d& p : cloud) {
    const Eigen::Vector3d from = p - last.start_mm;
    const double along_mm = from.dot(last.tangent);
    const Eigen::Vector3d outward = (from - along_mm * last.tangent).normalized();
    if (along_mm < 0 || (from - along_mm * last.tangent).norm() > 1.5 * kRadius) continue;
    const double around = std::atan2(outward.dot(across), outward.dot(last.normal)) - around_rad;
    const double along_r = (along_mm - last.length_mm) / kRadius + before_end_r;
    const double off2 = along_r * along_r + std::pow(std::remainder(around, 2 * kPi), 2);
    p -= depth_r * kRadius * std::exp(-0.5 * off2 / (width_r * width_r)) * outward;
  }
}

// Where noise is far less than a dent is deep most of the turn lies off the tube, all along it: the
// end was told where the dent begins.
TEST(TubeEnds, AreBeyondDents) {
  Random random(12);
  constexpr double kFine = 0.001 * kRadius;
  for (int run = 0; run < 40; ++run) {
    SCOPED_TRACE(run);
    const hal::Tube tube = Truth(2, random);
    Points cloud = tests::SyntheticCloud(tube, {.points = 20'000, .noise_mm = kFine}, random);
    const int dents = 1 + run % 2;
    for (int i = 0; i < dents; ++i) {
      Press(tube, Uniform(random, 0.3, 2.2), Uniform(random, 0.03, 0.12), Uniform(random, 0.5, 0.9),
            Uniform(random, -kPi, kPi), cloud);
    }
    const TubeEnds ends =
        FindTubeEnds(EndsUnknown(tube, random), kFine, tests::Blocks(cloud, kRadius));
    EXPECT_LT(std::abs(EndErrors(tube, ends).last), 4 * ends.last_sigma_mm);
  }
}

// The first straight's line, gone on with, passes through the last end.
TEST(TubeEnds, TheOtherEndsLineMayPassThroughThisEnd) {
  Random random(10);
  hal::Tube tube;
  tube.pipe_radius_mm = kRadius;
  tube.program.rows = {
      {30, 0, 90, 10.0}, {20, 0, 90, 10.0}, {60, 0, 90, 10.0}, {30, 0, 0, std::nullopt}};
  const auto segments = hal::SpineSegments(tube.program, tube.X_WT);
  const Eigen::Vector3d from =
      segments.back().PointAt(segments.back().length_mm) - segments.front().start_mm;
  ASSERT_LT(from.cross(segments.front().tangent).norm(), 1e-6);
  ASSERT_LT(from.dot(segments.front().tangent), -3 * kRadius);
  const Points cloud = tests::SyntheticCloud(tube, {.points = 12000, .noise_mm = kNoise}, random);
  const TubeEnds ends = FindTubeEnds(tube, kNoise, tests::Blocks(cloud, kRadius));
  EXPECT_NEAR(EndErrors(tube, ends).first, 0, 0.2);
  EXPECT_NEAR(EndErrors(tube, ends).last, 0, 0.2);
}

// Of dense points two fliers are no crowd.
TEST(TubeEnds, PairsOfFliersAreNoBorder) {
  Random random(11);
  for (int run = 0; run < 5; ++run) {
    const hal::Tube tube = Truth(1, random);
    Points cloud = tests::SyntheticCloud(tube, {.points = 40000, .noise_mm = kNoise}, random);
    const auto last = hal::SpineSegments(tube.program, tube.X_WT).back();
    const Eigen::Vector3d across = last.normal.cross(last.tangent);
    for (int i = 0; i < 10; ++i) {
      const double beyond_mm = Uniform(random, 0.2, 1.8) * kRadius;
      for (const double after_mm : {0.0, 0.003}) {
        const double phi = Uniform(random, 0, 2 * kPi);
        cloud.push_back(last.PointAt(last.length_mm + beyond_mm + after_mm) +
                        kRadius * (std::cos(phi) * across + std::sin(phi) * last.normal));
      }
    }
    const TubeEnds ends = FindTubeEnds(tube, kNoise, tests::Blocks(cloud, kRadius));
    EXPECT_NEAR(EndErrors(tube, ends).last, 0, 0.1) << run;
  }
}

// The end of a bowed straight leans, and its best-fit line passes the next one by: at L / 300 both
// move an end by more than a scan leaves open.
TEST(TubeEnds, OfBowedStraightsCountFromTheCorner) {
  for (const int seed : {3, 4}) {
    SCOPED_TRACE(seed);
    Random random(seed);
    hal::Tube tube = ThreeBends();
    tube.program.rows[0].angle_deg = 88;
    const auto cloud = tests::ScanRealTube(tube, {.bow = 1.0 / 300}, {.noise_mm = 0.01}, random);
    const std::vector<PointBlock> blocks = {{Eigen::Vector3d::Zero(), 1e3, cloud.points_W}};
    const BowedSolution solution = SolveWithBows(tube, blocks, {.reach_mm = 1});
    const TubeEnds ends = FindTubeEnds(solution.fit.tube, solution.bows.noise_mm, blocks, nullptr,
                                       &solution.bows.state);
    const auto &rows = ends.tube.program.rows, &truth = cloud.truth.program.rows;
    EXPECT_NEAR(rows.front().length_mm, truth.front().length_mm, 0.05);
    EXPECT_NEAR(rows.back().length_mm, truth.back().length_mm, 0.05);
  }
}

}  // namespace
}  // namespace bendloop::pipeline
