// SPDX-License-Identifier: Apache-2.0
#include "pipeline/tube_model.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <numbers>
#include <string>
#include <vector>

#include "hal/spine.h"
#include "tests/support/real_tube.h"
#include "tests/support/synthetic_cloud.h"

namespace bendloop::pipeline {
namespace {

using Points = std::vector<Eigen::Vector3d>;

hal::Result<Measurement> Measure(const Points& points, TubeModel model,
                                 SpineMethod method = SpineMethod::kMls) {
  const hal::SteadyClock clock;
  ReconstructionOptions options;
  options.spine_method = method;
  return ReconstructModel(points, model, options, clock);
}

// A tube whose radius grows from `from` to `to` times its own between the parts `begin` and `end`
// of its length.
Points Tapered(const hal::Tube& tube, double from, double to, double begin, double end,
               std::size_t count, double noise_mm, bool one_side, std::mt19937_64& random) {
  const auto segments = hal::SpineSegments(tube.program, tube.X_WT);
  const double length_mm = hal::SpineLength(tube.program);
  std::uniform_real_distribution<double> unit(0, 1);
  std::normal_distribution<double> noise(0, noise_mm);
  Points points;
  while (points.size() < count) {
    const double part = unit(random);
    const double s = part * length_mm;
    auto segment = segments.begin();
    while (segment + 1 != segments.end() && (segment + 1)->from_start_mm <= s) ++segment;
    const Eigen::Vector3d t = segment->TangentAt(s - segment->from_start_mm);
    const Eigen::Vector3d n = segment->normal;
    const double phi = 2 * std::numbers::pi * unit(random);
    const Eigen::Vector3d out = std::cos(phi) * n + std::sin(phi) * t.cross(n);
    if (one_side && out.dot(Eigen::Vector3d(0.2, 0.3, 0.93).normalized()) < 0.1) continue;
    const double u = std::clamp((part - begin) / (end - begin), 0.0, 1.0);
    const double radius = tube.pipe_radius_mm * (from + (to - from) * u * u * (3 - 2 * u));
    points.push_back(segment->PointAt(s - segment->from_start_mm) + (radius + noise(random)) * out);
  }
  return points;
}

void ExpectRowsNear(const hal::Tube& truth, const Measurement& m, double length_mm,
                    double angle_deg) {
  auto rows = m.tube.program.rows;
  const auto& expected = truth.program.rows;
  ASSERT_EQ(rows.size(), expected.size());
  // From either end.
  const auto at = [&](std::size_t i, bool back) { return back ? rows.size() - 1 - i : i; };
  const auto off = [&](bool back) {
    double sum = 0;
    for (std::size_t i = 0; i < rows.size(); ++i) {
      sum += std::abs(rows[at(i, back)].length_mm - expected[i].length_mm);
    }
    return sum;
  };
  const bool back = off(true) < off(false);
  for (std::size_t i = 0; i < rows.size(); ++i) {
    EXPECT_NEAR(rows[at(i, back)].length_mm, expected[i].length_mm, length_mm) << "row " << i;
    if (i + 1 == rows.size()) break;
    const std::size_t bend = back ? rows.size() - 2 - i : i;
    EXPECT_NEAR(rows[bend].angle_deg, expected[i].angle_deg, angle_deg) << "row " << i;
  }
}

TEST(TubeModel, AutoLeavesTubesAlone) {
  struct Case {
    const char* name;
    std::function<void(tests::CloudOptions&)> change;
  };
  const Eigen::Vector3d above = Eigen::Vector3d(0.2, 0.3, 0.93).normalized();
  const std::vector<Case> cases = {
      {"plain", [](auto&) {}},
      {"no noise", [](auto& c) { c.noise_mm = 0; }},
      {"rough", [](auto& c) { c.noise_mm = 0.25; }},
      {"fliers", [](auto& c) { c.fliers = 0.1; }},
      {"one side", [&](auto& c) { c.view_W = above; }},
      {"oval", [](auto& c) { c.ovality = 0.1, c.noise_mm = 0.02; }},
      {"oval, one side",
       [&](auto& c) { c.ovality = 0.1, c.noise_mm = 0.02, c.points = 12'000, c.view_W = above; }},
      {"stripes", [&](auto& c) { c.points = 12'000, c.view_W = above, c.stripes_mm = 1; }},
  };
  for (const Case& c : cases) {
    SCOPED_TRACE(c.name);
    std::mt19937_64 random(7);
    const hal::Tube tube = tests::PaperTube();
    tests::CloudOptions cloud;
    c.change(cloud);
    const auto result = Measure(tests::SyntheticCloud(tube, cloud, random), TubeModel::kAuto);
    ASSERT_TRUE(result) << result.error().message;
    EXPECT_EQ(result->tube.program.bend_count(), 4U);
    for (const std::string& warning : result->warnings) {
      EXPECT_EQ(warning.find("--model"), std::string::npos) << warning;
    }
  }
}

TEST(TubeModel, AutoSeesTapers) {
  for (const bool one_side : {false, true}) {
    for (unsigned seed = 1; seed <= 3; ++seed) {
      SCOPED_TRACE(std::string(one_side ? "one side" : "all round") + ", seed " +
                   std::to_string(seed));
      std::mt19937_64 random(seed);
      const hal::Tube tube = tests::PaperTube();
      const auto points = Tapered(tube, 1.0, 1.4, 0.3, 0.9, 8000, 0.03, one_side, random);
      const auto result = Measure(points, TubeModel::kAuto);
      ASSERT_TRUE(result) << result.error().message;
      ASSERT_FALSE(result->warnings.empty());
      EXPECT_NE(result->warnings.front().find("canal"), std::string::npos);
      ASSERT_GT(result->spine.size(), 50U);
      const double first = result->spine[2].pipe_radius_mm;
      const double last = result->spine[result->spine.size() - 3].pipe_radius_mm;
      const double tolerance = one_side ? 0.1 : 0.03;
      EXPECT_NEAR(std::min(first, last), 4.0, tolerance);
      EXPECT_NEAR(std::max(first, last), 5.6, tolerance);
      ExpectRowsNear(tube, *result, one_side ? 1.5 : 0.8, one_side ? 1.5 : 0.5);
    }
  }
}

// Dents move the spine of a canal, and what lines and arcs leave of it is no noise of its points.
TEST(TubeModel, ACanalIsNoSurerThanLinesAndArcsFollowIt) {
  hal::Tube tube;
  tube.pipe_radius_mm = 3.3;
  tube.program.rows = {{50, 0, 84, 12.3}, {25, 0, 0, std::nullopt}};
  for (unsigned seed = 1; seed <= 4; ++seed) {
    SCOPED_TRACE(seed);
    std::mt19937_64 random(seed);
    const auto cloud =
        tests::ScanRealTube(tube,
                            {.dents = {{.along = 0.67, .around_rad = -1.4, .depth_r = 0.13},
                                       {.along = 0.5, .around_rad = 1.7, .depth_r = 0.19}}},
                            {.points = 60'000, .noise_mm = 0.008}, random);
    const auto found = Measure(cloud.points_W, TubeModel::kCanal);
    ASSERT_TRUE(found) << found.error().message;
    ASSERT_EQ(found->tube.program.bend_count(), 1U);
    const auto& row = found->tube.program.rows.front();
    const auto& sigma = found->sigma.rows.front();
    EXPECT_NEAR(row.angle_deg, cloud.truth.program.rows.front().angle_deg, 4 * sigma.angle_deg);
    EXPECT_NEAR(*row.bend_radius_mm, 12.3, 4 * *sigma.bend_radius_mm);
    EXPECT_NEAR(found->tube.pipe_radius_mm, 3.3, 4 * found->pipe_radius_sigma_mm);
  }
}

// A nut is thicker than its tube, whose radius is even all the same.
TEST(TubeModel, WhatSitsOnAnEndMakesNoCanal) {
  hal::Tube tube;
  tube.pipe_radius_mm = 4.8;
  tube.program.rows = {{38, 0, 57, 16.5}, {48, -44, 35, 16.5}, {36, 0, 0, std::nullopt}};
  for (const auto fitting : {tests::EndFitting::kNut, tests::EndFitting::kFlare}) {
    for (unsigned seed = 1; seed <= 3; ++seed) {
      SCOPED_TRACE(seed);
      std::mt19937_64 random(seed);
      const auto cloud =
          tests::ScanRealTube(tube, {.ovality = 0.05, .seam = 0.03, .at_end = fitting},
                              {.points = 97'000, .noise_mm = 0.014}, random);
      const auto found = Measure(cloud.points_W, TubeModel::kAuto);
      ASSERT_TRUE(found) << found.error().message;
      EXPECT_GT(found->structure_margin, 0) << "of a canal there is none";
      ASSERT_EQ(found->tube.program.bend_count(), 2U);
    }
  }
}

TEST(TubeModel, ShrinkingGivesTheSameRows) {
  for (const bool one_side : {false, true}) {
    SCOPED_TRACE(one_side ? "one side" : "all round");
    tests::CloudOptions cloud;
    cloud.points = 12'000;
    if (one_side) cloud.view_W = Eigen::Vector3d(0.2, 0.3, 0.93).normalized();
    for (unsigned seed = 1; seed <= 4; ++seed) {
      SCOPED_TRACE(seed);
      std::mt19937_64 random(seed);
      const hal::Tube tube = seed == 1 ? tests::PaperTube() : tests::RandomTube({}, random);
      const auto points = tests::SyntheticCloud(tube, cloud, random);
      const auto mls = Measure(points, TubeModel::kTube);
      const auto shrunk = Measure(points, TubeModel::kTube, SpineMethod::kShrinking);
      ASSERT_TRUE(mls) << mls.error().message;
      ASSERT_TRUE(shrunk) << shrunk.error().message;
      ExpectRowsNear(mls->tube, *shrunk, 0.1, 0.05);
      EXPECT_NEAR(shrunk->tube.pipe_radius_mm, mls->tube.pipe_radius_mm, 0.002);
    }
  }
}

TEST(TubeModel, FreeformHasNoRowsAndSaysSo) {
  std::mt19937_64 random(3);
  const auto points = tests::SyntheticCloud(tests::PaperTube(), {}, random);
  const auto result = Measure(points, TubeModel::kFreeform);
  ASSERT_TRUE(result) << result.error().message;
  EXPECT_TRUE(result->tube.program.rows.empty());
  EXPECT_TRUE(result->sigma.rows.empty());
  ASSERT_EQ(result->warnings.size(), 1U);
  EXPECT_NE(result->warnings.front().find("no rows"), std::string::npos);
  EXPECT_NEAR(result->tube.pipe_radius_mm, 4.0, 0.01);
  double length_mm = 0;
  for (std::size_t i = 1; i < result->spine.size(); ++i) {
    length_mm += (result->spine[i].position_mm - result->spine[i - 1].position_mm).norm();
  }
  EXPECT_NEAR(length_mm, 268, 1.0);
}

TEST(TubeModel, SameInputSameOutput) {
  std::mt19937_64 random(5);
  const auto points = Tapered(tests::PaperTube(), 1, 1.3, 0, 1, 4000, 0.05, false, random);
  for (const SpineMethod method : {SpineMethod::kMls, SpineMethod::kShrinking}) {
    const auto a = Measure(points, TubeModel::kCanal, method);
    const auto b = Measure(points, TubeModel::kCanal, method);
    ASSERT_TRUE(a && b);
    ASSERT_EQ(a->spine.size(), b->spine.size());
    for (std::size_t i = 0; i < a->spine.size(); ++i) {
      EXPECT_EQ(a->spine[i].position_mm, b->spine[i].position_mm);
      EXPECT_EQ(a->spine[i].pipe_radius_mm, b->spine[i].pipe_radius_mm);
    }
    EXPECT_EQ(a->tube.program, b->tube.program);
  }
}

TEST(TubeModel, TwoTubesAreRefused) {
  std::mt19937_64 random(13);
  hal::Tube tube = tests::PaperTube();
  Points points = tests::SyntheticCloud(tube, {}, random);
  tube.X_WT.position_mm += Eigen::Vector3d(0, 0, 200);
  const Points other = tests::SyntheticCloud(tube, {}, random);
  points.insert(points.end(), other.begin(), other.end());
  for (const TubeModel model :
       {TubeModel::kAuto, TubeModel::kTube, TubeModel::kCanal, TubeModel::kFreeform}) {
    const auto result = Measure(points, model);
    ASSERT_FALSE(result);
    EXPECT_NE(result.error().message.find("two tubes"), std::string::npos);
  }
}

TEST(TubeModel, NoPipesAreRefused) {
  std::mt19937_64 random(11);
  std::uniform_real_distribution<double> unit(-1, 1);
  Points plane, cube, line, nan;
  for (int i = 0; i < 2000; ++i) {
    plane.emplace_back(100 * unit(random), 100 * unit(random), 0);
    cube.emplace_back(100 * unit(random), 100 * unit(random), 100 * unit(random));
    line.emplace_back(i, 0, 0);
    nan.emplace_back(std::nan(""), 1, std::numeric_limits<double>::infinity());
  }
  for (const Points& points : {Points{}, Points{{1, 2, 3}}, plane, cube, line, nan}) {
    for (const TubeModel model :
         {TubeModel::kAuto, TubeModel::kTube, TubeModel::kCanal, TubeModel::kFreeform}) {
      for (const SpineMethod method : {SpineMethod::kMls, SpineMethod::kShrinking}) {
        const auto result = Measure(points, model, method);
        ASSERT_FALSE(result);
        EXPECT_EQ(result.error().kind, hal::ErrorKind::kBadInput);
        EXPECT_FALSE(result.error().message.empty());
      }
    }
  }
}

}  // namespace
}  // namespace bendloop::pipeline
