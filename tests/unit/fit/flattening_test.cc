// SPDX-License-Identifier: Apache-2.0
#include "pipeline/tube/flattening.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "pipeline/fit/self_check.h"
#include "pipeline/fit/surface_fit.h"
#include "pipeline/reconstruction.h"
#include "pipeline/structure/structure_moves.h"
#include "tests/support/real_tube.h"
#include "tests/support/shapes.h"
#include "tests/unit/fit/three_bends.h"

namespace bendloop::pipeline {
namespace {

using tests::Points;
using tests::Random;
using tests::Uniform;

Points OvalCloud(const hal::Tube& tube, double ovality, bool one_view, Random& random) {
  tests::CloudOptions options{.points = 9000, .noise_mm = 0.03, .ovality = ovality};
  if (one_view) options.view_W = Eigen::Vector3d(0.2, 0.3, 0.93).normalized();
  return tests::SyntheticCloud(tube, options, random);
}

TEST(Flattening, OvalBendsAreMeasuredAndLeaveTheAnglesAlone) {
  for (unsigned seed = 1; seed <= 3; ++seed) {
    SCOPED_TRACE(seed);
    Random random(seed);
    hal::Tube tube = tests::PaperTube();
    tube.pipe_radius_mm = 8;
    for (hal::BendRow& row : tube.program.rows) {
      row.length_mm *= 2;
      if (row.bend_radius_mm) *row.bend_radius_mm *= 2;
    }
    const double ovality = Uniform(random, 0.02, 0.08);
    const auto found = Reconstruct(OvalCloud(tube, ovality, false, random), {}, kClock);
    ASSERT_TRUE(found) << found.error().message;
    ASSERT_EQ(found->tube.program.bend_count(), tube.program.bend_count());
    ASSERT_EQ(found->bend_shapes.size(), tube.program.bend_count());
    const bool reversed =
        std::abs(found->tube.program.rows[0].angle_deg - tube.program.rows[0].angle_deg) > 5;
    for (std::size_t i = 0; i < tube.program.bend_count(); ++i) {
      if (tube.program.rows[i].angle_deg < 30) continue;  // too short to tell its shape
      const std::size_t j = reversed ? tube.program.bend_count() - 1 - i : i;
      const BendShape& shape = found->bend_shapes[j];
      EXPECT_LT(std::abs(shape.ovality_percent - 100 * ovality),
                4 * shape.ovality_sigma_percent + 8 * ovality)  // a bump is not quite a sine
          << i << ": " << shape.ovality_percent;
      EXPECT_LT(std::abs(found->tube.program.rows[j].angle_deg - tube.program.rows[i].angle_deg),
                5 * found->sigma.rows[j].angle_deg);
    }
  }
}

TEST(Flattening, RoundBendsAreCalledRound) {
  for (unsigned seed = 1; seed <= 4; ++seed) {
    Random random(seed);
    const hal::Tube tube = tests::RandomTube({.bends = 3}, random);
    const auto found = Reconstruct(OvalCloud(tube, 0, seed % 2 == 0, random), {}, kClock);
    ASSERT_TRUE(found) << found.error().message;
    EXPECT_TRUE(found->bend_shapes.empty()) << seed;
    EXPECT_GT(found->structure_margin, 10) << seed;
    EXPECT_LT(found->halves_differ_sigma, 5) << seed;
  }
}

TEST(Flattening, TheOuterWallThatSinksInIsSeen) {
  Flattening flattening{.constant = 0.01, .bump = 0.03, .collapse = 0.015, .plateau = 0.005};
  EXPECT_DOUBLE_EQ(flattening.OvalityPart(), 0.05);
  EXPECT_DOUBLE_EQ(flattening.OuterWallPart(), 0.04);
}

// What an outer wall that sinks in all along a bend does to the spine at its ends looks like
// easing: it was told in 4 of these, with lengths too long and radii too small.
TEST(Flattening, AnOuterWallThatSinksInAllAlongIsNoEasing) {
  double squares = 0, values = 0;
  unsigned eased = 0;
  constexpr unsigned kScans = 8;
  for (unsigned seed = 1; seed <= kScans; ++seed) {
    SCOPED_TRACE(seed);
    Random random(seed);
    const auto cloud = tests::ScanRealTube(FiveBends(), {.sunk = 0.02}, {}, random);
    const auto found = Reconstruct(cloud.points_W, {}, kClock);
    ASSERT_TRUE(found) << found.error().message;
    ASSERT_EQ(found->tube.program.bend_count(), 5U);
    eased += found->bend_easings.empty() ? 0 : 1;
    const bool reversed = std::abs(found->tube.program.rows[0].angle_deg - 61) > 10;
    for (std::size_t i = 1; i < 5; ++i) {
      const std::size_t j = reversed ? 5 - i : i;
      const double off_mm =
          found->tube.program.rows[j].length_mm - FiveBends().program.rows[i].length_mm;
      squares += std::pow(off_mm / found->sigma.rows[j].length_mm, 2);
      values += 1;
    }
  }
  EXPECT_LE(eased, 1U);
  EXPECT_LT(std::sqrt(squares / values), 1.5);
}

// Points of which one half tells another story than the other.
TEST(SelfCheck, HalvesThatDifferAreSaidToDiffer) {
  Random random(5);
  const hal::Tube tube = tests::RandomTube({.bends = 2}, random);
  Points points = tests::SyntheticCloud(tube, {.points = 6000, .noise_mm = 0.05}, random);
  const std::vector<PointBlock> blocks = {{points[0], 1e6, points}};
  const SurfaceFitOptions options{.reach_mm = 0.2 * tube.pipe_radius_mm};
  const HalvesDiffer same = CompareHalves(FitSurface(tube, blocks, options), blocks, options);
  EXPECT_GT(same.sigmas, 0);
  EXPECT_LT(same.sigmas, 4);

  const auto [first, second] = HalvesOf(blocks, 1'000'000);
  EXPECT_EQ(first.point_count() + second.point_count(), points.size());
  EXPECT_NEAR(static_cast<double>(first.point_count()), 3000, 200);
  // The last straight of the second half, turned by a fifth of a degree.
  const auto segments = hal::SpineSegments(tube.program, tube.X_WT);
  const Eigen::AngleAxisd turn(0.2 * std::numbers::pi / 180, segments[3].normal);
  const Eigen::Vector3d about = segments[4].start_mm;
  const std::span<const PointBlock> second_blocks = second;
  const Points moved(second_blocks[0].points.begin(), second_blocks[0].points.end());
  std::size_t next = 0;
  for (Eigen::Vector3d& p : points) {
    if (next == moved.size() || p != moved[next]) continue;
    ++next;
    if ((p - about).dot(segments[4].tangent) > 0) p = about + turn * (p - about);
  }
  EXPECT_EQ(next, moved.size());
  const HalvesDiffer differ = CompareHalves(FitSurface(tube, blocks, options), blocks, options);
  EXPECT_GT(differ.sigmas, 5);
  EXPECT_EQ(differ.what.substr(0, 15), "bend 2 angle by") << differ.what;
}

// Two arcs of one circle are one arc again, half a turn and more included.
TEST(StructureMoves, ArcsOfOneCircleMergeIntoIt) {
  for (const double angle_deg : {40.0, 120.0, 179.9, 180.0, 185.0, 240.0}) {
    hal::Tube tube;
    tube.pipe_radius_mm = 5;
    tube.program.rows = {
        {30, 0, 0.4 * angle_deg, 20.0}, {0, 0, 0.6 * angle_deg, 20.0}, {30, 0, 0, std::nullopt}};
    const ArcLineSpline two = SplineFromTube(tube);
    const auto merged = MergedArc(two.arcs[0], two.arcs[1]);
    ASSERT_TRUE(merged.has_value()) << angle_deg;
    EXPECT_NEAR(merged->radius_mm, 20, 1e-6) << angle_deg;
    EXPECT_NEAR(merged->angle_rad * 180 / std::numbers::pi, angle_deg, 1e-6);
    EXPECT_NEAR((merged->begin_mm - two.arcs[0].begin_mm).norm(), 0, 1e-6) << angle_deg;
    EXPECT_NEAR((merged->end_mm - two.arcs[1].end_mm).norm(), 0, 1e-6) << angle_deg;
  }
}

// A last bend whose outer straight and arc nobody saw is no bend.
TEST(StructureMoves, BendsWithoutSamplesAreDropped) {
  Random random(6);
  const hal::Tube tube = tests::RandomTube({.bends = 2}, random);
  SurfaceFit fit;
  fit.tube = tube;
  const auto segments = hal::SpineSegments(tube.program, tube.X_WT);
  for (const auto& segment : segments) fit.segment_samples.push_back(20 * segment.length_mm);
  fit.segment_used = fit.segment_samples;
  fit.sigma_mm = 0.05;
  fit.segment_mean_square_mm2.assign(segments.size(), fit.sigma_mm * fit.sigma_mm);
  ArcLineSpline spline = SplineFromTube(tube);
  EXPECT_FALSE(DropUnseen(spline, fit));
  fit.segment_samples[4] = 0;  // the arc still is seen: the scan ended in the bend
  EXPECT_FALSE(DropUnseen(spline, fit));
  fit.segment_samples[3] *= 0.1;
  fit.segment_used = fit.segment_samples;
  EXPECT_TRUE(DropUnseen(spline, fit));
  EXPECT_EQ(spline.arcs.size(), 1U);
}

TEST(StructureMoves, BendsOfAThinScanAreKeptWhereTheirSamplesLieOnThem) {
  Random random(6);
  SurfaceFit fit;
  fit.tube = tests::RandomTube({.bends = 2}, random);
  const auto segments = hal::SpineSegments(fit.tube.program, fit.tube.X_WT);
  for (const auto& segment : segments) fit.segment_samples.push_back(20 * segment.length_mm);
  fit.segment_samples[3] = 4;
  fit.segment_samples[4] = 8;
  fit.segment_used = fit.segment_samples;
  fit.sigma_mm = 0.05;
  fit.segment_mean_square_mm2.assign(segments.size(), fit.sigma_mm * fit.sigma_mm);
  ArcLineSpline spline = SplineFromTube(fit.tube);
  EXPECT_FALSE(DropUnseen(spline, fit));
  // Some of them belong to a nut, say.
  fit.segment_mean_square_mm2[4] = 25 * fit.sigma_mm * fit.sigma_mm;
  fit.segment_used[4] = 5;
  EXPECT_FALSE(DropUnseen(spline, fit));
  // As far off as what lies there by chance.
  fit.segment_used[4] = 1;
  EXPECT_TRUE(DropUnseen(spline, fit));
}

}  // namespace
}  // namespace bendloop::pipeline
