// SPDX-License-Identifier: Apache-2.0
#include "pipeline/features/unrolled_wall.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <optional>
#include <random>

#include "hal/spine.h"
#include "hal/tube.h"
#include "hal/tube_features.h"
#include "tests/support/uniform.h"

namespace bendloop::pipeline {
namespace {

using tests::Uniform;

constexpr double kPipeMm = 5;

hal::Tube OneBend(double bend_radius_mm) {
  return {kPipeMm, {{{40, 0, 90, bend_radius_mm}, {40, 0, 0, std::nullopt}}}, {}};
}

TEST(UnrolledWall, GoesAlongTheWallAndBack) {
  const hal::Tube tube = OneBend(12);
  const auto segments = hal::SpineSegments(tube.program, tube.X_WT);
  std::mt19937_64 random(3);
  for (int i = 0; i < 200; ++i) {
    const double frame_mm = Uniform(random, 20, 80), around_mm = Uniform(random, -10, 10);
    const UnrolledWall wall(segments, hal::FrameAt(segments, frame_mm, Uniform(random, -180, 180)),
                            kPipeMm);
    const double spine_mm = frame_mm + Uniform(random, -12, 12);
    const double along_mm = wall.AlongWallMm({spine_mm, around_mm}, frame_mm);
    EXPECT_NEAR(wall.SpineAtMm(along_mm, around_mm, frame_mm), spine_mm, 1e-6);
  }
}

// Inside of a bend, outside, and beside it: by its radius over the spine's.
TEST(UnrolledWall, IsShorterInsideABend) {
  const hal::Tube tube = OneBend(12);
  const auto segments = hal::SpineSegments(tube.program, tube.X_WT);
  const double middle_mm = 40 + 0.25 * std::numbers::pi * 12;
  for (const double around_deg : {-90.0, 0.0, 90.0}) {  // from the bend's axis: -90 is inside
    const UnrolledWall wall(segments, hal::FrameAt(segments, middle_mm, around_deg), kPipeMm);
    const double part = 1 + kPipeMm / 12 * std::sin(around_deg * std::numbers::pi / 180);
    EXPECT_NEAR(wall.AlongWallMm({middle_mm + 4, 0}, middle_mm), 4 * part, 1e-9);
  }
}

// There is no wall inside a bend that is as tight as the pipe, and no place on it.
TEST(UnrolledWall, EndsInsideABendAsTightAsThePipe) {
  const hal::Tube tube = OneBend(0.999 * kPipeMm);
  const auto segments = hal::SpineSegments(tube.program, tube.X_WT);
  const UnrolledWall wall(segments, hal::FrameAt(segments, 43, -90), kPipeMm);
  EXPECT_LE(std::abs(wall.SpineAtMm(6, 0, 43) - 43), 3 * 6 + kPipeMm);
}

}  // namespace
}  // namespace bendloop::pipeline
