// SPDX-License-Identifier: Apache-2.0
// Holes and slots: the error of a border against the bound of its sampling, and what is none.
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>
#include <vector>

#include "hal/angles.h"
#include "pipeline/features/beside_border.h"
#include "pipeline/features/border_clumping.h"
#include "pipeline/features/opening_border.h"
#include "pipeline/features/opening_lines.h"
#include "pipeline/features/opening_surroundings.h"
#include "pipeline/features/ray_numbers.h"
#include "tests/support/cut_walls.h"

namespace bendloop::pipeline {
namespace {

using tests::Uniform;

// Evenly over a square; those in the opening are missing, noise moves the others by `smear_mm`.
std::vector<Eigen::Vector2d> Wall(const OpeningBorder& opening, double per_mm2, double smear_mm,
                                  std::mt19937_64& random) {
  const double half_mm = opening.length_mm;
  std::normal_distribution<double> noise(0.0, smear_mm);
  std::vector<Eigen::Vector2d> samples;
  for (int i = 0; i < static_cast<int>(per_mm2 * 4 * half_mm * half_mm); ++i) {
    const Eigen::Vector2d place(Uniform(random, -half_mm, half_mm),
                                Uniform(random, -half_mm, half_mm));
    if (opening.DistanceMm(place) < 0) continue;
    samples.emplace_back(place.x() + noise(random), place.y() + noise(random));
  }
  return samples;
}

// As in end_plane_test.cc each mm of border tells 0.903 n / s of where it is: of a circle's radius
// all of it, of either coordinate of its middle half.
TEST(OpeningBorder, OfAHoleIsAsSureAsItsSamplesLet) {
  constexpr double kDensity = 8, kSmearMm = 0.05, kDiameterMm = 6;
  constexpr int kHoles = 60;
  std::mt19937_64 random(1);
  double place2 = 0, size2 = 0, place_sigmas = 0, size_sigmas = 0;
  for (int i = 0; i < kHoles; ++i) {
    OpeningBorder hole;
    hole.middle_mm = {Uniform(random, -0.3, 0.3), Uniform(random, -0.3, 0.3)};
    hole.length_mm = hole.width_mm = kDiameterMm;
    OpeningBorder about = hole;
    about.middle_mm.x() += 0.1;
    about.length_mm += 0.4;
    about.width_mm += 0.2;
    const FittedOpening fitted =
        FitOpening(Wall(hole, kDensity, kSmearMm, random), about, kSmearMm);
    EXPECT_TRUE(fitted.border.is_hole());
    const Eigen::Vector2d off = fitted.border.middle_mm - hole.middle_mm;
    const double wider = fitted.border.width_mm - kDiameterMm;
    place2 += 0.5 * off.squaredNorm() / kHoles;
    size2 += wider * wider / kHoles;
    place_sigmas += 0.5 * off.cwiseQuotient(fitted.sigma.middle_mm).squaredNorm() / kHoles;
    size_sigmas += std::pow(wider / fitted.sigma.width_mm, 2) / kHoles;
  }
  const double information = 0.903 * kDensity / kSmearMm * std::numbers::pi * kDiameterMm;
  EXPECT_LT(std::sqrt(place2), 1.3 * std::sqrt(2 / information));
  EXPECT_LT(std::sqrt(size2), 1.3 * 2 / std::sqrt(information));
  EXPECT_LT(std::sqrt(place_sigmas), 1.3);
  EXPECT_LT(std::sqrt(size_sigmas), 1.3);
}

TEST(OpeningBorder, OfASlotHasLengthWidthAndAxis) {
  std::mt19937_64 random(2);
  double worst = 0;
  for (int i = 0; i < 20; ++i) {
    OpeningBorder slot;
    slot.middle_mm = {Uniform(random, -0.3, 0.3), Uniform(random, -0.3, 0.3)};
    slot.length_mm = 12;
    slot.width_mm = 5;
    slot.axis_rad = Uniform(random, -1, 1);
    OpeningBorder about = slot;
    about.length_mm += 0.5;
    about.width_mm += 0.2;
    about.axis_rad += 0.03;
    const FittedOpening fitted = FitOpening(Wall(slot, 6, 0.05, random), about, 0.05);
    ASSERT_FALSE(fitted.border.is_hole());
    for (const double sigmas : {(fitted.border.length_mm - slot.length_mm) / fitted.sigma.length_mm,
                                (fitted.border.width_mm - slot.width_mm) / fitted.sigma.width_mm,
                                (fitted.border.axis_rad - slot.axis_rad) / fitted.sigma.axis_rad}) {
      worst = std::max(worst, std::abs(sigmas));
    }
  }
  EXPECT_LT(worst, 4);  // of 60 values
}

// Laser lines along y, of passes that begin anywhere; `gap_mm`: nobody looked at the middle.
std::vector<WallSample> LinesOn(const OpeningBorder& hole, double gap_mm, std::mt19937_64& random) {
  constexpr double kLinesMm = 0.5, kRaysMm = 0.1, kHalfMm = 5;
  std::normal_distribution<double> noise(0.0, 0.01);
  std::vector<WallSample> samples;
  for (unsigned pass = 0; pass < 3; ++pass) {
    const SensorDirection to_sensor =
        WithPass(PackDirection({0, 0.5 * (static_cast<double>(pass) - 1), 1}), pass);
    const double first_ray_mm = Uniform(random, 0, kRaysMm);
    for (double x = -kHalfMm + Uniform(random, 0, kLinesMm); x < kHalfMm; x += kLinesMm) {
      for (double y = -kHalfMm + first_ray_mm; y < kHalfMm; y += kRaysMm) {
        if (hole.DistanceMm({x, y}) < 0 || std::abs(y) < 0.5 * gap_mm) continue;
        samples.push_back({{x, y + noise(random)}, to_sensor});
      }
    }
  }
  return samples;
}

// Rays every 0.3 mm of lines 0.5 mm apart, 9 mm and so far sideways; which of them meet no wall is
// `is_missed`.
struct LookedAtPlaces {
  std::vector<Eigen::Vector2d> samples;
  std::vector<MissedPlace> missed;
};
template <class IsMissed>
LookedAtPlaces LookAtPlaces(double half_mm, std::mt19937_64& random, IsMissed is_missed) {
  std::normal_distribution<double> noise(0.0, 0.005);
  LookedAtPlaces seen;
  for (double x = -9 + Uniform(random, 0, 0.5); x < 9; x += 0.5) {
    for (double y = -half_mm + Uniform(random, 0, 0.3); y < half_mm; y += 0.3) {
      const Eigen::Vector2d place(x, y + noise(random));
      if (is_missed(place)) {
        seen.missed.push_back({place, 0.005});
      } else {
        seen.samples.push_back(place);
      }
    }
  }
  return seen;
}

// Where the wall is pressed in right beside a hole rays meet no round wall, as where a drill left
// an opening by far more of a lean. The hole stays round, and where it is.
TEST(OpeningBorder, OfAHoleBesideADentDoesNotLean) {
  std::mt19937_64 random(7);
  for (int i = 0; i < 3; ++i) {
    SCOPED_TRACE(i);
    OpeningBorder hole;
    hole.length_mm = hole.width_mm = 8;
    hole.pipe_radius_mm = 6.75;
    const Eigen::Vector2d dent(5.0 + 0.2 * i, 0.3);
    const LookedAtPlaces seen = LookAtPlaces(6, random, [&](const Eigen::Vector2d& place) {
      return hole.DistanceMm(place) < 0 || (place - dent).norm() < 2.5;
    });
    const FittedOpening fitted = FitOpening(seen.samples, hole, 0.01, seen.missed, seen.samples);
    EXPECT_LT(fitted.border.lean.norm(), 0.3);
    EXPECT_LT(fitted.border.middle_mm.norm(), 0.3);
  }
}

// Rays that return nothing well beside an opening say the same of every shape: a slot was a hole
// that leans where some were lost beyond its ends.
TEST(OpeningBorder, OfASlotIsNoneOfALeanForRaysLostBesideIt) {
  std::mt19937_64 random(11);
  for (int i = 0; i < 4; ++i) {
    SCOPED_TRACE(i);
    OpeningBorder slot;
    slot.length_mm = 8 + 0.3 * i, slot.width_mm = 6;
    slot.pipe_radius_mm = 12;
    const LookedAtPlaces seen = LookAtPlaces(7, random, [&](const Eigen::Vector2d& place) {
      const bool is_beside = std::abs(place.y()) < 3 && std::abs(place.x()) > 6.5;
      return slot.DistanceMm(place) < 0 || (is_beside && Uniform(random, 0, 1) < 0.7);
    });
    const FittedOpening fitted = FitOpening(seen.samples, slot, 0.01, seen.missed, seen.samples);
    EXPECT_FALSE(fitted.border.is_hole());
    EXPECT_NEAR(fitted.border.length_mm, slot.length_mm, 0.3);
  }
}

// What a drill that leans leaves of a round wall is neither a circle nor an ellipse.
TEST(OpeningBorder, OfALeaningHoleIsAsLargeAsItsPlacesAre) {
  OpeningBorder hole;
  hole.length_mm = hole.width_mm = 6;
  hole.pipe_radius_mm = 8;
  hole.middle_mm = {0.1, -0.4};
  hole.lean = {0.2, 0.5};
  constexpr double kStepMm = 0.01;
  double places = 0;
  for (double x = -7.995; x < 8; x += kStepMm) {
    for (double y = -7.995; y < 8; y += kStepMm) places += hole.DistanceMm({x, y}) < 0 ? 1 : 0;
  }
  EXPECT_NEAR(hole.AreaMm2(), places * kStepMm * kStepMm, 0.01);
}

TEST(OpeningBorder, OfALeaningHoleIsAsSureAsItsSamplesLet) {
  constexpr double kDensity = 20, kSmearMm = 0.05;
  constexpr int kHoles = 14;
  std::mt19937_64 random(31);
  OpeningBorder hole;
  hole.length_mm = hole.width_mm = 6;
  hole.pipe_radius_mm = 8;
  hole.lean = {0.2, 0.5};
  OpeningBorder about = hole;
  about.lean.setZero();
  about.middle_mm.x() += 0.1;
  about.length_mm = 7.2, about.width_mm = 6.2;
  about.axis_rad = std::atan2(0.5, 0.2);
  const Eigen::VectorXd bound = tests::OpeningBound(hole, 5, kDensity, kSmearMm);
  int leaning = 0;
  double bounds2 = 0, sigmas2 = 0;
  for (int i = 0; i < kHoles; ++i) {
    const FittedOpening fitted =
        FitOpening(tests::SampleWall(hole, kDensity, kSmearMm, random), about, kSmearMm);
    if (fitted.border.lean.isZero()) continue;
    ++leaning;
    const Eigen::Vector2d off = fitted.border.middle_mm - hole.middle_mm;
    const Eigen::Vector2d leans = fitted.border.lean - hole.lean;
    bounds2 += off.cwiseQuotient(bound.head<2>()).squaredNorm() +
               leans.cwiseQuotient(bound.tail<2>()).squaredNorm();
    sigmas2 += off.cwiseQuotient(fitted.sigma.middle_mm).squaredNorm() +
               leans.cwiseQuotient(fitted.sigma.lean).squaredNorm();
  }
  ASSERT_EQ(leaning, kHoles);
  EXPECT_LT(std::sqrt(bounds2 / (4 * leaning)), 1.3);
  EXPECT_LT(std::sqrt(sigmas2 / (4 * leaning)), 1.3);
}

// The opposite lean leaves nearly the same oval, and of thin samples few tell which one it is.
TEST(OpeningBorder, OfALeaningHoleInThinSamplesLeansTheRightWay) {
  constexpr double kDensity = 6, kSmearMm = 0.025;
  constexpr int kHoles = 10;
  std::mt19937_64 random(60);
  OpeningBorder hole;
  hole.length_mm = hole.width_mm = 6;
  hole.pipe_radius_mm = 8;
  hole.lean = {0.2, 0.5};
  OpeningBorder about = hole;
  about.lean.setZero();
  about.middle_mm.x() += 0.1;
  about.length_mm = 7.2, about.width_mm = 6.2;
  about.axis_rad = std::atan2(0.5, 0.2);
  int leaning = 0, aside = 0;
  double sigmas2 = 0;
  for (int i = 0; i < kHoles; ++i) {
    const FittedOpening fitted =
        FitOpening(tests::SampleWall(hole, kDensity, kSmearMm, random), about, kSmearMm);
    if (fitted.border.lean.isZero()) continue;
    ++leaning;
    aside += fitted.border.lean.dot(hole.lean) < 0 ? 1 : 0;
    sigmas2 += (fitted.border.lean - hole.lean).cwiseQuotient(fitted.sigma.lean).squaredNorm();
  }
  EXPECT_GE(leaning, kHoles - 1);
  EXPECT_EQ(aside, 0);
  EXPECT_LT(std::sqrt(sigmas2 / (2 * leaning)), 1.3);
}

// Error over sigma of holes, each of its own size, lean and density of samples.
struct HoleErrors {
  int count = 0;
  double place2 = 0, size2 = 0, worst = 0;

