// SPDX-License-Identifier: Apache-2.0
#include "pipeline/structure/nominal_along.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <string>

#include "hal/clock.h"
#include "hal/spine.h"
#include "pipeline/fit/surface_points.h"
#include "pipeline/reconstruction.h"
#include "pipeline/tube/representations.h"
#include "tests/support/synthetic_cloud.h"

namespace bendloop::pipeline {
namespace {

SpinePolygon NodesOf(const hal::Tube& tube, double noise_mm, std::mt19937_64& random) {
  std::normal_distribution<double> noise(0, noise_mm);
  SpinePolygon nodes;
  for (const auto& segment : hal::SpineSegments(tube.program, tube.X_WT)) {
    for (double along = 0; along < segment.length_mm; along += 0.4 * tube.pipe_radius_mm) {
      const Eigen::Vector3d off(noise(random), noise(random), noise(random));
      nodes.push_back({segment.PointAt(along) + off, segment.TangentAt(along)});
    }
  }
  return nodes;
}

// What springback, slip and stretch make of a drawing.
hal::BendProgram Varied(hal::BendProgram program, std::mt19937_64& random) {
  std::normal_distribution<double> normal;
  for (std::size_t i = 0; i < program.bend_count(); ++i) {
    hal::BendRow& row = program.rows[i];
    row.length_mm = std::max(0.0, row.length_mm + normal(random));
    row.angle_deg = std::max(1.0, row.angle_deg + 2.0 * normal(random));
    if (i > 0) row.rotation_deg = hal::WrapRotationDeg(row.rotation_deg + normal(random));
  }
  return program;
}

TEST(NominalAlong, FollowsNodesOfAPartThatSprangBack) {
  std::mt19937_64 random(7);
  for (int i = 0; i < 25; ++i) {
    const hal::Tube part = tests::RandomTube({.bends = 1 + i % 8}, random);
    hal::BendProgram drawing = Varied(part.program, random);
    if (i % 2 == 1) drawing = ReverseProgram(drawing);
    const SpinePolygon nodes = NodesOf(part, 0.05, random);
    const hal::Tube along = NominalAlong(drawing, part.pipe_radius_mm, nodes);
    ASSERT_EQ(along.program.bend_count(), part.program.bend_count());
    for (std::size_t b = 0; b < part.program.bend_count(); ++b) {
      EXPECT_NEAR(along.program.rows[b].angle_deg, part.program.rows[b].angle_deg, 1.5)
          << i << ' ' << b;
    }
    EXPECT_TRUE(MayBe(drawing, along, along.program));
    // Every node is near its spine: a fit to the samples, which looks 0.35 r_P far, starts there.
    const auto segments = hal::SpineSegments(along.program, along.X_WT);
    const auto frames = SegmentFrames(segments);
    std::vector<std::int32_t> all(frames.size());
    for (std::size_t k = 0; k < all.size(); ++k) all[k] = static_cast<std::int32_t>(k);
    for (const SpineNode& node : nodes) {
      EXPECT_LT(NearestSegment(node.position_mm, frames, all).distance_mm,
                0.15 * part.pipe_radius_mm);
    }
  }
}

// What lies on its line beyond, as a strip of the table it lies on, speaks for no structure.
TEST(NominalAlong, EndsWhereItsNodesDo) {
  std::mt19937_64 random(9);
  for (int i = 0; i < 12; ++i) {
    const hal::Tube part = tests::RandomTube({.bends = i % 4}, random);
    hal::BendProgram drawing = part.program;
    drawing.rows.front().length_mm += 31;
    drawing.rows.back().length_mm += i % 2 == 0 ? 24 : -8;
    const SpinePolygon nodes = NodesOf(part, 0.05, random);
    const hal::Tube along = NominalAlong(drawing, part.pipe_radius_mm, nodes);
    const auto segments = hal::SpineSegments(along.program, along.X_WT);
    const double step_mm = 0.4 * part.pipe_radius_mm;
    const Eigen::Vector3d first_mm = segments.front().start_mm;
    const Eigen::Vector3d last_mm = segments.back().PointAt(segments.back().length_mm);
    // Either way round.
    const double as_drawn_mm = std::max((first_mm - nodes.front().position_mm).norm(),
                                        (last_mm - nodes.back().position_mm).norm());
    const double reversed_mm = std::max((last_mm - nodes.front().position_mm).norm(),
                                        (first_mm - nodes.back().position_mm).norm());
    EXPECT_LT(std::min(as_drawn_mm, reversed_mm), 2 * step_mm) << i;
  }
}

TEST(NominalAlong, AMissingOrAnotherBendIsNoVariation) {
  hal::Tube tube;
  tube.pipe_radius_mm = 4;
  tube.program.rows = {{60, 0, 4, 12}, {80, 90, 40, 12}, {60, 0, 0, std::nullopt}};
  hal::BendProgram sigma;
  sigma.rows = {{0.1, 0, 0.1, 1}, {0.1, 0.1, 0.1, 1}, {0.1, 0, 0, std::nullopt}};
  const hal::BendProgram drawing = tube.program;
  EXPECT_TRUE(MayBe(drawing, tube, sigma));
  tube.program.rows[0].angle_deg = 0.1;  // within what may spring back, but certainly not there
  EXPECT_FALSE(MayBe(drawing, tube, sigma));
  sigma.rows[0].angle_deg = 3;  // nobody knows
  EXPECT_TRUE(MayBe(drawing, tube, sigma));
  tube.program = drawing;
  tube.program.rows[1].angle_deg = 60;
  EXPECT_FALSE(MayBe(drawing, tube, sigma));
  tube.program = ReverseProgram(drawing);
  EXPECT_TRUE(MayBe(drawing, tube, ReverseProgram(sigma)));
}

// Bends that ease by a pipe radius and more look twice as wide, and straights as much shorter.
TEST(NominalAlong, RadiiAreNotAskedForWhereCornersAre) {
  hal::Tube tube;
  tube.pipe_radius_mm = 5;
  tube.program.rows = {
      {60, 0, 40, 12}, {50, 90, 60, 12}, {70, -30, 30, 12}, {60, 0, 0, std::nullopt}};
  const hal::BendProgram drawing = tube.program;
  hal::BendProgram sigma = drawing;
  for (hal::BendRow& row : sigma.rows) row = {0.1, 0.1, 0.1, 0.1};
  for (std::size_t i = 0; i < 3; ++i) {
    hal::BendRow& row = tube.program.rows[i];
    const double shorter_mm = 12 * std::tan(0.5 * row.angle_deg * 3.14159265358979 / 180);
    *row.bend_radius_mm += 12;
    row.length_mm -= shorter_mm;
    tube.program.rows[i + 1].length_mm -= shorter_mm;
  }
  EXPECT_FALSE(MayBe(drawing, tube, sigma));
  EXPECT_TRUE(MayBeByCorners(drawing, tube, sigma));
  tube.program.rows[1].rotation_deg += 20;
  EXPECT_FALSE(MayBeByCorners(drawing, tube, sigma));
  tube.program.rows.pop_back();
  EXPECT_FALSE(MayBeByCorners(drawing, tube, sigma));
}

Measurement Measured(const hal::Tube& part, const hal::BendProgram& drawing, double noise_mm,
                     std::size_t points) {
  std::mt19937_64 random(11);
  const hal::SteadyClock clock;
  const auto cloud = tests::SyntheticCloud(part, {.points = points, .noise_mm = noise_mm}, random);
  ReconstructionOptions options;
  options.nominal = drawing;
  auto measured = Reconstruct(cloud, options, clock);
  if (!measured) {
    ADD_FAILURE() << measured.error().message;
    return {};
  }
  return *measured;
}

hal::Tube WithSlightBend(double angle_deg) {
  hal::Tube tube;
  tube.pipe_radius_mm = 2;
  tube.program.rows = {
      {40, 0, 60, 8}, {30, 40, angle_deg, 8}, {30, 100, 45, 8}, {40, 0, 0, std::nullopt}};
  if (angle_deg > 0) return tube;
  tube.program.rows.erase(tube.program.rows.begin() + 1);
  tube.program.rows[1].length_mm = 60;
  return tube;
}

// A bend that the samples hardly show is taken from the nominal, and said to be: its own values
// are the samples', with the sigma that they have.
TEST(Nominal, DecidesWhereSamplesDoNot) {
  const hal::Tube part = WithSlightBend(0.35);
  EXPECT_EQ(Measured(part, WithSlightBend(0).program, 0.1, 2500).tube.program.bend_count(), 2u);
  const Measurement measured = Measured(part, part.program, 0.1, 2500);
  ASSERT_EQ(measured.tube.program.bend_count(), 3u);
  EXPECT_LT(measured.structure_margin, 10);
  ASSERT_FALSE(measured.warnings.empty());
  EXPECT_NE(measured.warnings[0].find("it is the nominal's"), std::string::npos);
}

TEST(Nominal, HidesNoDefect) {
  // A bend that no drawing shows, and one that the bender forgot.
  EXPECT_EQ(
      Measured(WithSlightBend(4), WithSlightBend(0).program, 0.05, 6000).tube.program.bend_count(),
      3u);
  EXPECT_EQ(
      Measured(WithSlightBend(0), WithSlightBend(4).program, 0.05, 6000).tube.program.bend_count(),
      2u);
}

}  // namespace
}  // namespace bendloop::pipeline
