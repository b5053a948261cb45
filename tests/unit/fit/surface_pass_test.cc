// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/surface_pass.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstddef>
#include <random>
#include <span>
#include <vector>

#include "hal/spine.h"
#include "tests/support/synthetic_cloud.h"
#include "tests/unit/fit/three_bends.h"

namespace bendloop::pipeline {
namespace {

// Cubes as of a grid, with fliers and samples of two segments in some.
std::vector<std::vector<Eigen::Vector3d>> Cubes(const std::vector<Eigen::Vector3d>& points,
                                                double edge_mm,
                                                std::vector<Eigen::Vector3d>& centers_mm) {
  std::vector<std::vector<Eigen::Vector3d>> cubes;
  for (const Eigen::Vector3d& point : points) {
    const Eigen::Vector3d center_mm = edge_mm * ((point / edge_mm).array().floor() + 0.5).matrix();
    std::size_t at = 0;
    while (at < cubes.size() && centers_mm[at] != center_mm) ++at;
    if (at == cubes.size()) {
      cubes.emplace_back();
      centers_mm.push_back(center_mm);
    }
    cubes[at].push_back(point);
  }
  return cubes;
}

void ExpectSameLane(const SegmentPoints::Lane& a, const SegmentPoints::Lane& b, std::size_t size) {
  for (std::size_t i = 0; i < size; ++i) {
    const auto at = static_cast<Eigen::Index>(i);
    ASSERT_EQ(a[at], b[at]) << i;
  }
}

// Points of certainty 1 go to their segments one by one; points that are all alike go there in
// batches where they can. Both are the same, to the bit and in the same order.
TEST(AssignPoints, TakesBatchesAsItTakesPoints) {
  std::mt19937_64 random(5);
  const hal::Tube tube = ThreeBends();
  const auto cloud =
      tests::SyntheticCloud(tube, {.points = 9000, .noise_mm = 0.1, .fliers = 0.02}, random);
  std::vector<Eigen::Vector3d> centers_mm;
  const double edge_mm = 4.0;
  const auto cubes = Cubes(cloud, edge_mm, centers_mm);
  const std::vector<float> ones(cloud.size(), 1.0F);
  std::vector<PointBlock> alike, certain;
  for (std::size_t i = 0; i < cubes.size(); ++i) {
    alike.push_back({centers_mm[i], 0.5 * std::sqrt(3.0) * edge_mm, cubes[i]});
    certain.push_back(alike.back());
    certain.back().certainties = std::span(ones).first(cubes[i].size());
  }
  const auto frames =
      SegmentFrames(hal::SpineSegments(tube.program, tube.X_WT), kBeyond * tube.pipe_radius_mm);
  for (const double reach_mm : {1.0, 0.15}) {
    SurfaceAssignment by_batch, by_point;
    AssignPoints(frames, tube.pipe_radius_mm, alike, reach_mm, by_batch);
    AssignPoints(frames, tube.pipe_radius_mm, certain, reach_mm, by_point);
    ASSERT_GT(by_point.distances_mm.size(), 5000U);
    ASSERT_LT(by_point.distances_mm.size(), cloud.size());  // fliers are left out
    EXPECT_EQ(by_batch.total, by_point.total);
    EXPECT_EQ(by_batch.distances_mm, by_point.distances_mm);
    EXPECT_EQ(by_batch.segment_count, by_point.segment_count);
    EXPECT_EQ(by_batch.segment_sum_mm2, by_point.segment_sum_mm2);
    for (std::size_t k = 0; k < frames.size(); ++k) {
      const SegmentPoints &a = by_batch.segments[k], &b = by_point.segments[k];
      ASSERT_EQ(a.size, b.size) << k;
      ExpectSameLane(a.x, b.x, a.size);
      ExpectSameLane(a.y, b.y, a.size);
      ExpectSameLane(a.z, b.z, a.size);
      ExpectSameLane(a.distance, b.distance, a.size);
    }
  }
}

// Every third of all points, wherever blocks begin and end; empty ones among them.
TEST(Thinned, CountsOverTheBordersOfBlocks) {
  std::vector<Eigen::Vector3d> points;
  for (int i = 0; i < 40; ++i) points.emplace_back(i, 0, 0);
  const std::span<const Eigen::Vector3d> all = points;
  const std::vector<float> ones(points.size(), 1.0F);
  for (const bool weighted : {false, true}) {
    std::vector<PointBlock> blocks;
    std::size_t next = 0;
    for (const std::size_t size : {1U, 0U, 7U, 2U, 1U, 29U}) {
      blocks.push_back({Eigen::Vector3d::Zero(), 1.0, all.subspan(next, size)});
      if (weighted) blocks.back().certainties = std::span(ones).subspan(next, size);
      next += size;
    }
    for (const std::size_t stride : {1U, 3U, 5U, 100U}) {
      const OwnedBlocks thinned = Thinned(blocks, stride);
      std::vector<double> is, should;
      for (const PointBlock& block : std::span<const PointBlock>(thinned)) {
        for (const Eigen::Vector3d& point : block.points) is.push_back(point.x());
        EXPECT_EQ(block.certainties.size(), weighted ? block.points.size() : 0U);
      }
      for (std::size_t i = 0; i < points.size(); i += stride) {
        should.push_back(static_cast<double>(i));
      }
      EXPECT_EQ(is, should) << stride;
    }
  }
}

}  // namespace
}  // namespace bendloop::pipeline
