// SPDX-License-Identifier: Apache-2.0
#include "pipeline/features/dents.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>
#include <vector>

#include "hal/angles.h"
#include "hal/spine.h"
#include "hal/tube_features.h"
#include "tests/support/cut_walls.h"

namespace bendloop::pipeline {
namespace {

using tests::Uniform;

// A dent that is as wide along the surface as around it, in a bend of 90 degrees: inside it the
// surface is shorter than the spine, outside longer. Areas were those of the unrolled wall.
TEST(Dents, AreasInBendsAreThoseOfTheSurface) {
  constexpr double kRadiusMm = 8, kNoiseMm = 0.02, kDeepMm = 0.6, kWideMm = 2;
  const hal::Tube tube{kRadiusMm, {{{40, 0, 90, 24.0}, {40, 0, 0, std::nullopt}}}, {}};
  const auto segments = hal::SpineSegments(tube.program, tube.X_WT);
  const double middle_mm = 40 + 0.25 * std::numbers::pi * 24;
  const double area_mm2 = 2 * std::numbers::pi * std::numbers::ln2 * kWideMm * kWideMm;
  std::mt19937_64 random(7);
  for (const double around_deg : {0.0, 90.0, 180.0, 270.0}) {
    SCOPED_TRACE(around_deg);
    const hal::SurfaceFrame dented = hal::FrameAt(segments, middle_mm, around_deg);
    const Eigen::Vector3d at_mm = dented.spine_mm + kRadiusMm * dented.outward;
    const Eigen::Vector3d inwards = (segments[1].center_mm() - dented.spine_mm).normalized();
    const double stretch = 1 - kRadiusMm / 24 * dented.outward.dot(inwards);
    std::normal_distribution<double> noise(0, kNoiseMm);
    std::vector<Eigen::Vector3d> points;
    for (int i = 0; i < 40'000; ++i) {
      const double along_mm = middle_mm + Uniform(random, -16, 16);
      const double off_deg = Uniform(random, -90, 90);
      const hal::SurfaceFrame frame = hal::FrameAt(segments, along_mm, around_deg + off_deg);
      const double along = stretch * (along_mm - middle_mm);
      const double around = kRadiusMm * off_deg / hal::kDegreesPerRadian;
      const double q = (along * along + around * around) / (kWideMm * kWideMm);
      points.push_back(frame.spine_mm +
                       (kRadiusMm + noise(random) - kDeepMm * std::exp(-0.5 * q)) * frame.outward);
    }
    const std::vector<PointBlock> blocks = {{at_mm, 40, points}};
    DentFound seen;
    seen.position_mm = at_mm, seen.depth_mm = 0.7 * kDeepMm, seen.size_mm = 5;
    std::vector<DentFound> dents = {seen};
    MeasureDents(tube, {{}, {}}, {}, CutFaces(tube, {}), kNoiseMm, blocks, dents);
    ASSERT_EQ(dents.size(), 1U);
    EXPECT_NEAR(dents[0].area_mm2, area_mm2, 4 * dents[0].area_sigma_mm2);
    EXPECT_LT(dents[0].area_sigma_mm2, 0.05 * area_mm2);
  }
}

}  // namespace
}  // namespace bendloop::pipeline
