// SPDX-License-Identifier: Apache-2.0
#include "pipeline/tube/alignment.h"

#include <gtest/gtest.h>

#include "tests/support/synthetic_tube.h"

namespace bendloop::pipeline {
namespace {

TEST(Alignment, FindsThePoseOfATubeInTheWorld) {
  for (std::uint64_t seed = 1; seed <= 50; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    support::Rng rng(seed);
    const hal::BendProgram program =
        support::RandomProgram(rng, static_cast<int>(seed % 7));  // straight tubes too
    const hal::Tube tube{8, program, support::RandomPose(rng)};
    const Alignment alignment = AlignTubes(program, tube);
    EXPECT_NEAR(alignment.rms_mm, 0, 1e-9);
    const auto knots_N = Knots(program, {});
    const auto knots_W = Knots(program, tube.X_WT);
    ASSERT_EQ(knots_N.size(), 2 * program.rows.size());
    for (std::size_t i = 0; i < knots_N.size(); ++i) {
      EXPECT_LT((alignment.X_NW * knots_W[i] - knots_N[i]).norm(), 1e-8);
    }
  }
}

TEST(Alignment, NeverReflects) {
  support::Rng rng(3);
  hal::BendProgram program = support::RandomProgram(rng, 4);
  hal::Tube mirrored{8, program, {}};
  for (hal::BendRow& row : mirrored.program.rows) row.rotation_deg = -row.rotation_deg;
  const Alignment alignment = AlignTubes(program, mirrored);
  EXPECT_NEAR(alignment.X_NW.orientation.toRotationMatrix().determinant(), 1, 1e-12);
  EXPECT_GT(alignment.rms_mm, 5);
}

TEST(Alignment, OfNothingIsTheIdentity) {
  const Alignment alignment = AlignTubes({}, {});
  EXPECT_EQ(alignment.X_NW.position_mm, Eigen::Vector3d::Zero());
  EXPECT_EQ(alignment.rms_mm, 0);
}

}  // namespace
}  // namespace bendloop::pipeline
