// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/sunk_ends.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include "hal/spine.h"
#include "pipeline/reconstruction.h"
#include "tests/support/synthetic_cloud.h"
#include "tests/unit/fit/three_bends.h"

namespace bendloop::pipeline {
namespace {

using tests::Points;
using tests::Random;

// As deep all along a bend, and running out over half a pipe radius beyond its ends.
void SinkOuterWalls(const hal::Tube& tube, double depth_mm, Points& points) {
  const auto segments = hal::SpineSegments(tube.program, tube.X_WT);
  const double r_mm = tube.pipe_radius_mm, fade_mm = 0.5 * r_mm;
  for (Eigen::Vector3d& point : points) {
    for (std::size_t k = 1; k < segments.size(); k += 2) {
      const hal::SpineSegment& bend = segments[k];
      // Along the bend, or the line on from its end.
      const Eigen::Vector3d from = bend.axes().transpose() * (point - bend.center_mm());
      double along_mm = bend.bend_radius_mm * std::atan2(from.x(), -from.y());
      if (std::abs(along_mm) > 3.0 * bend.length_mm) continue;
      along_mm = std::clamp(along_mm, 0.0, bend.length_mm);
      const Eigen::Vector3d foot = bend.PointAt(along_mm), tangent = bend.TangentAt(along_mm);
      const double beyond_mm = std::abs((point - foot).dot(tangent));
      const Eigen::Vector3d out = point - foot - (point - foot).dot(tangent) * tangent;
      if (beyond_mm > fade_mm || out.norm() > 1.5 * r_mm) continue;
      const double c = out.normalized().dot((foot - bend.center_mm()).normalized());
      const double part = 0.5 + 0.5 * std::cos(std::numbers::pi * beyond_mm / fade_mm);
      point -= depth_mm * part * std::pow(std::max(0.0, c), 2) * out.normalized();
      break;
    }
  }
}

// Their spines seem to ease: lengths were too long and radii too small, up to nine of their sigmas.
TEST(SunkEnds, DoNotMakeABendEase) {
  double squares = 0, values = 0;
  for (unsigned seed = 1; seed <= 6; ++seed) {
    SCOPED_TRACE(seed);
    Random random(seed);
    const hal::Tube tube = FiveBends();
    Points points = tests::SyntheticCloud(tube, {.points = 30'000, .noise_mm = 0.04}, random);
    SinkOuterWalls(tube, 0.15 + 0.03 * seed, points);
    const auto found = Reconstruct(points, {}, kClock);
    ASSERT_TRUE(found) << found.error().message;
    ASSERT_EQ(found->tube.program.bend_count(), 5U);
    const bool reversed = std::abs(found->tube.program.rows[0].angle_deg - 61) > 10;
    for (std::size_t i = 0; i < 5; ++i) {
      const std::size_t j = reversed ? 4 - i : i;
      const hal::BendRow &row = found->tube.program.rows[j], &sigma = found->sigma.rows[j];
      const double off = (*row.bend_radius_mm - 19.7) / *sigma.bend_radius_mm;
      EXPECT_LT(std::abs(off), 7);
      squares += off * off;
      values += 1;
    }
  }
  EXPECT_LT(std::sqrt(squares / values), 1.8);
}

}  // namespace
}  // namespace bendloop::pipeline
