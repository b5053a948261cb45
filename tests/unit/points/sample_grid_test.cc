// SPDX-License-Identifier: Apache-2.0
#include "pipeline/points/sample_grid.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "firmware-host/workers/thread_workers.h"
#include "pipeline/points/point_pyramid.h"
#include "tests/support/shapes.h"

namespace bendloop::pipeline {
namespace {

using tests::Points;
using tests::Random;
using tests::Uniform;

bool Less(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  return std::lexicographical_compare(a.data(), a.data() + 3, b.data(), b.data() + 3);
}

Points Sorted(Points points) {
  std::sort(points.begin(), points.end(), Less);
  return points;
}

Points Cube(std::size_t count, double half, Random& random) {
  Points points;
  for (std::size_t i = 0; i < count; ++i) {
    points.emplace_back(Uniform(random, -half, half), Uniform(random, -half, half),
                        Uniform(random, -half, half));
  }
  return points;
}

TEST(SampleGrid, BallsHoldTheSamplesWithin) {
  Random random(1);
  SampleGrid grid(2.0);
  Points samples;
  for (const Eigen::Vector3d& p : Cube(3000, 10, random)) {
    std::int32_t block = -1;
    if (grid.Insert(p, block) == SampleGrid::Insertion::kSample) samples.push_back(p);
  }
  EXPECT_EQ(grid.sample_count(), samples.size());
  EXPECT_EQ(grid.point_count(), 3000U);
  Points found;
  for (int run = 0; run < 50; ++run) {
    const Eigen::Vector3d center = Cube(1, 11, random)[0];
    const double radius = Uniform(random, 0.1, 5);
    Points expected;
    for (const Eigen::Vector3d& p : samples) {
      if ((p - center).squaredNorm() < radius * radius) expected.push_back(p);
    }
    grid.GatherBall(center, radius, found);
    EXPECT_EQ(Sorted(found), Sorted(expected)) << run;
  }
}

// Dense enough for blocks to be thinned, with points that are nowhere, and not the first to come.
// What is known of a point's sensor stays with it; here it stood where the direction from the
// origin points to.
TEST(SampleGrid, AllAtOnceIsTheSameAsOneByOne) {
  Random random(9);
  for (const std::size_t threads : {1U, 3U}) {
    Points points = Cube(150'000, 3, random);
    for (std::size_t i = 0; i < points.size(); ++i) points[i] *= i % 1000 == 0 ? 1.0 : 0.05;
    points[70] = Eigen::Vector3d::Constant(std::numeric_limits<double>::quiet_NaN());
    points[100'000] = Eigen::Vector3d::Constant(1e200);
    const Points before = Cube(100, 4, random);
    SampleGrid one_by_one(2.0), at_once(2.0), without(2.0);
    std::int32_t block = 0;
    for (const Eigen::Vector3d& p : before) one_by_one.Insert(p, block), at_once.Insert(p, block);
    std::vector<SensorDirection> directions;
    for (const Eigen::Vector3d& p : points) {
      directions.push_back(PackDirection(p));
      one_by_one.Insert(p, block, directions.back());
    }
    host::ThreadWorkers workers(threads);
    at_once.InsertAll(points, &workers, directions);
    without.InsertAll(points, &workers);
    for (const SampleGrid::Block& b : without.blocks()) EXPECT_TRUE(b.to_sensor.empty());
    EXPECT_EQ(at_once.sample_count(), one_by_one.sample_count());
    EXPECT_EQ(at_once.point_count(), one_by_one.point_count());
    EXPECT_EQ(at_once.kept_count(), one_by_one.kept_count());
    EXPECT_LT(at_once.kept_count(), 130'000U) << "nothing was thinned";
    ASSERT_EQ(at_once.blocks().size(), one_by_one.blocks().size());
    for (std::size_t b = 0; b < at_once.blocks().size(); ++b) {
      const SampleGrid::Block &x = at_once.blocks()[b], &y = one_by_one.blocks()[b];
      EXPECT_EQ(x.cell, y.cell);
      EXPECT_EQ(x.neighbours, y.neighbours);
      EXPECT_EQ(x.points, y.points);
      EXPECT_EQ(x.to_sensor, y.to_sensor);
      ASSERT_TRUE(x.to_sensor.empty() || x.to_sensor.size() == x.points.size());
      std::size_t unknown = 0;  // of those that came before
      for (std::size_t i = 0; i < x.to_sensor.size(); ++i) {
        unknown += x.to_sensor[i].known() ? 0 : 1;
        if (x.to_sensor[i].known()) {
          EXPECT_EQ(x.to_sensor[i], PackDirection(x.points[i]));
        }
      }
      EXPECT_LE(unknown, before.size());
      EXPECT_EQ(x.sample_count, y.sample_count);
      EXPECT_EQ(x.stride, y.stride);
      EXPECT_EQ(x.arrived, y.arrived);
    }
  }
}

TEST(SampleGrid, NeighbourhoodsAreMutualAndComplete) {
  Random random(2);
  SampleGrid grid(2.0);
  for (const Eigen::Vector3d& p : Cube(2000, 8, random)) {
    std::int32_t block = -1;
    grid.Insert(p, block);
  }
  const auto& blocks = grid.blocks();
  for (std::size_t a = 0; a < blocks.size(); ++a) {
    EXPECT_EQ(blocks[a].neighbours[13], static_cast<std::int32_t>(a));
    for (std::size_t b = 0; b < blocks.size(); ++b) {
      const bool near = (blocks[a].cell - blocks[b].cell).cwiseAbs().maxCoeff() <= 1;
      const auto& n = blocks[a].neighbours;
      EXPECT_EQ(std::find(n.begin(), n.end(), static_cast<std::int32_t>(b)) != n.end(), near);
    }
  }
}

TEST(SampleGrid, KeepsOnePointOfAVoxelAndTheOthersApart) {
  Random random(3);
  SampleGrid grid(5.0);  // voxels of 1
  std::int32_t block = -1;
  EXPECT_EQ(grid.Insert({0.1, 0.1, 0.1}, block), SampleGrid::Insertion::kSample);
  EXPECT_EQ(grid.Insert({0.9, 0.9, 0.9}, block), SampleGrid::Insertion::kOther);
  EXPECT_EQ(grid.Insert({1.1, 0.1, 0.1}, block), SampleGrid::Insertion::kSample);
  EXPECT_EQ(grid.Insert({-0.1, 0.1, 0.1}, block), SampleGrid::Insertion::kSample);
  EXPECT_EQ(grid.blocks().size(), 2U);
  // A dense scan of one place does not grow without bound.
  for (int i = 0; i < 5000; ++i) grid.Insert({0.5, 0.5, 0.5}, block);
  EXPECT_LE(grid.kept_count(), 3 * (SampleGrid::kMaxPointsOfVoxel + 1));
  EXPECT_GT(grid.kept_count(), SampleGrid::kMaxPointsOfVoxel);
  EXPECT_EQ(grid.point_count(), 5004U);
}

TEST(SampleGrid, ALongScanIsThinnedEvenlyToItsBound) {
  constexpr std::size_t kMost = 2000;
  constexpr int kPasses = 400;  // over the same places, each a little higher
  SampleGrid grid(5.0, kMost);
  std::int32_t block = -1;
  std::size_t most = 0;
  for (int pass = 0; pass < kPasses; ++pass) {
    for (int i = 0; i < 200; ++i) {
      grid.Insert({0.25 * i, 0.5, 0.5 + 0.4 * pass / kPasses}, block);
      most = std::max(most, grid.kept_count() - grid.sample_count());
    }
  }
  EXPECT_LE(most, kMost + 1);
  EXPECT_EQ(grid.point_count(), 200U * kPasses);
  std::size_t held = 0;
  std::size_t early = 0;  // of the first half of the passes
  for (const auto& b : grid.blocks()) {
    for (const Eigen::Vector3d& p : b.points) {
      ++held;
      if (p.z() < 0.7) ++early;
    }
  }
  EXPECT_EQ(held, grid.kept_count());
  EXPECT_GT(held, kMost / 4);
  EXPECT_NEAR(static_cast<double>(early), 0.5 * static_cast<double>(held),
              0.15 * static_cast<double>(held));
}

TEST(SampleGrid, DropsWhatIsNoPlace) {
  SampleGrid grid(1.0);
  std::int32_t block = -7;
  const double inf = std::numeric_limits<double>::infinity();
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (const double bad : {inf, -inf, nan, 1e300, -1e9}) {
    for (int axis = 0; axis < 3; ++axis) {
      Eigen::Vector3d p(1, 1, 1);
      p[axis] = bad;
      EXPECT_EQ(grid.Insert(p, block), SampleGrid::Insertion::kDropped) << bad;
    }
  }
  EXPECT_EQ(block, -7);
  EXPECT_TRUE(grid.blocks().empty());
}

TEST(SampleGrid, BallVersionMovesWithItsSamplesOnly) {
  SampleGrid grid(1.0);
  std::int32_t block = -1;
  grid.Insert({0.5, 0.5, 0.5}, block);
  const auto before = grid.BallVersion({0.5, 0.5, 0.5}, 0.8);
  grid.Insert({50, 0, 0}, block);
  EXPECT_EQ(grid.BallVersion({0.5, 0.5, 0.5}, 0.8), before);
  grid.Insert({0.5, 0.5, 0.5}, block);  // another point, no sample
  EXPECT_EQ(grid.BallVersion({0.5, 0.5, 0.5}, 0.8), before);
  grid.Insert({0.9, 0.9, 0.9}, block);
  EXPECT_NE(grid.BallVersion({0.5, 0.5, 0.5}, 0.8), before);
}

TEST(SampleGrid, BlocksNearPlacesAscend) {
  Random random(4);
  SampleGrid grid(1.0);
  const Points points = Cube(4000, 10, random);
  for (const Eigen::Vector3d& p : points) {
    std::int32_t block = -1;
    grid.Insert(p, block);
  }
  const Points places = Cube(5, 8, random);
  const auto near = grid.BlocksNear(places, 2.0);
  EXPECT_TRUE(std::is_sorted(near.begin(), near.end()));
  std::vector<bool> in(grid.blocks().size(), false);
  for (const std::int32_t b : near) in[static_cast<std::size_t>(b)] = true;
  for (std::size_t b = 0; b < in.size(); ++b) {
    for (const Eigen::Vector3d& p : grid.blocks()[b].samples()) {
      for (const Eigen::Vector3d& place : places) {
        if ((p - place).norm() < 2.0) {
          EXPECT_TRUE(in[b]);
        }
      }
    }
  }
}

TEST(PointPyramid, BallsHoldOnePointOfEachVoxel) {
  Random random(11);
  const Points points = Cube(4000, 10, random);
  PointPyramid pyramid(points);
  Points all, ball;
  for (const double voxel : {0.1, 0.9, 2.0, 50.0}) {
    const auto& level = pyramid.Thinned(voxel);
    level.GatherBall({0, 0, 0}, 1e3, all);
    // Voxels may be half as wide as asked for, and every point has its voxel's beside it.
    const double most = std::pow(20.0 / (0.5 * voxel) + 1, 3);
    EXPECT_LE(static_cast<double>(all.size()), std::max(most, 513.0)) << voxel;
    EXPECT_GE(all.size(), std::min<std::size_t>(points.size(), 512) / 2) << voxel;
    for (std::size_t i = 0; i < points.size(); i += 40) {
      level.GatherBall(points[i], std::sqrt(3.0) * std::min(voxel, 2.6), ball);
      EXPECT_FALSE(ball.empty()) << voxel;
    }
    for (const Eigen::Vector3d& center : Cube(20, 14, random)) {
      for (const double radius : {0.3, 2.5, 9.0}) {
        level.GatherBall(center, radius, ball);
        Points expected;
        for (const Eigen::Vector3d& p : all) {
          if ((p - center).norm() < radius) expected.push_back(p);
        }
        EXPECT_EQ(Sorted(ball), Sorted(expected)) << voxel;
      }
    }
  }
}

TEST(PointPyramid, TakesThePointThatCameFirst) {
  const Points points = {{5, 5, 5}, {0, 0, 0}, {4.9, 4.9, 4.9}, {10, 10, 10}};
  PointPyramid pyramid(points);
  Points found;
  pyramid.Thinned(1.0).GatherBall({5, 5, 5}, 1.0, found);
  EXPECT_THAT(found, testing::Contains(points[0]));
  PointPyramid({}).Thinned(1.0).GatherBall({0, 0, 0}, 1.0, found);
  EXPECT_TRUE(found.empty());
}

}  // namespace
}  // namespace bendloop::pipeline
