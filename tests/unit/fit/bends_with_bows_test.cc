// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/bends_with_bows.h"

#include <gtest/gtest.h>

#include <vector>

#include "pipeline/tube/representations.h"
#include "tests/support/real_tube.h"
#include "tests/unit/fit/three_bends.h"

namespace bendloop::pipeline {
namespace {

class BendsWithBows : public testing::Test {
 protected:
  // `bow`: of its straights.
  BendsWithBows() {
    std::mt19937_64 random(3);
    cloud_ = tests::ScanRealTube(ThreeBends(), {.bow = 1.0 / 500}, {.points = 12'000}, random);
    blocks_ = {{Eigen::Vector3d::Zero(), 1e3, cloud_.points_W}};
  }
  // Begun from these corners.
  std::size_t BendsFrom(const ControlPolygon& corners, std::optional<std::size_t> nominal) {
    auto tube = TubeFromPolygon(corners);
    EXPECT_TRUE(tube);
    if (!tube) return 0;
    tube->pipe_radius_mm = 5;
    BowedSolution solution = SolveWithBows(*tube, blocks_, options_);
    ReviseBends(blocks_, options_, nominal, solution);
    return solution.fit.tube.program.bend_count();
  }

  tests::RealCloud cloud_;
  std::vector<PointBlock> blocks_;
  SurfaceFitOptions options_{.reach_mm = 1};
};

TEST_F(BendsWithBows, TwoBendsForOneBecomeOne) {
  ControlPolygon corners = *PolygonFromTube(ThreeBends());
  const Eigen::Vector3d at = corners.points_mm[3];
  corners.points_mm[3] = at + 5 * (corners.points_mm[2] - at).normalized();
  corners.points_mm.insert(corners.points_mm.begin() + 4,
                           at + 5 * (corners.points_mm[4] - at).normalized());
  corners.bend_radii_mm[2] = 6;
  corners.bend_radii_mm.emplace_back(6);
  EXPECT_EQ(BendsFrom(corners, std::nullopt), 3U);
  EXPECT_EQ(BendsFrom(corners, 3), 3U);
}

TEST_F(BendsWithBows, ThoseThatWereMadeStay) {
  const ControlPolygon corners = *PolygonFromTube(ThreeBends());
  EXPECT_EQ(BendsFrom(corners, std::nullopt), 3U);
}

}  // namespace
}  // namespace bendloop::pipeline
