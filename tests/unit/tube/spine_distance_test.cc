// SPDX-License-Identifier: Apache-2.0
#include "pipeline/tube/spine_distance.h"

#include <gtest/gtest.h>

#include "tests/support/synthetic_tube.h"

namespace bendloop::pipeline {
namespace {

// Against the nearest of many points along the spine, arcs beyond a half turn included.
TEST(SpineDistance, AgreesWithADenselySampledSpine) {
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    support::Rng rng(seed);
    hal::BendProgram program = support::RandomProgram(rng, 4);
    program.rows[1].angle_deg = support::Uniform(rng, 180, 330);
    const auto segments = hal::SpineSegments(program, support::RandomPose(rng));
    std::vector<Eigen::Vector3d> spine;
    for (const hal::SpineSegment& segment : segments) {
      for (int i = 0; i <= 2000; ++i)
        spine.push_back(segment.PointAt(segment.length_mm * i / 2000));
    }
    const SpineDistance distance(segments, 0.0);
    for (int i = 0; i < 20; ++i) {
      const Eigen::Vector3d near = spine[rng() % spine.size()];
      const Eigen::Vector3d point =
          near + Eigen::Vector3d(support::Gauss(rng, 20), support::Gauss(rng, 20),
                                 support::Gauss(rng, 20));
      double nearest = 1e9;
      for (const Eigen::Vector3d& p : spine) nearest = std::min(nearest, (p - point).norm());
      EXPECT_NEAR(distance(point), nearest, 0.01);
      EXPECT_LE(distance(point), nearest + 1e-9);
    }
  }
}

TEST(SpineDistance, ExtendsTheEndsAsTold) {
  const auto segments = hal::SpineSegments({{{100, 0, 0, std::nullopt}}}, {});
  EXPECT_NEAR(SpineDistance(segments, 0)({-5, 3, 0}), std::hypot(5, 3), 1e-12);
  EXPECT_NEAR(SpineDistance(segments, 10)({-5, 3, 0}), 3, 1e-12);
  EXPECT_NEAR(SpineDistance(segments, 10)({108, 0, 4}), 4, 1e-12);
}

}  // namespace
}  // namespace bendloop::pipeline
