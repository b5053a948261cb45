// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>

#include "firmware-host/cloud/point_cloud.h"
#include "tests/property/reconstruction/scans.h"

namespace bendloop::tests {
namespace {

struct TubeScan {
  hal::Tube tube;
  Points points;
  double spacing_mm = 0;  // between samples, along the tube
};

// 1 to 8 bends, pipe radius 2 to 50 mm; every second one scattered, others in stripes; some from
// one side only, some with fliers.
TubeScan RandomScan(int seed) {
  Random random(static_cast<std::uint64_t>(1000 + seed));
  const double r = 2 * std::pow(25.0, Uniform(random, 0, 1));
  const int bends = 1 + seed % 8;
  TubeScan scan;
  scan.tube = RandomTube({.pipe_radius_mm = r,
                          .bends = bends,
                          .min_bend_radius = 2.5,
                          .max_bend_radius = 5,
                          .min_straight = 3.5,
                          .max_straight = 12,
                          .min_angle_deg = 20,
                          .max_angle_deg = 120},
                         random);
  const double length = hal::SpineLength(scan.tube.program);
  CloudOptions options;
  options.noise_mm = std::min(0.05, 0.015 * r);
  options.points = static_cast<std::size_t>(90 * length / r);
  scan.spacing_mm = 0.3 * r;
  if (seed % 2 == 1) {
    options.stripes_mm = 0.2 * r;
    options.points *= 2;
    // All stripes lie before their place, and so the tube ends up to one later than the last.
    scan.spacing_mm = options.stripes_mm;
  }
  if (seed % 3 == 1) options.view_W = RandomUnit(random);
  if (seed % 3 == 2) options.fliers = 0.02;
  scan.points = SyntheticCloud(scan.tube, options, random);
  return scan;
}

class RandomTubes : public testing::TestWithParam<int> {};

TEST_P(RandomTubes, AreMeasuredWithinTheirSigma) {
  const TubeScan scan = RandomScan(GetParam());
  const auto found = Measure(scan.points);
  ASSERT_TRUE(found) << found.error().message;
  ExpectMeasured(*found, scan.tube, {.end_mm = scan.spacing_mm});
  EXPECT_GT(found->coverage, 0.9);
  EXPECT_GT(found->fit.samples, scan.points.size() / 2);
}

INSTANTIATE_TEST_SUITE_P(Seeds, RandomTubes, testing::Range(0, kSeeds));

// Arcs of more than half a turn, also two that follow each other.
TEST(Reconstruction, BendsBeyondAHalfTurn) {
  for (int seed = 0; seed < std::max(1, kSeeds / 4); ++seed) {
    Random random(static_cast<std::uint64_t>(50 + seed));
    const hal::Tube tube = RandomTube({.bends = 1 + seed % 3,
                                       .min_bend_radius = 3,
                                       .min_straight = 4,
                                       .max_straight = 12,
                                       .min_angle_deg = 190,
                                       .max_angle_deg = 240},
                                      random);
    const auto found = Measure(SyntheticCloud(tube, {.points = 12000}, random));
    ASSERT_TRUE(found) << "seed " << seed << ": " << found.error().message;
    SCOPED_TRACE(seed);
    ExpectMeasured(*found, tube, {.end_mm = 0.5});
  }
}

TEST(Reconstruction, AStraightTubeHasNoBend) {
  Random random(60);
  hal::Tube tube;
  tube.pipe_radius_mm = 6;
  tube.program.rows = {{180, 0, 0, std::nullopt}};
  tube.X_WT = RandomPose(200, random);
  const auto found = Measure(SyntheticCloud(tube, {.points = 8000}, random));
  ASSERT_TRUE(found) << found.error().message;
  ASSERT_EQ(found->tube.program.rows.size(), 1U);
  EXPECT_NEAR(found->tube.program.rows[0].length_mm, 180, 0.5);
  EXPECT_NEAR(found->tube.pipe_radius_mm, 6, 0.02);
}

TEST(Reconstruction, ThePapersTube) {
  Random random(61);
  const auto found = Measure(SyntheticCloud(PaperTube(), {}, random));
  ASSERT_TRUE(found) << found.error().message;
  ExpectMeasured(*found, PaperTube(), {.end_mm = 0.6});
}

// A table below and a clamp around the tube, which also hides three radii of it.
TEST(Reconstruction, TableClampAndGapAddNoBends) {
  for (int seed = 0; seed < std::max(1, kSeeds / 4); ++seed) {
    Random random(static_cast<std::uint64_t>(70 + seed));
    hal::Tube tube = RandomTube({.pipe_radius_mm = 5,
                                 .bends = 2 + seed % 3,
                                 .min_straight = 8,
                                 .max_straight = 15,
                                 .min_angle_deg = 30,
                                 .max_angle_deg = 100},
                                random);
    const double r = tube.pipe_radius_mm;
    const auto segments = hal::SpineSegments(tube.program, tube.X_WT);
    const auto& held = segments[2];  // between the first two bends
    const Eigen::Vector3d clamp = held.PointAt(0.5 * held.length_mm);
    Points points;
    double lowest = 1e30;
    for (const Eigen::Vector3d& p : SyntheticCloud(tube, {.points = 9000}, random)) {
      lowest = std::min(lowest, p.z());
      const bool hidden =
          (p - clamp).norm() < 4 * r && std::abs((p - clamp).dot(held.tangent)) < 1.5 * r;
      if (!hidden) points.push_back(p);
    }
    const Points bare = points;
    for (int i = 0; i < 4000; ++i) {
      points.emplace_back(tube.X_WT.position_mm.x() + Uniform(random, -150, 150),
                          tube.X_WT.position_mm.y() + Uniform(random, -150, 150),
                          lowest - 2 * r + Uniform(random, -0.05, 0.05));
    }
    Points with_table = points;
    std::shuffle(with_table.begin(), with_table.end(), random);
    // The clamp's two faces across the tube, and its sides.
    for (int i = 0; i < 3000; ++i) {
      Eigen::Vector3d b(Uniform(random, -1.4, 1.4), Uniform(random, -3, 3), Uniform(random, -3, 3));
      const int side = i % 3;
      b[side] = (i % 2 == 0 ? 1 : -1) * (side == 0 ? 1.4 : 3.0);
      if (side == 0 && std::hypot(b.y(), b.z()) < 1) continue;  // the tube goes through
      points.push_back(clamp + r * (b.x() * held.tangent + b.y() * held.normal +
                                    b.z() * held.normal.cross(held.tangent)));
    }
    std::shuffle(points.begin(), points.end(), random);
    SCOPED_TRACE(seed);
    const auto gap_only = Measure(bare);
    ASSERT_TRUE(gap_only) << gap_only.error().message;
    ExpectMeasured(*gap_only, tube, {.end_mm = 0.8});
    EXPECT_GT(gap_only->longest_gap_mm, 1.4 * r);
    EXPECT_LT(gap_only->longest_gap_mm, 4.5 * r);
    const Floor floor{.length_mm = 0.1, .angle_deg = 0.1, .end_mm = 0.8};
    const auto on_table = Measure(with_table);
    ASSERT_TRUE(on_table) << on_table.error().message;
    ExpectMeasured(*on_table, tube, floor);
    // The long edges of a block as large as this may pass for another pipe: the nominal tells which
    // is meant, and without it a refusal is right and another number of bends is not.
    pipeline::ReconstructionOptions options;
    options.nominal = tube.program;
    const auto expected = Measure(points, options);
    ASSERT_TRUE(expected) << expected.error().message;
    ExpectMeasured(*expected, tube, floor);
    const auto found = Measure(points);
    if (found) {
      ExpectMeasured(*found, tube, floor);
    } else {
      EXPECT_THAT(found.error().message, testing::HasSubstr("two tubes"));
    }
  }
}

// Rough as it is, it is one tube of two bends or, where the ends of its ragged scan look bent,
// three.
TEST(Reconstruction, ARealCoil) {
  const auto cloud =
      host::ReadCloud(std::string(BENDLOOP_SOURCE_DIR) + "/tests/data/clouds/real-coil/coil.ply",
                      host::Units::kMetres);
  ASSERT_TRUE(cloud) << cloud.error().message;
  const auto found = Measure(cloud->points_mm);
  ASSERT_TRUE(found) << found.error().message;
  EXPECT_EQ(found->tube.program.bend_count(), 2U);
  EXPECT_NEAR(found->tube.pipe_radius_mm, 20.5, 1);
  // Its wall lies millimetres beside that of lines and arcs: what no view showed is no hole there.
  EXPECT_FALSE(found->features.is_known);
  EXPECT_TRUE(found->features.openings.empty());
  // The same numbers read as millimetres are a tube of a fiftieth of a millimetre.
  Points small = cloud->points_mm;
  for (Eigen::Vector3d& p : small) p *= 1e-3;
  const auto refused = Measure(small);
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().kind, hal::ErrorKind::kBadInput);
  EXPECT_THAT(refused.error().message, testing::HasSubstr("--units m"));
}

}  // namespace
}  // namespace bendloop::tests
