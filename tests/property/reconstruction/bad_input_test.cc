// SPDX-License-Identifier: Apache-2.0
// What is no tube is refused, with words that say what it looks like.
#include <gmock/gmock.h>

#include <limits>

#include "tests/property/reconstruction/scans.h"

namespace bendloop::tests {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::Not;

void ExpectRefused(const Points& points, const testing::Matcher<std::string>& words,
                   const pipeline::ReconstructionOptions& options = {}) {
  const auto found = Measure(points, options);
  ASSERT_FALSE(found) << "found " << found->tube.program.bend_count() << " bends, pipe radius "
                      << found->tube.pipe_radius_mm;
  EXPECT_EQ(found.error().kind, hal::ErrorKind::kBadInput);
  EXPECT_THAT(found.error().message, words);
  EXPECT_THAT(found.error().message, Not(HasSubstr("\n")));
}

hal::Tube SomeTube(double radius, Random& random) {
  return RandomTube({.pipe_radius_mm = radius, .bends = 2, .min_straight = 4, .max_straight = 10},
                    random);
}

TEST(BadInput, NoPointsOrFew) {
  ExpectRefused({}, HasSubstr("too few points: found 0"));
  ExpectRefused({{1, 2, 3}}, HasSubstr("too few points: found 1"));
  const pipeline::ReconstructionOptions known{.pipe_radius_mm = 4.0, .nominal = std::nullopt};
  ExpectRefused({}, HasSubstr("too few points: found 0"), known);
  ExpectRefused({{1, 2, 3}}, HasSubstr("too few points: found 1"), known);
}

TEST(BadInput, OnePlaceALineAPlane) {
  Random random(1);
  Points line, plane;
  for (int i = 0; i < 1000; ++i) {
    line.emplace_back(Uniform(random, 0, 100), 5, 5);
    plane.emplace_back(Uniform(random, 0, 100), Uniform(random, 0, 100), 5);
  }
  ExpectRefused(Points(1000, {1, 2, 3}), HasSubstr("one place"));
  ExpectRefused(line, HasSubstr("on a line"));
  ExpectRefused(plane, HasSubstr("on a plane"));
  // The same in some pose, where rounding leaves no exact zeros, and with a known radius.
  const hal::Pose pose = RandomPose(100, random);
  for (Points* points : {&line, &plane}) {
    for (Eigen::Vector3d& p : *points) p = pose * p;
  }
  ExpectRefused(line, HasSubstr("on a line"));
  ExpectRefused(plane, HasSubstr("on a plane"));
  const pipeline::ReconstructionOptions known{.pipe_radius_mm = 4.0, .nominal = std::nullopt};
  ExpectRefused(line, HasSubstr("expected"), known);
  ExpectRefused(plane, HasSubstr("expected"), known);
  ExpectRefused(Points(1000, {1, 2, 3}), HasSubstr("expected"), known);
}

TEST(BadInput, NoiseAndSpheres) {
  Random random(2);
  Points noise, sphere;
  for (int i = 0; i < 5000; ++i) {
    noise.emplace_back(Uniform(random, 0, 100), Uniform(random, 0, 100), Uniform(random, 0, 100));
    sphere.push_back(40 * RandomUnit(random));
  }
  ExpectRefused(noise, HasSubstr("no pipe found"));
  ExpectRefused(sphere, HasSubstr("no pipe found"));
  const pipeline::ReconstructionOptions known{.pipe_radius_mm = 4.0, .nominal = std::nullopt};
  ExpectRefused(noise, HasSubstr("no tube"), known);
  ExpectRefused(sphere, HasSubstr("no tube"), known);
}

TEST(BadInput, TwoTubes) {
  Random random(3);
  const hal::Tube a = SomeTube(5, random);
  hal::Tube b = a;
  b.X_WT.position_mm += Eigen::Vector3d(500, 300, 0);
  Points points = SyntheticCloud(a, {}, random);
  for (const Eigen::Vector3d& p : SyntheticCloud(b, {}, random)) points.push_back(p);
  ExpectRefused(points, AllOf(HasSubstr("two tubes"), HasSubstr("one tube at a time")));
}

// Rings farther apart than the pipe radius: from one to the next the points curve as on a much
// wider pipe, which the whole tube may seem to be.
TEST(BadInput, LaserLinesTooFarApart) {
  for (int seed = 0; seed < 4 * kSeeds; ++seed) {
    Random random(static_cast<std::uint64_t>(seed));
    const hal::Tube tube = RandomTube({.pipe_radius_mm = 5,
                                       .bends = 4,
                                       .min_bend_radius = 1.6,
                                       .max_bend_radius = 1.6,
                                       .min_straight = 4,
                                       .max_straight = 16},
                                      random);
    const auto found = Measure(SyntheticCloud(tube, {.points = 1200, .stripes_mm = 6}, random));
    if (found) {
      EXPECT_NEAR(found->tube.pipe_radius_mm, 5, 0.5) << seed;
    } else {
      EXPECT_THAT(found.error().message, HasSubstr("laser lines")) << seed;
    }
  }
}

// However many steps it takes to see what is not the tube.
TEST(Neighbours, WhatIsLeftOutIsSaidOnce) {
  Random random(7);
  // One joined to the tube by a bend that no machine makes, one far off.
  const hal::Tube joined{4, {{{150, 0, 90, 4.1}, {60, 0, 0, std::nullopt}}}, {}};
  hal::Tube far_off{4, {{{60, 0, 0, std::nullopt}}}, {}};
  far_off.X_WT.position_mm = {0, 300, 0};
  Points points = SyntheticCloud(joined, {.points = 6000}, random);
  const auto count = [](const hal::Result<pipeline::Measurement>& found, const char* words) {
    EXPECT_TRUE(found) << found.error().message;
    return std::count_if(found->warnings.begin(), found->warnings.end(), [&](const auto& warning) {
      return warning.find(words) != std::string::npos;
    });
  };
  EXPECT_EQ(count(Measure(points), "another piece of tube in view, "), 1);
  for (const Eigen::Vector3d& p : SyntheticCloud(far_off, {.points = 2000}, random)) {
    points.push_back(p);
  }
  const auto found = Measure(points);
  EXPECT_EQ(count(found, "left out"), 1);
  EXPECT_EQ(count(found, "2 other pieces of tube in view, together "), 1);
  EXPECT_EQ(found->tube.program.bend_count(), 0u);
}

TEST(BadInput, WrongUnitsAreNamed) {
  Random random(4);
  const hal::Tube tube = SomeTube(4, random);
  const Points points = SyntheticCloud(tube, {.points = 8000}, random);
  Points large = points, small = points;
  for (Eigen::Vector3d& p : large) p *= 1000;
  for (Eigen::Vector3d& p : small) p /= 1000;
  ExpectRefused(large, AllOf(HasSubstr("units"), HasSubstr("pipe radius")));
  ExpectRefused(small, AllOf(HasSubstr("--units m"), HasSubstr("pipe radius")));
}

TEST(BadInput, AnotherPipeThanTheKnownOne) {
  Random random(5);
  const Points points = SyntheticCloud(SomeTube(12, random), {.points = 8000}, random);
  ExpectRefused(points, HasSubstr("no tube of pipe radius 4 mm"),
                {.pipe_radius_mm = 4.0, .nominal = std::nullopt});
}

// What is no number is left out, wherever it comes and whether the radius is known or not.
TEST(BadInput, PointsThatAreNoPlaces) {
  Random random(6);
  const hal::Tube tube = SomeTube(4, random);
  Points points = SyntheticCloud(tube, {.points = 8000}, random);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const double inf = std::numeric_limits<double>::infinity();
  for (const double bad : {nan, inf, -inf, 1e300, -1e12}) {
    for (int axis = 0; axis < 3; ++axis) {
      Eigen::Vector3d p = points[100];
      p[axis] = bad;
      points.insert(points.begin() + 50, p);
    }
    ExpectRefused(Points(1000, Eigen::Vector3d::Constant(bad)), HasSubstr("too few points"));
  }
  for (const bool known : {false, true}) {
    pipeline::ReconstructionOptions options;
    if (known) options.pipe_radius_mm = 4.0;
    const auto found = Measure(points, options);
    ASSERT_TRUE(found) << found.error().message;
    ExpectMeasured(*found, tube, {.end_mm = 0.8});
  }
}

}  // namespace
}  // namespace bendloop::tests
