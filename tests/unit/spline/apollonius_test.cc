// SPDX-License-Identifier: Apache-2.0
#include "pipeline/spline/apollonius.h"

#include <gtest/gtest.h>

#include "tests/support/shapes.h"

namespace bendloop::pipeline {
namespace {

using Eigen::Vector2d;
using tests::kPi;
using tests::Random;
using tests::Uniform;

Vector2d Turned(const Vector2d& v, double angle) {
  return {std::cos(angle) * v.x() - std::sin(angle) * v.y(),
          std::sin(angle) * v.x() + std::cos(angle) * v.y()};
}

// A line, an arc of `radius` and a line, with the lines given by points that are not the touching
// points.
struct Case {
  TangentCircles circles;
  Vector2d begin, end, center;
  double radius = 0;
  double turn = 0;
};

Case RandomCase(Random& random) {
  for (;;) {
    Case c;
    c.radius = Uniform(random, 2, 40);
    c.turn = Uniform(random, 0.05, 2 * kPi - 0.05) * (Uniform(random, -1, 1) > 0 ? 1 : -1);
    if (std::abs(std::abs(c.turn) - kPi) < 0.05) continue;
    const Vector2d direction = Turned({1, 0}, Uniform(random, -kPi, kPi));
    c.begin = {Uniform(random, -50, 50), Uniform(random, -50, 50)};
    const Vector2d to_center = Turned(direction, c.turn > 0 ? kPi / 2 : -kPi / 2);
    c.center = c.begin + c.radius * to_center;
    c.end = c.center + Turned(c.begin - c.center, c.turn);
    const Vector2d direction2 = Turned(direction, c.turn);
    const auto made =
        MakeTangentCircles(c.begin - Uniform(random, 1, 30) * direction, direction,
                           c.end + Uniform(random, 1, 30) * direction2, direction2, c.turn);
    if (!made) continue;
    c.circles = *made;
    return c;
  }
}

TEST(Apollonius, FindsTheCircleThatMadeTheLines) {
  Random random(1);
  for (int run = 0; run < 500; ++run) {
    const Case c = RandomCase(random);
    const double scale = 1e-8 * (1 + c.circles.bisector.norm() * 100);
    EXPECT_NEAR((c.circles.Center(c.radius) - c.center).norm(), 0, scale);
    EXPECT_NEAR((c.circles.Begin(c.radius) - c.begin).norm(), 0, scale);
    EXPECT_NEAR((c.circles.End(c.radius) - c.end).norm(), 0, scale);
  }
}

TEST(Apollonius, DistanceIsTheLeastOverTheCurve) {
  Random random(2);
  for (int run = 0; run < 300; ++run) {
    const Case c = RandomCase(random);
    const Vector2d point =
        c.center + Vector2d(Uniform(random, -2, 2), Uniform(random, -2, 2)) * c.radius;
    double best = std::numeric_limits<double>::infinity();
    const int steps = 4000;
    for (int i = 0; i <= steps; ++i) {
      const double part = static_cast<double>(i) / steps;
      best = std::min(best, (c.center + Turned(c.begin - c.center, part * c.turn) - point).norm());
      best = std::min(best, (c.begin - 200 * part * c.circles.direction1 - point).norm());
      best = std::min(best, (c.end + 200 * part * c.circles.direction2 - point).norm());
    }
    const double step = std::max(200.0, 2 * kPi * c.radius) / steps;
    const double found = c.circles.Distance(point, c.radius);
    EXPECT_LE(found, best + 1e-9) << run;
    EXPECT_GE(found, best - step) << run;
  }
}

TEST(Apollonius, ParallelLinesHaveNoCorner) {
  EXPECT_FALSE(MakeTangentCircles({0, 0}, {1, 0}, {0, 5}, {1, 0}, 0.0));
  EXPECT_FALSE(MakeTangentCircles({0, 0}, {1, 0}, {0, 5}, {-1, 0}, kPi));
  EXPECT_FALSE(MakeTangentCircles({0, 0}, {1, 0}, {0, 0}, {1, 0}, 0.0));
}

// The point lies near a curve of the family, so a range is there; its ends are where the distance
// is epsilon, all between is within, and just beyond is not.
TEST(Apollonius, RangeIsWhereTheCurvePassesThePoint) {
  Random random(3);
  int bounded = 0;
  for (int run = 0; run < 2000; ++run) {
    const Case c = RandomCase(random);
    const double epsilon = c.radius * Uniform(random, 0.005, 0.1);
    const double part = Uniform(random, 0.1, 0.9);
    const double off = Uniform(random, -0.8, 0.8) * epsilon;
    const Vector2d out = Turned(c.begin - c.center, part * c.turn) / c.radius;
    const Vector2d point = c.center + (c.radius + off) * out;
    const RadiusRange range = ApolloniusRange(c.circles, point, epsilon);
    ASSERT_FALSE(range.empty()) << run;
    EXPECT_LE(range.low, c.radius) << run << " turn " << c.turn;
    EXPECT_GE(range.high, c.radius) << run << " turn " << c.turn;
    const double tolerance = 1e-6 * epsilon + 1e-9;
    if (range.low > 0) {
      EXPECT_NEAR(c.circles.Distance(point, range.low), epsilon, tolerance) << run;
      EXPECT_GT(c.circles.Distance(point, range.low * (1 - 1e-4)), epsilon) << run;
    }
    if (range.high < 1e8) {
      ++bounded;
      EXPECT_NEAR(c.circles.Distance(point, range.high), epsilon, tolerance) << run;
      EXPECT_GT(c.circles.Distance(point, range.high * (1 + 1e-4)), epsilon) << run;
    }
    const double high = std::min(range.high, 10 * c.radius);
    for (int i = 0; i <= 40; ++i) {
      const double radius = range.low + (high - range.low) * i / 40.0;
      if (!(radius > 0)) continue;
      EXPECT_LE(c.circles.Distance(point, radius), epsilon * (1 + 1e-6)) << run << " " << radius;
    }
  }
  EXPECT_GT(bounded, 1000);
}

// On the lines, beyond the arc: the range begins at the corner, where the curve is the two lines.
TEST(Apollonius, APointOnALineBoundsTheRadiusFromAboveOnly) {
  Random random(4);
  int tried = 0;
  for (int run = 0; run < 500; ++run) {
    const Case c = RandomCase(random);
    if (std::abs(c.turn) > kPi - 0.1) continue;  // beyond, the corner lies behind
    ++tried;
    const double epsilon = 0.05 * c.radius;
    const bool first = run % 2 == 0;
    const Vector2d on_line =
        first ? Vector2d(c.begin - Uniform(random, 0.1, 1) * c.radius * c.circles.direction1)
              : Vector2d(c.end + Uniform(random, 0.1, 1) * c.radius * c.circles.direction2);
    const RadiusRange range = ApolloniusRange(c.circles, on_line, epsilon);
    ASSERT_FALSE(range.empty());
    EXPECT_EQ(range.low, 0) << run;
    EXPECT_GT(range.high, c.radius) << run;
    EXPECT_NEAR(c.circles.Distance(on_line, range.high), epsilon, 1e-6 * epsilon + 1e-9) << run;
  }
  EXPECT_GT(tried, 100);
}

TEST(Apollonius, APointFarFromEveryCurveHasNoRange) {
  // A right angle at the origin, from along +x to along +y: what is below the first line is passed
  // by none.
  const auto circles = MakeTangentCircles({-10, 0}, {1, 0}, {0, 10}, {0, 1}, kPi / 2);
  ASSERT_TRUE(circles);
  EXPECT_TRUE(ApolloniusRange(*circles, {-5, -3}, 0.1).empty());
  EXPECT_TRUE(ApolloniusRange(*circles, {3, 5}, 0.1).empty());
  EXPECT_FALSE(ApolloniusRange(*circles, {-5, 3}, 0.1).empty());
}

}  // namespace
}  // namespace bendloop::pipeline
