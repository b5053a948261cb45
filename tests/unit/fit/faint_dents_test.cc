// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/faint_dents.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <vector>

#include "pipeline/reconstruction.h"
#include "tests/support/error_sigmas.h"
#include "tests/support/real_tube.h"
#include "tests/unit/fit/three_bends.h"

namespace bendloop::pipeline {
namespace {

// Shallow ones, in the middle of a bend and as wide, or beside it. Now and then all of a bend is
// left out with one: then its radius is not known.
TEST(FaintDents, OfABendAreNotItsRadius) {
  tests::ErrorSigmas radii;
  int hidden = 0;
  for (const double along : {0.2205, 0.235, 0.498, 0.736}) {
    for (const double around : {-0.9, 0.0, 0.2, 2.8}) {
      SCOPED_TRACE(testing::Message() << along << ' ' << around);
      std::mt19937_64 random(17);
      const tests::Form form{
          .dents = {{.along = along, .around_rad = around, .depth_r = 0.036, .width_r = 0.9}}};
      const auto cloud = tests::ScanRealTube(ThreeBends(), form, {}, random);
      const auto found = Reconstruct(cloud.points_W, {}, kClock);
      ASSERT_TRUE(found) << found.error().message;
      if (found->tube.program.bend_count() != 3U) {
        EXPECT_FALSE(found->warnings.empty());
        continue;
      }
      const bool reversed = std::abs(found->tube.program.rows[0].angle_deg - 60) > 5;
      for (std::size_t i = 0; i < 3; ++i) {
        SCOPED_TRACE(i);
        const std::size_t k = reversed ? 2 - i : i;
        const auto &is = found->tube.program.rows[k], &was = cloud.truth.program.rows[i];
        const double sigma_mm = *found->sigma.rows[k].bend_radius_mm;
        radii.Add(*is.bend_radius_mm - *was.bend_radius_mm, sigma_mm);
        // The slight one may be all dent.
        hidden += i != 1 && sigma_mm > 1.3 ? 1 : 0;
      }
    }
  }
  EXPECT_GT(radii.count(), 40);
  EXPECT_LT(radii.rms(), 1.4);
  EXPECT_LT(radii.greatest(), 5);
  EXPECT_LT(hidden, 4);
}

}  // namespace
}  // namespace bendloop::pipeline
