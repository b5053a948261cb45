// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/bowed_spine.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <vector>

#include "pipeline/fit/place_sums.h"
#include "tests/support/real_tube.h"
#include "tests/unit/fit/three_bends.h"

namespace bendloop::pipeline {
namespace {

// The surface is round where its spine leans, too: one that is cut across the straight is wider by
// slope^2 / 2, at L / 300 by a micrometre.
TEST(BowedSpine, PointsOfABowedStraightLieOnItsSurface) {
  constexpr double kLengthMm = 50, kRadiusMm = 5;
  Bow bow;
  bow.modes_mm << 0.1, -0.06, 0.03, 0.05, -0.02, 0.01;
  bow.middle = {-0.75, 0.75};
  SegmentPoints points;
  points.MakeRoom(1000);
  double leaning_mm = 0;
  for (int i = 0; i < 1000; ++i) {
    const double x = -0.9 + 1.8 * i / 1000.0, phi = 0.7 * i;
    const Eigen::Vector2d off_mm = bow.Beside(x), slope = 2.0 / kLengthMm * bow.SlopeAt(x);
    const Eigen::Vector3d along = Eigen::Vector3d(1, slope[0], slope[1]).normalized();
    const Eigen::Vector3d side = along.cross(Eigen::Vector3d::UnitZ()).normalized();
    const Eigen::Vector3d p =
        Eigen::Vector3d(0.5 * (x + 1) * kLengthMm, off_mm[0], off_mm[1]) +
        kRadiusMm * (std::cos(phi) * side + std::sin(phi) * along.cross(side));
    points.x[i] = p.x();
    points.y[i] = p.y();
    points.z[i] = p.z();
    points.distance[i] = 0;
    ++points.size;
    leaning_mm = std::max(leaning_mm, 0.5 * kRadiusMm * slope.squaredNorm());
  }
  hal::SpineSegment line;
  line.length_mm = kLengthMm;
  Straighten(bow, SegmentFrame(line, false, false), kLengthMm, kRadiusMm, points);
  EXPECT_GT(leaning_mm, 5e-4);
  for (int i = 0; i < 1000; ++i) EXPECT_NEAR(points.distance[i], 0, 0.03 * leaning_mm) << i;
}

// The shapes' lines are those of least squares over the middle, and slopes and curvatures what the
// shapes are.
TEST(BowShapes, HaveTheirBestFitLines) {
  const StraightMiddle middle{-0.8, 0.55};
  constexpr int kPlaces = 20'000;
  for (std::size_t s = 0; s < kBowShapes; ++s) {
    double off = 0, moment = 0, spread = 0;
    for (int i = 0; i < kPlaces; ++i) {
      const double x = middle.from + (i + 0.5) / kPlaces * (middle.to - middle.from);
      const double from_center = x - middle.center();
      off += BowShapesAt(x)[s].off / kPlaces;
      moment += from_center * BowShapesAt(x)[s].off;
      spread += from_center * from_center;
    }
    EXPECT_NEAR(BowLinesOf(middle)[s].off, off, 1e-6) << s;
    EXPECT_NEAR(BowLinesOf(middle)[s].slope, moment / spread, 1e-6) << s;
    const auto slope_at = [s](double x) { return BowShapesAt(x)[s].slope; };
    for (const double x : {-0.9, 0.1, 0.7}) {
      const double by = BowShapesAt(x + 1e-4)[s].off - BowShapesAt(x - 1e-4)[s].off;
      EXPECT_NEAR(slope_at(x), by / 2e-4, 1e-6) << s;
      EXPECT_NEAR(BowCurvaturesAt(x)[s], (slope_at(x + 1e-4) - slope_at(x - 1e-4)) / 2e-4, 1e-6)
          << s;
    }
    EXPECT_NEAR(BowLinesOf({})[s].slope, 0, 1e-12) << "no part of the whole straight's line";
    EXPECT_NEAR(BowLinesOf({})[s].off, 0, 1e-12);
  }
}

// A bow's best-fit line is that of a part of the straight: an end that is sought a tenth of a
// millimetre too early turns it.
TEST(BowedSpine, StraightsEndWherePointsDo) {
  std::mt19937_64 random(5);
  const hal::Tube tube = ThreeBends();
  const auto cloud = tests::ScanRealTube(tube, {}, {.points = 400'000, .noise_mm = 0.01}, random);
  const std::vector<PointBlock> blocks = {{Eigen::Vector3d::Zero(), 1e3, cloud.points_W}};
  BowedTubeState state{tube, {}, {}, {}};
  state.tube.program.rows.back().length_mm -= 3;
  state.tube.program.rows.front().length_mm += 3;
  state.tube.X_WT.position_mm -= 3 * (tube.X_WT.orientation * Eigen::Vector3d::UnitX());
  EndWithPoints(blocks, 1, {0, 0}, state);
  for (const std::size_t row : {std::size_t{0}, tube.program.rows.size() - 1}) {
    EXPECT_NEAR(state.tube.program.rows[row].length_mm, tube.program.rows[row].length_mm, 0.04);
  }
}

}  // namespace
}  // namespace bendloop::pipeline
