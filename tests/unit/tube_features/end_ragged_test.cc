// SPDX-License-Identifier: Apache-2.0
// Borders of scattered clouds that are torn all round, in waves of any length.
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>
#include <vector>

#include "hal/angles.h"
#include "hal/spine.h"
#include "hal/tube_features.h"
#include "pipeline/features/end_cut.h"
#include "pipeline/fit/tube_ends.h"
#include "tests/support/cut_walls.h"

namespace bendloop::pipeline {
namespace {

// An end whose border lies by `terms` beyond a square one, in waves of two turns and more.
struct RaggedEnd {
  double r_mm = 5, noise_mm = 0.02, per_mm2 = 3;
  std::vector<Eigen::Vector2d> terms_mm;

  double BeyondMm(double around_rad) const {
    double beyond_mm = 0;
    for (std::size_t i = 0; i < terms_mm.size(); ++i) {
      const double turns = static_cast<double>(i + 2) * around_rad;
      beyond_mm += terms_mm[i].dot(Eigen::Vector2d(std::cos(turns), std::sin(turns)));
    }
    return beyond_mm;
  }
};

RaggedEnd AnyRagged(std::mt19937_64& random, int turns) {
  RaggedEnd end;
  end.r_mm = tests::LogUniform(random, 4, 20);
  end.noise_mm = tests::LogUniform(random, 0.01, 0.08);
  end.per_mm2 = tests::LogUniform(random, 60, 1500) / (end.r_mm * end.r_mm);
  const double rms_mm = tests::Uniform(random, 0.03, 0.08) * end.r_mm;
  double square = 0;
  for (int k = 2; k <= turns; ++k) {
    end.terms_mm.emplace_back(tests::Uniform(random, -1, 1), tests::Uniform(random, -1, 1));
    square += 0.5 * end.terms_mm.back().squaredNorm();
  }
  for (Eigen::Vector2d& term : end.terms_mm) term *= rms_mm / std::sqrt(square);
  return end;
}

constexpr double kWallRadii = 12.0;  // long

std::vector<Eigen::Vector3d> CloudOf(const RaggedEnd& end, std::mt19937_64& random) {
  std::normal_distribution<double> noise(0, end.noise_mm);
  const double length_mm = (kWallRadii + 1) * end.r_mm;
  const double count = end.per_mm2 * 2 * std::numbers::pi * end.r_mm * length_mm;
  std::vector<Eigen::Vector3d> points;
  for (int i = 0; i < static_cast<int>(count); ++i) {
    const double x_mm = tests::Uniform(random, 0, length_mm);
    const double around = tests::Uniform(random, -std::numbers::pi, std::numbers::pi);
    // The angle is counted as FindEndCuts() does along x.
    if (x_mm > kWallRadii * end.r_mm + end.BeyondMm(around)) continue;
    const double out_mm = end.r_mm + noise(random);
    points.emplace_back(x_mm, out_mm * std::cos(around), out_mm * std::sin(around));
  }
  return points;
}

// How far the border lies beyond its plane at a place that is told of it, of a straight tube along
// x.
double TrueBeyondMm(const RaggedEnd& end, const hal::Tube& tube, double around_deg) {
  const auto segments = hal::SpineSegments(tube.program, tube.X_WT);
  const Eigen::Vector3d zero = hal::AroundZero(segments, 0),
                        quarter = Eigen::Vector3d::UnitX().cross(zero);
  const double around = around_deg * hal::kRadiansPerDegree;
  const Eigen::Vector3d out = std::cos(around) * zero + std::sin(around) * quarter;
  return end.BeyondMm(std::atan2(out.z(), out.y()));
}

TEST(EndRagged, IsAsLongAsThePlaneNearestToItAllRound) {
  std::mt19937_64 random(1);
  double square = 0, of_places = 0, places = 0;
  int curves = 0;
  constexpr int kEnds = 40;
  for (int i = 0; i < kEnds; ++i) {
    SCOPED_TRACE(i);
    const RaggedEnd end = AnyRagged(random, 3 + i % 12);
    const auto points = CloudOf(end, random);
    const hal::Tube tube{end.r_mm, {{{(kWallRadii + 0.4) * end.r_mm, 0, 0, std::nullopt}}}, {}};
    const std::vector<PointBlock> blocks = {
        {Eigen::Vector3d(6 * end.r_mm, 0, 0), 8 * end.r_mm, points}};
    TubeEnds ends = FindTubeEnds(tube, end.noise_mm, blocks);
    const EndCuts cuts = FindEndCuts(end.noise_mm, blocks, ends);
    ASSERT_TRUE(cuts.last);
    const double at_mm = ends.tube.X_WT.position_mm.x() + ends.tube.program.rows.back().length_mm;
    const double off = (at_mm - kWallRadii * end.r_mm) / ends.last_sigma_mm;
    EXPECT_LT(std::abs(off), 5);
    square += off * off;
    EXPECT_LT(cuts.last->cut.obliquity_deg, 5 * cuts.last->obliquity_sigma_deg);
    curves += cuts.last->border.empty() ? 0 : 1;
    for (const BorderPlace& place : cuts.last->border) {
      const double beside_mm = place.beyond_mm - TrueBeyondMm(end, tube, place.around_deg);
      of_places += std::pow(beside_mm / place.sigma_mm, 2);
      places += 1;
    }
  }
  EXPECT_LT(std::sqrt(square / kEnds), 1.5);
  EXPECT_GT(curves, kEnds / 2);
  EXPECT_LT(std::sqrt(of_places / places), 1.5);
}

}  // namespace
}  // namespace bendloop::pipeline