  void Add(const FittedOpening& fitted, const OpeningBorder& hole) {
    const Eigen::Vector2d off =
        (fitted.border.middle_mm - hole.middle_mm).cwiseQuotient(fitted.sigma.middle_mm);
    const double wider = (fitted.border.width_mm - hole.width_mm) / fitted.sigma.width_mm;
    ++count;
    place2 += 0.5 * off.squaredNorm();
    size2 += wider * wider;
    worst = std::max({worst, off.cwiseAbs().maxCoeff(), std::abs(wider)});
  }
  double Place() const { return std::sqrt(place2 / count); }
  double Size() const { return std::sqrt(size2 / count); }
};
FittedOpening FitOneOnTube(OpeningBorder& hole, double lean, bool is_bent,
                           std::mt19937_64& random) {
  hole.pipe_radius_mm = 8;
  hole.length_mm = hole.width_mm = Uniform(random, 2.5, 9);
  const double axis_rad = Uniform(random, -std::numbers::pi, std::numbers::pi);
  hole.lean = lean * Eigen::Vector2d(std::cos(axis_rad), std::sin(axis_rad));
  OpeningBorder about = hole;
  about.lean.setZero();
  about.is_bent = is_bent;
  about.middle_mm.x() += 0.1;
  about.length_mm += 0.2, about.width_mm += 0.1;
  about.axis_rad = axis_rad;
  const double per_mm2 = Uniform(random, 5, 20);
  return FitOpening(tests::SampleWall(hole, per_mm2, 0.03, random), about, 0.03);
}

// A drill that leans moves the border around the tube, where its own lean is told by much less:
// places around were many sigma off whose lean was not certain.
TEST(OpeningBorder, OfAHoleWhoseLeanIsNotToldHoldsThatItMayLean) {
  constexpr int kHoles = 40;
  std::mt19937_64 random(77);
  HoleErrors radial, straight, bent;
  for (int i = 0; i < kHoles; ++i) {
    const double lean = std::tan(Uniform(random, 3, 25) * hal::kRadiansPerDegree);
    OpeningBorder hole;
    const FittedOpening in_bend = FitOneOnTube(hole, lean, true, random);
    EXPECT_TRUE(in_bend.border.lean.isZero());
    bent.Add(in_bend, hole);
    const FittedOpening fitted = FitOneOnTube(hole, lean, false, random);
    if (fitted.border.lean.isZero()) straight.Add(fitted, hole);
    const FittedOpening not_leaning = FitOneOnTube(hole, 0, false, random);
    EXPECT_TRUE(not_leaning.border.lean.isZero());
    radial.Add(not_leaning, hole);
  }
  EXPECT_GE(straight.count, 12);
  for (const HoleErrors& errors : {straight, bent}) {
    EXPECT_LT(errors.Place(), 1.3);
    EXPECT_LT(errors.Size(), 1.3);
    EXPECT_LT(errors.worst, 4);
  }
  for (const double off : {radial.Place(), radial.Size()}) {
    EXPECT_GT(off, 0.7);
    EXPECT_LT(off, 1.3);
  }
  EXPECT_LT(radial.worst, 4);
}

TEST(OpeningLines, RaysThatMeetNoWallAreInTheHole) {
  std::mt19937_64 random(3);
  double place_sigmas = 0, size_sigmas = 0, place2 = 0;
  constexpr int kHoles = 12;
  for (int i = 0; i < kHoles; ++i) {
    OpeningBorder hole;
    hole.middle_mm = {Uniform(random, -0.3, 0.3), Uniform(random, -0.3, 0.3)};
    hole.length_mm = hole.width_mm = 3;
    const auto samples = LinesOn(hole, 0, random);
    std::vector<Eigen::Vector2d> wall;
    for (const WallSample& sample : samples) wall.push_back(sample.place_mm);
    std::vector<MissedPlace> missed;
    for (const MissedRay& ray :
         FindMissed(samples, 20, 0.01, Eigen::Vector3d::UnitZ(), Eigen::Vector3d::UnitY()).rays) {
      EXPECT_LT(hole.DistanceMm(ray.place_mm), 0.05);
      missed.push_back({ray.place_mm, ray.sideways_sigma_mm});
    }
    ASSERT_GT(missed.size(), 100U);
    OpeningBorder about = hole;
    about.length_mm += 0.4;
    about.width_mm += 0.2;
    const FittedOpening fitted = FitOpening(wall, about, 0.01, missed, {});
    EXPECT_TRUE(fitted.border.is_hole());
    const Eigen::Vector2d off = fitted.border.middle_mm - hole.middle_mm;
    place2 += 0.5 * off.squaredNorm() / kHoles;
    place_sigmas += 0.5 * off.cwiseQuotient(fitted.sigma.middle_mm).squaredNorm() / kHoles;
    size_sigmas += std::pow((fitted.border.width_mm - 3) / fitted.sigma.width_mm, 2) / kHoles;
  }
  EXPECT_LT(std::sqrt(place2), 0.03);
  EXPECT_LT(std::sqrt(place_sigmas), 1.5);
  EXPECT_LT(std::sqrt(size_sigmas), 1.5);
}

// A scanner that is held askew sweeps curves over the tube: beyond a wide slot they go on elsewhere
// than straight lines would. Rays that seemed to meet no wall lay beside the slot, which was told
// too wide.
TEST(OpeningLines, OfAPassAskewRaysAreMissedInTheSlotAlone) {
  constexpr double kOfTubeMm = 8.4, kLineMm = 0.62, kRayMm = 0.58;
  for (const double askew : {-0.2, -0.12, 0.0, 0.12, 0.2}) {
    SCOPED_TRACE(askew);
    const auto is_in_slot = [](double along_mm, double across_mm, double wider_mm) {
      return std::abs(along_mm) < 6 + wider_mm && std::abs(across_mm) < 3.36 + wider_mm;
    };
    std::vector<WallSample> samples;
    double in_slot = 0;
    for (int line = -32; line <= 32; ++line) {
      for (int ray = -13; ray <= 13; ++ray) {
        const double across_mm = kRayMm * ray + 0.1, turn = std::asin(across_mm / kOfTubeMm);
        const double along_mm = kLineMm * line + askew * across_mm;
        if (is_in_slot(along_mm, across_mm, 0)) {
          in_slot += 1;
          continue;
        }
        samples.push_back(
            {{along_mm, kOfTubeMm * turn}, WithPass(PackDirection(Eigen::Vector3d::UnitZ()), 0)});
      }
    }
    const MissedRays missed =
        FindMissed(samples, kOfTubeMm, 0.01, Eigen::Vector3d::UnitZ(), Eigen::Vector3d::UnitY());
    EXPECT_NEAR(static_cast<double>(missed.rays.size()), in_slot, 0.02 * in_slot);
    for (const MissedRay& ray : missed.rays) {
      const double across_mm = kOfTubeMm * std::sin(ray.place_mm.y() / kOfTubeMm);
      EXPECT_TRUE(is_in_slot(ray.place_mm.x(), across_mm, 0.05)) << ray.place_mm.transpose();
    }
  }
}

// Rays that come in flat lie further apart: which of them met nothing, and where they would have
// met the wall, is known to a hundredth of that all the same.
TEST(RayNumbers, OfRaysFromOnePlaceTellWhereMissedOnesWouldBe) {
  constexpr double kOfTubeMm = 8, kAwayMm = 120, kTurn = 0.0027;
  std::vector<NeighbouringRays> neighbours;
  std::vector<double> places;
  for (int line = 0; line < 20; ++line) {
    places.clear();
    for (double angle = -0.063 + 0.0001 * line; angle < 0.063; angle += kTurn) {
      // Where a ray from this far above the axis meets the wall, unrolled.
      const double meets = std::asin(kAwayMm * std::sin(angle) / kOfTubeMm) - angle;
      places.push_back(kOfTubeMm * meets);
    }
    for (std::size_t i = 1; i < places.size(); ++i) {
      if (line < 5 || i < 18 || i > 28) neighbours.push_back({places[i - 1], places[i]});
    }
  }
  const auto numbers = RayNumbers::Of(neighbours);
  ASSERT_TRUE(numbers);
  EXPECT_LT(numbers->uneven(), 0.01);
  const double first = numbers->At(places[17]), last = numbers->At(places[29]);
  EXPECT_NEAR(last - first, 12, 0.05);
  for (std::size_t i = 18; i < 29; ++i) {
    const double part = static_cast<double>(i - 17) / 12;
    const double place_mm = numbers->PlaceMm(first + part * (last - first), places[17]);
    EXPECT_NEAR(place_mm, places[i], 0.01 * numbers->PitchMm(places[i])) << i;
  }
}

// Noise moves samples along their rays: each tells where its ray met the wall, however flat.
TEST(OpeningSurroundings, SamplesLieWhereTheirRaysMetTheWall) {
  constexpr double kOfPipeMm = 10, kOffMm = 0.15;
  hal::BendProgram straight;
  straight.rows.push_back({100, 0, 0, std::nullopt});
  const auto segments = hal::SpineSegments(straight, hal::Pose{});
  const auto frames = SegmentFrames(segments, kOfPipeMm);
  const hal::SurfaceFrame frame = hal::FrameAt(segments, 50, 0);
  std::vector<Eigen::Vector3d> points;
  std::vector<SensorDirection> to_sensor;
  std::vector<Eigen::Vector2d> met;
  for (const double turn_deg : {-70.0, -40.0, 0.0, 25.0, 55.0, 75.0}) {
    const double turn = turn_deg * hal::kRadiansPerDegree;
    const Eigen::Vector3d wall = frame.spine_mm + kOfPipeMm * (std::cos(turn) * frame.outward +
                                                               std::sin(turn) * frame.sideways());
    const Eigen::Vector3d way = (frame.outward + 0.3 * frame.tangent).normalized();
    met.emplace_back(0.0, kOfPipeMm * std::sin(turn));
    points.push_back(wall + (turn_deg < 0 ? -kOffMm : kOffMm) * way);
    to_sensor.push_back(WithPass(PackDirection(way), 0));
  }
  const PointBlock block{frame.spine_mm, 2 * kOfPipeMm, points, {}, to_sensor};
  const LookedAtTube tube{kOfPipeMm, 0.05, segments, frames, std::span(&block, 1)};
  const Surroundings around = tube.LookAt(frame, 20, 0.5);
  ASSERT_EQ(around.seen.size(), met.size());
  for (std::size_t i = 0; i < met.size(); ++i) {
    SCOPED_TRACE(i);
    // The second order of a step of so much across the curve.
    EXPECT_LT((around.wall[i] - met[i]).norm(), 0.01);
    EXPECT_LT((around.seen[i].place_mm - met[i]).norm(), 0.01);
  }
}

// Lines of an unsteady hand are neither even nor upright, and look like scattered samples; but
// their rays stand in columns along the tube. What lies between two of them was told as a slot.
// Where a pass ends beside an opening the wall beyond is no gap of its own: most such openings were
// missed.
TEST(OpeningSurroundings, APassTellsNothingOfWhatIsLikeItsOwnGaps) {
  constexpr double kOfPipeMm = 10, kRayMm = 1.3;
  hal::BendProgram straight;
  straight.rows.push_back({100, 0, 0, std::nullopt});
  const auto segments = hal::SpineSegments(straight, hal::Pose{});
  const auto frames = SegmentFrames(segments, kOfPipeMm);
  const hal::SurfaceFrame frame = hal::FrameAt(segments, 50, 0);
  OpeningBorder gap, slot;
  gap.middle_mm = {0, 0.5 * kRayMm};
  gap.width_mm = 0.9 * kRayMm;
  gap.length_mm = 16;
  slot.width_mm = 5;
  slot.length_mm = 12;
  std::mt19937_64 random(21);
  std::normal_distribution<double> normal;
  struct Scan {
    bool has_slot;
    int last_ray;
  };
  for (const auto& [has_slot, last_ray] : {Scan{false, 7}, Scan{true, 7}, Scan{true, 3}}) {
    SCOPED_TRACE(std::to_string(has_slot) + " " + std::to_string(last_ray));
    std::vector<Eigen::Vector3d> points;
    std::vector<SensorDirection> to_sensor;
    for (double at_mm = 25; at_mm < 75; at_mm += 0.4 * std::exp(0.4 * normal(random))) {
      const double askew = 0.05 * normal(random);
      for (int ray = -7; ray <= last_ray; ++ray) {
        const double around_mm = kRayMm * ray + 0.05 * normal(random);
        const double along_mm = at_mm + askew * around_mm, turn = around_mm / kOfPipeMm;
        if (has_slot && slot.DistanceMm({along_mm - 50, kOfPipeMm * std::sin(turn)}) < 0) continue;
        points.push_back(frame.spine_mm + (along_mm - 50) * frame.tangent +
                         kOfPipeMm *
                             (std::cos(turn) * frame.outward + std::sin(turn) * frame.sideways()));
        to_sensor.push_back(WithPass(PackDirection(frame.outward), 0));
      }
    }
    const PointBlock block{frame.spine_mm, 5 * kOfPipeMm, points, {}, to_sensor};
    const LookedAtTube tube{kOfPipeMm, 0.02, segments, frames, std::span(&block, 1)};
    const OpeningBorder& about = has_slot ? slot : gap;
    const PassSurroundings passes = tube.FindPasses(frame, tube.LookAt(frame, 24, 0.5), about);
    EXPECT_TRUE(passes.are_known);
    EXPECT_FALSE(passes.has_lines);
    EXPECT_NEAR(passes.scattered_part, has_slot ? 1.0 : 0.0, 0.1);
  }
}

// Where rays stand in columns a border between two of them is as unsure as these are apart, however
// many lines cross it; where they do not every sample tells.
TEST(BorderClumping, IsThatOfColumns) {
  std::mt19937_64 random(8);
  OpeningBorder slot;
  slot.width_mm = 10;
  slot.length_mm = 60;
  constexpr double kRayMm = 1.5;
  for (const bool in_columns : {false, true}) {
    std::vector<Eigen::Vector2d> samples;
    for (double at_mm = -25; at_mm < 25; at_mm += 2.5) {
      for (double ray = -10; ray < 10; ray += 1) {
        const double off =
            in_columns ? 0.5 + tests::Uniform(random, -0.02, 0.02) : tests::Uniform(random, 0, 1);
        const Eigen::Vector2d place(at_mm, kRayMm * (ray + off));
        if (slot.DistanceMm(place) > 0) samples.push_back(place);
      }
    }
    const Clumping clumping = ClumpingBeside(slot, samples);
    // Of twenty lines: a uniform error of a ray over that of 20 samples is 5.8, and more of three
    // columns, whose outer halves nobody counts.
    EXPECT_NEAR(clumping.across, in_columns ? 7.0 : 1.0, in_columns ? 2.0 : 0.3);
    EXPECT_GE(clumping.along, 1.0);
  }
}

// A long slot leaves little room beside it on the side of the tube that is seen with it: too few of
// the places there were asked, and well seen slots were missed.
TEST(OpeningSurroundings, ALongSlotIsNotLikeThem) {
  constexpr double kOfPipeMm = 24, kFarMm = 145;
  OpeningBorder slot;
  slot.width_mm = 18;
  slot.length_mm = 92;
  std::mt19937_64 random(3);
  std::normal_distribution<double> normal;
  std::vector<Eigen::Vector2d> present;
  for (double at_mm = -kFarMm; at_mm < kFarMm; at_mm += 6 * std::exp(0.13 * normal(random))) {
    for (int ray = -16; ray <= 16; ++ray) {
      const Eigen::Vector2d place(at_mm, kOfPipeMm * std::sin(1.7 * ray / kOfPipeMm));
      if (slot.DistanceMm(place) > 0 && place.norm() < kFarMm) present.push_back(place);
    }
  }
  EXPECT_FALSE(IsLikeItsSurroundings(slot, present, kFarMm, kOfPipeMm));
  EXPECT_FALSE(IsLikeItsSurroundings(slot, present, kFarMm, kOfPipeMm, 0.75));
}

// A part of the tube crosses above another, and hides it from the laser or from a camera that looks
// at the line from the side. The shadow was told as a slot: the laser's never counted, and of the
// cameras in ten degrees one was.
TEST(OpeningSurroundings, WhatAnotherPartOfTheTubeHidesIsNoOpening) {
  constexpr double kOfPipeMm = 10, kAboveMm = 190, kAtMm = 200;
  hal::BendProgram straight;
  straight.rows.push_back({400, 0, 0, std::nullopt});
  auto segments = hal::SpineSegments(straight, hal::Pose{});
  const hal::SurfaceFrame at = hal::FrameAt(segments, kAtMm, 0);
  const Eigen::Vector3d above = at.spine_mm + (kOfPipeMm + kAboveMm) * at.outward;
  hal::Pose across;
  across.position_mm = above - 200 * at.sideways();
  across.orientation = Eigen::Quaterniond::FromTwoVectors(segments.front().tangent, at.sideways());
  segments.push_back(hal::SpineSegments(straight, across).front());
  segments.back().from_start_mm = 1000;
  const auto frames = SegmentFrames(segments, kOfPipeMm);
  for (const double camera_deg : {0.0, 24.0, -24.0}) {
    SCOPED_TRACE(camera_deg);
    const double camera = camera_deg * hal::kRadiansPerDegree;
    const double shadow_mm = kAtMm - kAboveMm * std::tan(camera);
    const hal::SurfaceFrame frame = hal::FrameAt(segments, shadow_mm, 0);
    const Eigen::Vector3d way = std::cos(camera) * frame.outward + std::sin(camera) * frame.tangent;
    const Eigen::Vector3d beside = way.cross(frame.sideways());
    std::vector<Eigen::Vector3d> points;
    std::vector<SensorDirection> to_sensor;
    for (int line = -48; line <= 48; ++line) {
      for (int ray = -19; ray <= 19; ++ray) {
        const double sideways_mm = 0.43 * ray;
        const Eigen::Vector3d point =
            frame.spine_mm + 0.5 * line * frame.tangent + sideways_mm * frame.sideways() +
            std::sqrt(kOfPipeMm * kOfPipeMm - sideways_mm * sideways_mm) * frame.outward;
        if (std::abs(beside.dot(above - point)) < kOfPipeMm) continue;
        points.push_back(point);
        to_sensor.push_back(WithPass(PackDirection(frame.outward), 0));
      }
    }
    const PointBlock block{frame.spine_mm, 5 * kOfPipeMm, points, {}, to_sensor};
    const LookedAtTube tube{kOfPipeMm, 0.02, segments, frames, std::span(&block, 1)};
    OpeningBorder shadow;
    shadow.width_mm = 12;
    shadow.length_mm = 16;
    const PassSurroundings passes = tube.FindPasses(frame, tube.LookAt(frame, 24, 0.5), shadow);
    EXPECT_TRUE(passes.are_known);
    EXPECT_TRUE(passes.has_lines);
    EXPECT_TRUE(passes.missed.empty()) << passes.missed.size();
  }
}

// Beside such a shadow, whose edges are not sharp, a hole with wall on all its sides is one: what a
// part of the tube hides is as wide as the tube.
TEST(OpeningSurroundings, AHoleBesideAShadowIsNotHidden) {
  constexpr double kOfPipeMm = 10, kAboveMm = 190, kAtMm = 200, kFromShadowMm = 15;
  hal::BendProgram straight;
  straight.rows.push_back({400, 0, 0, std::nullopt});
  auto segments = hal::SpineSegments(straight, hal::Pose{});
  const hal::SurfaceFrame at = hal::FrameAt(segments, kAtMm, 0);
  const hal::SurfaceFrame frame = hal::FrameAt(segments, kAtMm - kFromShadowMm, 0);
  hal::Pose across;
  across.position_mm = at.spine_mm + (kOfPipeMm + kAboveMm) * at.outward - 200 * at.sideways();
  across.orientation = Eigen::Quaterniond::FromTwoVectors(segments.front().tangent, at.sideways());
  segments.push_back(hal::SpineSegments(straight, across).front());
  segments.back().from_start_mm = 1000;
  const auto frames = SegmentFrames(segments, kOfPipeMm);
  OpeningBorder hole;
  hole.width_mm = hole.length_mm = 5;
  std::vector<Eigen::Vector3d> points;
  std::vector<SensorDirection> to_sensor;
  for (int line = -48; line <= 48; ++line) {
    for (int ray = -19; ray <= 19; ++ray) {
      const Eigen::Vector2d place(0.5 * line, 0.43 * ray);
      if (std::abs(place.x() - kFromShadowMm) < kOfPipeMm || hole.DistanceMm(place) < 0) continue;
      points.push_back(frame.spine_mm + place.x() * frame.tangent + place.y() * frame.sideways() +
                       std::sqrt(kOfPipeMm * kOfPipeMm - place.y() * place.y()) * frame.outward);
      to_sensor.push_back(WithPass(PackDirection(frame.outward), 0));
    }
  }
  const PointBlock block{frame.spine_mm, 5 * kOfPipeMm, points, {}, to_sensor};
  const LookedAtTube tube{kOfPipeMm, 0.02, segments, frames, std::span(&block, 1)};
  const PassSurroundings passes = tube.FindPasses(frame, tube.LookAt(frame, 24, 0.5), hole);
  EXPECT_TRUE(passes.has_lines);
  EXPECT_GT(passes.PartThrough(hole), 0.7);
}

TEST(OpeningLines, AGapBetweenPassesMissesNothing) {
  std::mt19937_64 random(4);
  OpeningBorder none;  // of no size
  const auto samples = LinesOn(none, 1.5, random);
  const MissedRays missed =
      FindMissed(samples, 20, 0.01, Eigen::Vector3d::UnitZ(), Eigen::Vector3d::UnitY());
  EXPECT_TRUE(missed.has_lines);
  EXPECT_TRUE(missed.rays.empty());
}

}  // namespace
}  // namespace bendloop::pipeline
