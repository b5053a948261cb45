// SPDX-License-Identifier: Apache-2.0
// Ends that have more than a plane: bevels, burrs, and borders that no plane is. And that a plain
// end has none of them.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "drivers/simulated_scanner/virtual_scan.h"
#include "hal/angles.h"
#include "hal/clock.h"
#include "pipeline/features/end_cut.h"
#include "pipeline/fit/tube_ends.h"
#include "pipeline/reconstruction.h"
#include "tests/support/cut_walls.h"
#include "tests/support/error_sigmas.h"
#include "tests/support/reversed_features.h"

namespace bendloop::pipeline {
namespace {

// A scan from four sides of a tube with these edges, and what is true of it as it was measured.
struct EdgeScan {
  hal::Tube tube;
  hal::TubeFeatures truth;
  Measurement measured;

  double true_length_mm(bool first) const {
    const auto& rows = tube.program.rows;
    return first ? rows.front().length_mm : rows.back().length_mm;
  }
};

EdgeScan ScanEdges(std::uint64_t seed, const hal::TubeFeatures& features, double noise_mm = 0.03,
                   double wall_mm = 0) {
  EdgeScan scan;
  scan.tube = drivers::LayOnTable(
      {8, {{{70, 0, 60, 25.0}, {60, 90, 45, 25.0}, {65, 0, 0, std::nullopt}}}, {}}, seed);
  scan.truth = features;
  drivers::VirtualScanOptions options;
  options.seed = seed;
  options.rays = 320;
  options.noise_mm = noise_mm;
  options.path.profile_spacing_mm = 0.3;
  options.path.views_deg = drivers::SpreadViewsDeg(4, true);
  options.path.jitter_mm = options.path.jitter_deg = 0.1;
  options.features = features;
  options.wall_mm = wall_mm;
  const drivers::VirtualScan virtual_scan(scan.tube, options);
  const hal::ManualClock clock;
  Reconstruction reconstruction({}, clock);
  hal::LaserProfile profile(virtual_scan.max_points());
  for (std::size_t i = 0; i < virtual_scan.profile_count(); ++i) {
    virtual_scan.Make(i, profile);
    reconstruction.Add(profile);
  }
  auto measured = reconstruction.Finish();
  EXPECT_TRUE(measured) << (measured ? "" : measured.error().message);
  if (!measured) return scan;
  scan.measured = *measured;
  if (std::abs(measured->tube.program.rows.front().angle_deg - 45) < 5) {  // from its other end
    scan.truth = tests::ReversedFeatures(features, scan.tube);
    scan.tube = ReverseTube(scan.tube);
  }
  return scan;
}

// Errors in sigmas of one number, over several scans.
class EdgeErrors {
 public:
  explicit EdgeErrors(std::string name) : name_(std::move(name)) {}
  ~EdgeErrors() {
    EXPECT_GT(sigmas_.count(), 0) << name_;
    EXPECT_LT(sigmas_.rms(), 1.5) << name_;
  }
  void Add(double error, double sigma) {
    EXPECT_LT(std::abs(error), 3.5 * sigma) << name_;
    sigmas_.Add(error, sigma);
  }

