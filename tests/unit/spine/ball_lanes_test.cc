// SPDX-License-Identifier: Apache-2.0
#include "pipeline/math/ball_lanes.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstddef>
#include <limits>
#include <vector>

#include "pipeline/math/simd.h"
#include "tests/support/shapes.h"

namespace bendloop::pipeline {
namespace {

using tests::Points;
using tests::Random;
using tests::Uniform;

struct FoundInBall {
  explicit FoundInBall(std::size_t room) : x(room), y(room), z(room) {}
  std::vector<double> x, y, z;
  std::size_t count = 0;
};

FoundInBall FindInBall(const Points& points, const Eigen::Vector3d& center, double scale) {
  FoundInBall to(points.size());
  to.count = GatherInBall(points, center, scale, {to.x.data(), to.y.data(), to.z.data()});
  return to;
}

// Exactly what the points themselves say: which ones, in their order, to the last bit.
void ExpectExact(const Points& points, const Eigen::Vector3d& center, double scale) {
  const FoundInBall is = FindInBall(points, center, scale);
  std::size_t next = 0;
  for (const Eigen::Vector3d& point : points) {
    const Eigen::Vector3d p = scale * (point - center);
    if (!(p.squaredNorm() < 1.0)) continue;
    ASSERT_LT(next, is.count);
    EXPECT_EQ(is.x[next], p.x());
    EXPECT_EQ(is.y[next], p.y());
    EXPECT_EQ(is.z[next], p.z());
    ++next;
  }
  EXPECT_EQ(next, is.count);
}

// Both versions of the loop, of any number of points: whole fours, and what is left of them.
TEST(BallLanes, HoldThePointsInTheBallInTheirOrder) {
  Random random(1);
  const bool before = uses_avx2;
  for (const bool fast : {before, false}) {
    uses_avx2 = fast;
    for (std::size_t size = 0; size < 70; ++size) {
      Points points;
      for (std::size_t i = 0; i < size; ++i) {
        points.emplace_back(Uniform(random, -2, 2), Uniform(random, -2, 2), Uniform(random, -2, 2));
      }
      ExpectExact(points, {0.3, -0.2, 0.1}, 1.0 / 1.7);
      ExpectExact(points, {0.3, -0.2, 0.1}, 0.1);  // all of them
      ExpectExact(points, {9.0, 9.0, 9.0}, 1.0);   // none
    }
  }
  uses_avx2 = before;
}

// On the border, and where there is no number: neither is within.
TEST(BallLanes, LeaveOutTheBorderAndWhatIsNoNumber) {
  const bool before = uses_avx2;
  const double below = std::nextafter(1.0, 0.0);
  const double none = std::numeric_limits<double>::quiet_NaN();
  const Points points = {{1, 0, 0},    {below, 0, 0}, {0, 1, 0},
                         {0, none, 0}, {0, 0, below}, {0, 0, -1}};
  for (const bool fast : {before, false}) {
    uses_avx2 = fast;
    const FoundInBall is = FindInBall(points, Eigen::Vector3d::Zero(), 1.0);
    ASSERT_EQ(is.count, 2U);
    EXPECT_EQ(is.x[0], below);
    EXPECT_EQ(is.z[1], below);
  }
  uses_avx2 = before;
}

}  // namespace
}  // namespace bendloop::pipeline