 private:
  std::string name_;
  tests::ErrorSigmas sigmas_;
};

TEST(EndEdge, ABevelIsMeasuredAndTheTubeEndsAtItsTip) {
  EdgeErrors along("along"), depth("depth"), angle("angle"), length("length");
  for (std::uint64_t seed = 1; seed <= 6; ++seed) {
    SCOPED_TRACE(seed);
    hal::TubeFeatures features;
    features.last_edge.bevel_mm = 1.0 + 0.2 * static_cast<double>(seed % 3);
    features.last_edge.bevel_depth_mm = 0.6 + 0.15 * static_cast<double>(seed % 4);
    const EdgeScan scan = ScanEdges(seed, features);
    for (const bool first : {true, false}) {
      const hal::EndEdge& truth = first ? scan.truth.first_edge : scan.truth.last_edge;
      const auto& end = first ? scan.measured.features.first_end : scan.measured.features.last_end;
      ASSERT_TRUE(end);
      ASSERT_EQ(end->bevel.has_value(), truth.bevel_mm > 0);
      const auto& rows = scan.measured.tube.program.rows;
      const auto& sigmas = scan.measured.sigma.rows;
      length.Add((first ? rows.front() : rows.back()).length_mm - scan.true_length_mm(first),
                 (first ? sigmas.front() : sigmas.back()).length_mm);
      if (!end->bevel) continue;
      along.Add(end->bevel->length_mm - truth.bevel_mm, end->bevel->length_sigma_mm);
      depth.Add(end->bevel->depth_mm - truth.bevel_depth_mm, end->bevel->depth_sigma_mm);
      angle.Add(end->bevel->angle_deg -
                    std::atan(truth.bevel_depth_mm / truth.bevel_mm) * hal::kDegreesPerRadian,
                end->bevel->angle_sigma_deg);
      EXPECT_LT(end->bevel->length_sigma_mm, 0.2);
    }
  }
}

// What the cut left of the wall lies in its plane: it is no bevel, and makes no tube longer or more
// square.
TEST(EndEdge, TheFaceOfACutIsNoBevel) {
  EdgeErrors length("length"), obliquity("obliquity"), around("around");
  for (std::uint64_t seed = 1; seed <= 8; ++seed) {
    SCOPED_TRACE(seed);
    hal::TubeFeatures features;
    features.first_end = {3.5 * static_cast<double>(seed), 40.0 * static_cast<double>(seed)};
    const EdgeScan scan = ScanEdges(seed, features, 0.01 * static_cast<double>(1 + seed % 5),
                                    1.0 + 0.5 * static_cast<double>(seed % 3));
    for (const bool first : {true, false}) {
      const hal::EndCut& truth = first ? scan.truth.first_end : scan.truth.last_end;
      const auto& end = first ? scan.measured.features.first_end : scan.measured.features.last_end;
      ASSERT_TRUE(end);
      EXPECT_FALSE(end->bevel || end->burr);
      EXPECT_TRUE(end->border.empty());
      const auto& rows = scan.measured.tube.program.rows;
      const auto& sigmas = scan.measured.sigma.rows;
      length.Add((first ? rows.front() : rows.back()).length_mm - scan.true_length_mm(first),
                 (first ? sigmas.front() : sigmas.back()).length_mm);
      if (truth.obliquity_deg == 0) continue;
      obliquity.Add(end->cut.obliquity_deg - truth.obliquity_deg, end->obliquity_sigma_deg);
      around.Add(std::remainder(end->cut.around_deg - truth.around_deg, 360.0),
                 end->around_sigma_deg);
    }
    EXPECT_TRUE(scan.measured.dents.empty());
    EXPECT_TRUE(scan.measured.features.openings.empty());
  }
}

TEST(EndEdge, ABevelIsFoundBesideTheFace) {
  EdgeErrors along("along"), depth("depth"), length("length");
  for (std::uint64_t seed = 1; seed <= 4; ++seed) {
    SCOPED_TRACE(seed);
    hal::TubeFeatures features;
    features.last_edge.bevel_mm = 1.0 + 0.2 * static_cast<double>(seed % 3);
    features.last_edge.bevel_depth_mm = 0.6 + 0.15 * static_cast<double>(seed % 4);
    const EdgeScan scan = ScanEdges(seed, features, 0.03, 2.0);
    for (const bool first : {true, false}) {
      const hal::EndEdge& truth = first ? scan.truth.first_edge : scan.truth.last_edge;
      const auto& end = first ? scan.measured.features.first_end : scan.measured.features.last_end;
      ASSERT_TRUE(end);
      ASSERT_EQ(end->bevel.has_value(), truth.bevel_mm > 0);
      if (!end->bevel) continue;
      const auto& rows = scan.measured.tube.program.rows;
      const auto& sigmas = scan.measured.sigma.rows;
      length.Add((first ? rows.front() : rows.back()).length_mm - scan.true_length_mm(first),
                 (first ? sigmas.front() : sigmas.back()).length_mm);
      along.Add(end->bevel->length_mm - truth.bevel_mm, end->bevel->length_sigma_mm);
      depth.Add(end->bevel->depth_mm - truth.bevel_depth_mm, end->bevel->depth_sigma_mm);
    }
  }
}

// A cloud of a straight along x: its wall up to 60 mm, a bevel (a flare, where its depth is less
// than nothing) of this length and depth, the face beyond it down to where the wall is 1.6 mm
// thick, and, where some are, mixed pixels below the bevel.
struct Bevelled {
  double length_mm = 1, depth_mm = 1, noise_mm = 0.02, mixed = 0.3, face = 0.3, per_mm2 = 10;
  double seen = 0.3;  // of it, part of the wall's samples
};
std::vector<Eigen::Vector3d> BevelledCloud(double r_mm, const Bevelled& bevel,
                                           std::mt19937_64& random) {
  constexpr double kWallToMm = 60, kThickMm = 1.6;
  const double bevel_mm = bevel.length_mm, depth_mm = bevel.depth_mm;
  std::normal_distribution<double> noise(0, bevel.noise_mm);
  std::vector<Eigen::Vector3d> points;
  const auto add = [&](double per_mm, double length_mm, auto place) {
    const double count = per_mm * length_mm;
    for (int i = 0; i < static_cast<int>(count); ++i) {
      const auto [x_mm, off_mm] = place(tests::Uniform(random, 0, 1));
      const double around = tests::Uniform(random, -std::numbers::pi, std::numbers::pi);
      const double out_mm = r_mm + off_mm + noise(random);
      points.emplace_back(x_mm, out_mm * std::cos(around), out_mm * std::sin(around));
    }
  };
  using Place = std::pair<double, double>;
  const double per_mm = bevel.per_mm2 * 2 * std::numbers::pi * r_mm;
  add(per_mm, kWallToMm, [](double part) { return Place(kWallToMm * part, 0.0); });
  add((depth_mm > 0 ? bevel.seen : 1.0) * per_mm, std::hypot(bevel_mm, depth_mm),
      [&](double part) { return Place(kWallToMm + bevel_mm * part, -depth_mm * part); });
  add(bevel.face * per_mm, kThickMm - depth_mm, [&](double part) {
    return Place(kWallToMm + bevel_mm, -depth_mm - (kThickMm - depth_mm) * part);
  });
  add(bevel.mixed * per_mm, 1.0, [&](double part) {
    return Place(kWallToMm + bevel_mm * part, -depth_mm * part - tests::Uniform(random, 0, 0.4));
  });
  return points;
}

// The last end of such a cloud.
struct CloudEnd {
  EndCuts cuts;
  double at_mm = 0, sigma_mm = 0;
};
CloudEnd EndOf(std::span<const Eigen::Vector3d> points, double r_mm, double noise_mm) {
  const hal::Tube tube{r_mm, {{{62, 0, 0, std::nullopt}}}, {}};
  const std::vector<PointBlock> blocks = {{Eigen::Vector3d(30, 0, 0), 70, points}};
  TubeEnds ends = FindTubeEnds(tube, noise_mm, blocks);
  const EndCuts cuts = FindEndCuts(noise_mm, blocks, ends);
  return {cuts, ends.tube.X_WT.position_mm.x() + ends.tube.program.rows.back().length_mm,
          ends.last_sigma_mm};
}

// The plane of a cut rises by less nearer to the axis, where a bevel goes: its cone is not about
// the plane of the wall's border.
TEST(EndEdge, ABevelOfAnObliqueEndIsAsSteepAsItIs) {
  std::mt19937_64 random(1);
  constexpr double kRadiusOfTubeMm = 6, kNoiseMm = 0.02;
  constexpr int kEnds = 24;
  double square = 0;
  for (int i = 0; i < kEnds; ++i) {
    SCOPED_TRACE(i);
    const double bevel_mm = tests::Uniform(random, 0.6, 1.2);
    const double depth_mm = bevel_mm * tests::Uniform(random, 0.7, 1.3);
    auto points = BevelledCloud(kRadiusOfTubeMm, {bevel_mm, depth_mm, kNoiseMm, 0}, random);
    const double slope = std::tan(tests::Uniform(random, 4, 9) * hal::kRadiansPerDegree);
    for (Eigen::Vector3d& point : points) point.x() += slope * point.y() * point.x() / 60;
    const EndCuts cuts = EndOf(points, kRadiusOfTubeMm, kNoiseMm).cuts;
    ASSERT_TRUE(cuts.last && cuts.last->bevel);
    const double angle_deg = std::atan(depth_mm / bevel_mm) * hal::kDegreesPerRadian;
    const double off_deg = cuts.last->bevel->angle_deg - angle_deg;
    EXPECT_LT(std::abs(off_deg), 1.0);
    square += std::pow(off_deg / cuts.last->bevel->angle_sigma_deg, 2) / kEnds;
  }
  EXPECT_LT(std::sqrt(square), 2.2);
}

TEST(EndEdge, ABevelIsFoundBesideMixedPixels) {
  std::mt19937_64 random(1);
  constexpr double kRadiusOfTubeMm = 6;
  int found = 0;
  for (int i = 0; i < 24; ++i) {
    SCOPED_TRACE(i);
    const double bevel_mm = tests::Uniform(random, 0.7, 1.0);
    const double depth_mm = tests::Uniform(random, 0.9, 1.1);
    const auto points = BevelledCloud(kRadiusOfTubeMm, {bevel_mm, depth_mm}, random);
    const EndCuts cuts = EndOf(points, kRadiusOfTubeMm, 0.02).cuts;
    ASSERT_TRUE(cuts.last);
    if (!cuts.last->bevel) continue;
    found += 1;
    EXPECT_NEAR(cuts.last->bevel->depth_mm, depth_mm, 0.15);
  }
  EXPECT_EQ(found, 24);
}

// A bevel that is hardly deeper than the noise: told or not, the tube goes on to its tip, where the
// face of the cut lies. Ends were up to 7 of their sigmas short.
TEST(EndEdge, AnEndThatMayBeBevelledIsWhereItsFaceLies) {
  std::mt19937_64 random(7);
  constexpr int kEnds = 48;
  double square = 0;
  for (int i = 0; i < kEnds; ++i) {
    SCOPED_TRACE(i);
    const double noise_mm = tests::Uniform(random, 0.03, 0.06);
    const double bevel_mm = tests::Uniform(random, 0.3, 0.7);
    const double depth_mm = bevel_mm * tests::Uniform(random, 0.7, 1.0);
    const auto points = BevelledCloud(5.0, {bevel_mm, depth_mm, noise_mm, 0}, random);
    const CloudEnd end = EndOf(points, 5.0, noise_mm);
    ASSERT_TRUE(end.cuts.last);
    EXPECT_NEAR(end.at_mm, 60 + bevel_mm, 4 * end.sigma_mm);
    EXPECT_NEAR(end.at_mm, 60 + bevel_mm, 0.1);
    square += std::pow((end.at_mm - 60 - bevel_mm) / end.sigma_mm, 2) / kEnds;
  }
  EXPECT_LT(square, 1.3 * 1.3);
}

// The outer wall alone, and a bevel that is seen by too few samples to tell of it: they are the
// tube's all the same. Ends were 6 of their sigmas short, rms.
TEST(EndEdge, AFewSamplesBeyondTheBorderAreOfTheTube) {
  std::mt19937_64 random(11);
  constexpr int kEnds = 48;
  constexpr double kRadiusOfTubeMm = 8, kNoiseMm = 0.04;
  double square = 0;
  int untold = 0;
  for (int i = 0; i < kEnds; ++i) {
    SCOPED_TRACE(i);
    const double bevel_mm = tests::Uniform(random, 0.8, 1.8);
    const Bevelled bevel{bevel_mm, bevel_mm * tests::Uniform(random, 0.5, 1.0),
                         kNoiseMm, 0,
                         0,        tests::Uniform(random, 0.3, 0.6),
                         1.0};
    const CloudEnd end =
        EndOf(BevelledCloud(kRadiusOfTubeMm, bevel, random), kRadiusOfTubeMm, kNoiseMm);
    ASSERT_TRUE(end.cuts.last);
    untold += end.cuts.last->bevel ? 0 : 1;
    EXPECT_NEAR(end.at_mm, 60 + bevel_mm, 5 * end.sigma_mm);
    EXPECT_LT(end.sigma_mm, 0.6);
    square += std::pow((end.at_mm - 60 - bevel_mm) / end.sigma_mm, 2) / kEnds;
  }
  EXPECT_GT(untold, kEnds / 4);
  EXPECT_LT(std::sqrt(square), 1.5);
}

// Over the troughs of a lasered end the bore is seen behind its crests, as far as these go: that is
// no face beyond the border. Ends were as much too long as their waves are high.
TEST(EndEdge, TheBoreInAWavyEndIsNoFaceBeyondIt) {
  std::mt19937_64 random(9);
  constexpr double kRadiusOfTubeMm = 6, kThickMm = 1.5, kNoiseMm = 0.02, kEndMm = 60;
  std::normal_distribution<double> noise(0, kNoiseMm);
  for (const double wave_mm : {1.5, 2.5}) {
    SCOPED_TRACE(wave_mm);
    std::vector<Eigen::Vector3d> points;
    for (int i = 0; i < 22'000; ++i) {
      const double around = tests::Uniform(random, -std::numbers::pi, std::numbers::pi);
      const double border_mm = kEndMm + wave_mm * std::cos(2 * around);
      const bool is_bore = i % 8 == 0;
      const double along_mm = kEndMm + (is_bore ? tests::Uniform(random, 0.6 * wave_mm, wave_mm)
                                                : tests::Uniform(random, -kEndMm, wave_mm));
      if (along_mm > border_mm) continue;
      const double out_mm = kRadiusOfTubeMm - (is_bore ? kThickMm : 0) + noise(random);
      points.emplace_back(along_mm, out_mm * std::cos(around), out_mm * std::sin(around));
    }
    const CloudEnd end = EndOf(points, kRadiusOfTubeMm, kNoiseMm);
    ASSERT_TRUE(end.cuts.last);
    EXPECT_FALSE(end.cuts.last->border.empty());
    EXPECT_NEAR(end.at_mm, kEndMm, 4 * end.sigma_mm);
    EXPECT_LT(end.sigma_mm, 0.2);
  }
}

// Noise in all directions moves samples of the face of a square cut, half of them beyond it: ends
// were 11 of their sigmas too long.
TEST(EndEdge, AnEndWhoseFaceIsSeenIsWhereItWasCut) {
  std::mt19937_64 random(4);
  double square = 0;
  constexpr int kEnds = 32;
  for (int i = 0; i < kEnds; ++i) {
    SCOPED_TRACE(i);
    const double noise_mm = tests::Uniform(random, 0.02, 0.08);
    auto points = BevelledCloud(6.0, {0, 0, noise_mm, 0, 1.5}, random);
    std::normal_distribution<double> along(0, noise_mm);
    for (Eigen::Vector3d& point : points) point.x() += along(random);
    const CloudEnd end = EndOf(points, 6.0, noise_mm);
    const double off = (end.at_mm - 60) / end.sigma_mm;
    EXPECT_LT(std::abs(off), 6);
    square += off * off;
  }
  EXPECT_LT(std::sqrt(square / kEnds), 2.5);
}

TEST(EndEdge, ABurrIsToldWhereItStandsOut) {
  for (std::uint64_t seed = 1; seed <= 4; ++seed) {
    SCOPED_TRACE(seed);
    hal::TubeFeatures features;
    features.first_edge.burr_mm = 0.25 + 0.1 * static_cast<double>(seed % 2);
    features.first_edge.burr_length_mm = 1.2;
    const EdgeScan scan = ScanEdges(seed, features);
    for (const bool first : {true, false}) {
      const hal::EndEdge& truth = first ? scan.truth.first_edge : scan.truth.last_edge;
      const auto& end = first ? scan.measured.features.first_end : scan.measured.features.last_end;
      ASSERT_TRUE(end);
      ASSERT_EQ(end->burr.has_value(), truth.burr_mm > 0);
      if (!end->burr) continue;
      // The highest of all sectors: a few sigma above by chance.
      EXPECT_GT(end->burr->height_mm, truth.burr_mm - 3 * end->burr->sigma_mm);
      EXPECT_LT(end->burr->height_mm, truth.burr_mm + 0.05);
      EXPECT_GT(end->burr->part, 0.8);
    }
  }
}

TEST(EndEdge, ABurrIsAsHighAsItIsWhateverItsLength) {
  for (std::uint64_t seed = 1; seed <= 8; ++seed) {
    SCOPED_TRACE(seed);
    hal::TubeFeatures features;
    features.first_edge.burr_mm = 0.5;
    features.first_edge.burr_length_mm = 0.8 + 0.13 * static_cast<double>(seed);
    const EdgeScan scan = ScanEdges(seed, features);
    const bool is_first = scan.truth.first_edge.burr_mm > 0;
    const auto& end = is_first ? scan.measured.features.first_end : scan.measured.features.last_end;
    ASSERT_TRUE(end && end->burr);
    EXPECT_NEAR(end->burr->height_mm, 0.5, 3 * end->burr->sigma_mm);
  }
}

// A saw or a die rolls a lip up: it rises the more the nearer to its tip. Heights were told too
// low, as if all burrs rose evenly.
TEST(EndEdge, ABurrIsAsHighAsItsTipHoweverItRises) {
  constexpr double kRadiusOfTubeMm = 6, kEndMm = 60, kNoiseMm = 0.02;
  std::mt19937_64 random(13);
  std::normal_distribution<double> noise(0, kNoiseMm);
  for (const double rise : {1.0, 2.0, 3.0}) {
    SCOPED_TRACE(rise);
    double square = 0;
    constexpr int kEnds = 8;
    for (int i = 0; i < kEnds; ++i) {
      const double height_mm = tests::Uniform(random, 0.3, 0.45);
      const double lip_mm = tests::Uniform(random, 0.9, 1.7);
      std::vector<Eigen::Vector3d> points;
      for (int k = 0; k < 25'000; ++k) {
        const double around = tests::Uniform(random, -std::numbers::pi, std::numbers::pi);
        const double along_mm = kEndMm * tests::Uniform(random, 0, 1);
        const double on_lip = std::max(0.0, 1 - (kEndMm - along_mm) / lip_mm);
        const double off_mm = height_mm * (0.7 + 0.3 * std::cos(around)) * std::pow(on_lip, rise);
        const double out_mm = kRadiusOfTubeMm + off_mm + noise(random);
        points.emplace_back(along_mm, out_mm * std::cos(around), out_mm * std::sin(around));
      }
      const auto end = EndOf(points, kRadiusOfTubeMm, kNoiseMm).cuts.last;
      ASSERT_TRUE(end && end->burr);
      const double off = (end->burr->height_mm - height_mm) / end->burr->sigma_mm;
      EXPECT_LT(std::abs(off), 4.0);
      square += off * off / kEnds;
    }
    EXPECT_LT(std::sqrt(square), 1.8);
  }
}

// A wall that is widened by a fifth of its radius and more, all round.
TEST(EndEdge, AFlareIsNoBurr) {
  for (std::uint64_t seed = 1; seed <= 4; ++seed) {
    SCOPED_TRACE(seed);
    hal::TubeFeatures features;
    features.first_edge.burr_mm = 1.7 + 0.15 * static_cast<double>(seed);
    features.first_edge.burr_length_mm = 2.5;
    const EdgeScan scan = ScanEdges(seed, features);
    const bool is_first = scan.truth.first_edge.burr_mm > 0;
    const auto& found = scan.measured.features;
    const auto& flared = is_first ? found.first_end : found.last_end;
    const auto& plain = is_first ? found.last_end : found.first_end;
    EXPECT_FALSE(flared && flared->burr);
    EXPECT_GT((is_first ? scan.measured.first_end : scan.measured.last_end).length_mm, 1.5);
    ASSERT_TRUE(plain);
    EXPECT_FALSE(plain->burr);
  }
}

// A tool tears a burr; what stands out evenly all round was made.
TEST(EndEdge, ASmallFlareIsNoBurrEither) {
  for (std::uint64_t seed = 1; seed <= 4; ++seed) {
    SCOPED_TRACE(seed);
    hal::TubeFeatures features;
    features.first_edge.burr_mm = 0.7 + 0.2 * static_cast<double>(seed);
    features.first_edge.burr_length_mm = features.first_edge.burr_mm;
    const EdgeScan scan = ScanEdges(seed, features);
    const bool is_first = scan.truth.first_edge.burr_mm > 0;
    const auto& found = scan.measured.features;
    const auto& flared = is_first ? found.first_end : found.last_end;
    EXPECT_FALSE(flared && flared->burr);
    EXPECT_FALSE((is_first ? scan.measured.first_end : scan.measured.last_end).profile.empty());
    // It is the tube's: the end is its tip.
    const auto& rows = scan.measured.tube.program.rows;
    EXPECT_NEAR((is_first ? rows.front() : rows.back()).length_mm, scan.true_length_mm(is_first),
                0.2);
  }
}

// A small flare is the tube's: of a cloud, too, the end is its tip and not where the wall opens.
TEST(EndEdge, AFlaredEndIsItsTip) {
  std::mt19937_64 random(3);
  for (int i = 0; i < 24; ++i) {
    SCOPED_TRACE(i);
    const double noise_mm = tests::Uniform(random, 0.02, 0.05);
    const double high_mm = tests::Uniform(random, 0.5, 0.8);
    const double long_mm = high_mm * tests::Uniform(random, 1.0, 1.7);
    auto points = BevelledCloud(5.0, {long_mm, -high_mm, noise_mm, 0, 0}, random);
    // Laser lines across the tube, which nobody tells of a cloud.
    constexpr double kLinesMm = 0.4;
    const double first_mm = tests::Uniform(random, 0, kLinesMm);
    for (Eigen::Vector3d& point : points) {
      point.x() = first_mm + kLinesMm * std::floor((point.x() - first_mm) / kLinesMm);
    }
    EXPECT_NEAR(EndOf(points, 5.0, noise_mm).at_mm, 60 + long_mm, kLinesMm);
  }
}

TEST(EndEdge, ABorderThatNoPlaneIsIsACurve) {
  EdgeErrors border("border"), length("length");
  for (std::uint64_t seed = 1; seed <= 6; ++seed) {
    SCOPED_TRACE(seed);
    hal::TubeFeatures features;
    features.first_edge.wave_mm = 0.6 + 0.3 * static_cast<double>(seed);
    features.first_edge.waves = 2 + static_cast<int>(seed % 3);
    features.first_edge.wave_around_deg = 40.0 * static_cast<double>(seed);
    const EdgeScan scan = ScanEdges(seed, features);
    for (const bool first : {true, false}) {
      const hal::EndEdge& truth = first ? scan.truth.first_edge : scan.truth.last_edge;
      const auto& end = first ? scan.measured.features.first_end : scan.measured.features.last_end;
      ASSERT_TRUE(end);
      ASSERT_EQ(!end->border.empty(), truth.waves > 0);
      const auto& rows = scan.measured.tube.program.rows;
      const auto& sigmas = scan.measured.sigma.rows;
      length.Add((first ? rows.front() : rows.back()).length_mm - scan.true_length_mm(first),
                 (first ? sigmas.front() : sigmas.back()).length_mm);
      for (const BorderPlace& place : end->border) {
        const double turn = (place.around_deg - truth.wave_around_deg) * hal::kRadiansPerDegree;
        border.Add(place.beyond_mm - truth.wave_mm * std::cos(truth.waves * turn), place.sigma_mm);
        EXPECT_LT(place.sigma_mm, 0.1);
      }
    }
  }
}

TEST(EndEdge, APlainEndHasNone) {
  for (std::uint64_t seed = 1; seed <= 6; ++seed) {
    SCOPED_TRACE(seed);
    hal::TubeFeatures features;
    features.first_end = {3.0 * static_cast<double>(seed), 30.0 * static_cast<double>(seed)};
    const EdgeScan scan = ScanEdges(seed, features, 0.01 * static_cast<double>(seed));
    for (const auto* end : {&scan.measured.features.first_end, &scan.measured.features.last_end}) {
      ASSERT_TRUE(*end);
      EXPECT_FALSE((*end)->bevel);
      EXPECT_FALSE((*end)->burr);
      EXPECT_TRUE((*end)->border.empty());
    }
  }
}

}  // namespace
}  // namespace bendloop::pipeline
