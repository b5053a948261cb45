// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/surface_form.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <optional>
#include <random>
#include <string>

#include "hal/spine.h"
#include "pipeline/fit/report_quality.h"
#include "pipeline/reconstruction.h"
#include "tests/support/real_tube.h"
#include "tests/support/synthetic_cloud.h"
#include "tests/unit/fit/three_bends.h"

namespace bendloop::pipeline {
namespace {

hal::Tube TwoBends() {
  hal::Tube tube;
  tube.pipe_radius_mm = 5;
  tube.program.rows = {{60, 0, 60, 15}, {80, 80, 90, 15}, {70, 0, 0, {}}};
  return tube;
}

Measurement Measured(const tests::RealCloud& cloud) {
  ReconstructionOptions options;
  options.nominal = cloud.truth.program;
  const auto found = Reconstruct(cloud.points_W, options, kClock);
  EXPECT_TRUE(found) << found.error().message;
  return found ? *found : Measurement{};
}

bool IsReversed(const Measurement& found) {
  return std::abs(found.tube.program.rows[0].angle_deg - 60) > 5;
}

bool Says(const Measurement& found, const std::string& what) {
  return std::any_of(found.warnings.begin(), found.warnings.end(),
                     [&what](const std::string& w) { return w.find(what) != std::string::npos; });
}

TEST(SurfaceForm, BowsAreStraightness) {
  std::mt19937_64 random(1);
  const double bow = 1.0 / 500;
  const Measurement found = Measured(tests::ScanRealTube(TwoBends(), {.bow = bow}, {}, random));
  ASSERT_EQ(found.straights.size(), 3U);
  for (const StraightForm& straight : found.straights) {
    ASSERT_GT(straight.length_mm, 40);
    // The height of an arc over a part of it falls with the square of the part's length.
    const double part = straight.length_mm / (straight.length_mm + 5);
    EXPECT_NEAR(straight.height_mm, bow * straight.length_mm * part,
                4 * straight.sigma_mm + 0.1 * bow * straight.length_mm);
  }
}

TEST(SurfaceForm, StraightTubesAreStraightAndHaveNoDents) {
  for (unsigned seed = 1; seed <= 3; ++seed) {
    std::mt19937_64 random(seed);
    const Measurement found = Measured(tests::ScanRealTube(TwoBends(), {}, {}, random));
    ASSERT_EQ(found.straights.size(), 3U);
    for (const StraightForm& straight : found.straights) {
      EXPECT_LT(straight.height_mm, 5 * straight.sigma_mm);
      EXPECT_LT(straight.sigma_mm, 0.01);
    }
    EXPECT_TRUE(found.dents.empty());
    EXPECT_EQ(found.first_end.length_mm, 0);
    EXPECT_EQ(found.last_end.continues_mm, 0);
  }
}

// The same scan with the dent and without: what it hides widens the sigma, and nothing else moves.
TEST(SurfaceForm, ADentBowsNoStraight) {
  constexpr int kTubes = 12;
  double sigmas2 = 0;
  for (int i = 0; i < kTubes; ++i) {
    SCOPED_TRACE(i);
    const tests::Form plain{.bow = i % 2 == 0 ? 0.0 : 1.0 / 1000};
    tests::Form dented = plain;
    dented.dents = {{.along = std::array{0.12, 0.5, 0.88}.at(i % 3),
                     .around_rad = 0.9 * i,
                     .depth_r = 0.03 + 0.17 * i / kTubes,
                     .width_r = 0.5 + 0.25 * (i % 5)}};
    std::mt19937_64 random(20 + i), again(20 + i);
    const Measurement with = Measured(tests::ScanRealTube(TwoBends(), dented, {}, random));
    const Measurement without = Measured(tests::ScanRealTube(TwoBends(), plain, {}, again));
    ASSERT_EQ(with.straights.size(), 3U);
    ASSERT_EQ(without.straights.size(), 3U);
    double worst = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      const StraightForm &has = with.straights[k], &had = without.straights[k];
      EXPECT_LT(has.sigma_mm, 0.05);
      const double off = (has.height_mm - had.height_mm) / std::hypot(has.sigma_mm, had.sigma_mm);
      EXPECT_LT(std::abs(off), 4);
      worst = std::max(worst, std::abs(off));
    }
    sigmas2 += worst * worst / kTubes;
  }
  EXPECT_LT(std::sqrt(sigmas2), 2);
}

TEST(SurfaceForm, ADentIsFoundWhereItIs) {
  std::mt19937_64 random(6);
  const double depth_r = 0.08;
  const tests::Form form{.dents = {{.along = 0.5, .around_rad = 1.0, .depth_r = depth_r}}};
  const Measurement found = Measured(tests::ScanRealTube(TwoBends(), form, {}, random));
  ASSERT_EQ(found.dents.size(), 1U);
  const double length_mm = hal::SpineLength(found.tube.program);
  const DentFound& dent = found.dents[0];
  EXPECT_NEAR(dent.along_mm, 0.5 * length_mm, 4);
  EXPECT_NEAR(dent.depth_mm, depth_r * 5, 3 * dent.sigma_mm);
  EXPECT_LT(dent.sigma_mm, 0.03);
  // A gaussian of 4 mm is half as deep at 1.177 of it.
  EXPECT_NEAR(dent.area_mm2, std::numbers::pi * std::pow(1.1774 * 4, 2), 3 * dent.area_sigma_mm2);
  EXPECT_LT(dent.area_sigma_mm2, 0.1 * dent.area_mm2);
}

// Cells of half a pipe radius show a quarter to a half of the depth of dents that are two of them
// wide.
TEST(SurfaceForm, SmallDentsAreFoundByTheirPoints) {
  constexpr int kTubes = 8;
  std::mt19937_64 random(8);
  double sigmas2 = 0;
  for (int i = 0; i < kTubes; ++i) {
    const double depth_r = 0.025 + 0.025 * i / kTubes;
    const tests::Form form{.dents = {{.along = 0.1 + 0.8 * i / kTubes,
                                      .around_rad = 0.7 * i,
                                      .depth_r = depth_r,
                                      .width_r = 0.3 + 0.02 * i}}};
    const tests::RealScan scan{.points = 40'000, .noise_mm = 0.015};
    const Measurement found = Measured(tests::ScanRealTube(TwoBends(), form, scan, random));
    ASSERT_EQ(found.dents.size(), 1U) << i;
    const double length_mm = hal::SpineLength(found.tube.program);
    const double along_mm = form.dents.front().along * length_mm;
    EXPECT_NEAR(found.dents.front().along_mm, IsReversed(found) ? length_mm - along_mm : along_mm,
                0.5);
    const double off_mm = found.dents.front().depth_mm - depth_r * 5;
    sigmas2 += std::pow(off_mm / found.dents.front().sigma_mm, 2) / kTubes;
  }
  EXPECT_LT(std::sqrt(sigmas2), 1.6);
}

// A bend's wall goes on from piece to piece, and is not round.
TEST(SurfaceForm, ADentInAnEasedOvalBendIsFoundOnce) {
  std::mt19937_64 random(2);
  const tests::Form form{
      .easing_r = 0.5, .ovality = 0.04, .dents = {{.along = 0.67, .depth_r = 0.05}}};
  const tests::RealScan scan{.points = 30'000, .noise_mm = 0.02};
  const Measurement found = Measured(tests::ScanRealTube(TwoBends(), form, scan, random));
  EXPECT_FALSE(found.easing.empty());
  ASSERT_EQ(found.dents.size(), 1U);
  EXPECT_NEAR(found.dents[0].along_mm, 0.67 * hal::SpineLength(found.tube.program), 2);
  EXPECT_NEAR(found.dents[0].depth_mm, 0.25, 0.03);
}

TEST(SurfaceForm, AFewPointsAtTheEdgeOfWhatIsSeenAreNoDent) {
  // Of seeds 1 to 14 the one whose cells at the edge looked like a dent of 0.06 mm.
  std::mt19937_64 random(5);
  tests::CloudOptions cloud;
  cloud.points = 30'000;
  cloud.view_W = Eigen::Vector3d(0.36, 0.48, 0.8);
  const auto found =
      Reconstruct(tests::SyntheticCloud(tests::PaperTube(), cloud, random), {}, kClock);
  ASSERT_TRUE(found) << found.error().message;
  EXPECT_TRUE(found->dents.empty());
}

TEST(EndForms, TheLengthIsUpToTheEndOfWhatSitsOnIt) {
  using enum tests::EndFitting;
  for (const tests::EndFitting fitting : {kNut, kFlange}) {
    SCOPED_TRACE(static_cast<int>(fitting));
    std::mt19937_64 random(3);
    const auto cloud = tests::ScanRealTube(TwoBends(), {.at_end = fitting}, {}, random);
    const Measurement found = Measured(cloud);
    ASSERT_EQ(found.tube.program.rows.size(), 3U);
    const bool reversed = IsReversed(found);
    const EndForm& end = reversed ? found.first_end : found.last_end;
    EXPECT_GT(end.length_mm, 0);
    EXPECT_EQ((reversed ? found.last_end : found.first_end).length_mm, 0);
    const std::size_t row = reversed ? 0 : 2;
    EXPECT_NEAR(found.tube.program.rows[row].length_mm, cloud.truth.program.rows[2].length_mm,
                5 * found.sigma.rows[row].length_mm);
    EXPECT_LT(found.sigma.rows[row].length_mm, 1.5);
    EXPECT_TRUE(Says(found, "something thicker than the tube sits on its"));
  }
}

TEST(EndForms, BeadsAndFlaresBeginWhereTheirFlanksDo) {
  using enum tests::EndFitting;
  for (const tests::EndFitting fitting : {kBead, kFlare}) {
    SCOPED_TRACE(static_cast<int>(fitting));
    std::mt19937_64 random(5);
    const auto cloud = tests::ScanRealTube(TwoBends(), {.at_end = fitting}, {}, random);
    const Measurement found = Measured(cloud);
    ASSERT_EQ(found.tube.program.rows.size(), 3U);
    const bool reversed = IsReversed(found);
    const EndForm& end = reversed ? found.first_end : found.last_end;
    EXPECT_TRUE((reversed ? found.last_end : found.first_end).profile.empty());
    ASSERT_FALSE(end.profile.empty());
    const bool is_bead = fitting == kBead;
    EXPECT_NEAR(end.begins_mm, (is_bead ? 1.6 : 1.5) * 5, 3 * end.begins_sigma_mm);
    EXPECT_LT(end.begins_sigma_mm, 0.6);
    EXPECT_EQ(end.returns_sigma_mm > 0, is_bead);
    if (is_bead) {
      EXPECT_NEAR(end.returns_mm, 0.8 * 5, 3 * end.returns_sigma_mm);
    }
    double widest_mm = 0;
    for (const RadiusAt& at : end.profile) widest_mm = std::max(widest_mm, at.radius_mm);
    EXPECT_NEAR(widest_mm, (is_bead ? 1.25 : 1.4) * 5, 0.2);
    const std::size_t row = reversed ? 0 : 2;
    EXPECT_NEAR(found.tube.program.rows[row].length_mm, cloud.truth.program.rows[2].length_mm,
                5 * found.sigma.rows[row].length_mm);
  }
}

// A rod lies across before the end, 2.2 pipe radii from its middle to the tube's axis.
TEST(EndForms, WhatPassesAnEndIsNoFitting) {
  for (int seed = 1; seed <= 6; ++seed) {
    SCOPED_TRACE(seed);
    std::mt19937_64 random(static_cast<std::uint64_t>(seed));
    auto cloud = tests::ScanRealTube(TwoBends(), {}, {}, random);
    const auto segments = hal::SpineSegments(cloud.truth.program, cloud.truth.X_WT);
    const hal::SpineSegment& last = segments.back();
    const Eigen::Matrix3d axes = last.axes();
    const Eigen::Vector3d side = axes * Eigen::Vector3d(0, std::cos(seed), std::sin(seed)),
                          along = side.cross(axes.col(0));
    const Eigen::Vector3d middle = last.PointAt(last.length_mm) + 2 * axes.col(0) + 11 * side;
    std::uniform_real_distribution<double> turn(0, 2 * std::numbers::pi), place(-20, 20);
    for (int i = 0; i < 4000; ++i) {
      const double phi = turn(random);
      cloud.points_W.push_back(middle + place(random) * along +
                               5 * (std::cos(phi) * side + std::sin(phi) * axes.col(0)));
    }
    const Measurement found = Measured(cloud);
    ASSERT_EQ(found.tube.program.rows.size(), 3U);
    EXPECT_EQ(found.first_end.length_mm, 0);
    EXPECT_EQ(found.last_end.length_mm, 0);
  }
}

// The tube lies on a table, which is seen beside it on its lower sides, where the tube is not.
TEST(EndForms, ATableBelowAnEndIsNoFitting) {
  std::mt19937_64 random(1);
  std::uniform_real_distribution<double> part(0, 1);
  constexpr double kTubeMm = 5;
  for (int seen_deg = 180; seen_deg <= 240; seen_deg += 10) {
    SCOPED_TRACE(seen_deg);
    std::vector<Eigen::Vector3d> points;
    const double seen = seen_deg * std::numbers::pi / 180;
    for (int i = 0; i < 6000; ++i) {
      const double around = 0.5 * std::numbers::pi + (part(random) - 0.5) * seen;
      points.emplace_back(-40 * part(random), kTubeMm * std::cos(around),
                          kTubeMm * std::sin(around));
      // Its shadow lies between.
      const double x = 80 * part(random) - 40, y = 40 * part(random) - 20;
      if (x < 0 && std::abs(y) < kTubeMm) continue;
      points.emplace_back(x, y, -kTubeMm);
    }
    const std::vector<PointBlock> blocks = {{Eigen::Vector3d::Zero(), 60, points}};
    const FoundEnd found =
        FindFitting({Eigen::Vector3d::Zero(), Eigen::Vector3d::UnitX()}, kTubeMm, 0.03, blocks);
    EXPECT_EQ(found.form.length_mm, 0);
  }
}

// Its end leans against the table: that passes on one side before the end, and on the other beyond.
TEST(EndForms, ATableThatAnEndLeansAgainstIsNoFitting) {
  std::mt19937_64 random(2);
  std::uniform_real_distribution<double> part(0, 1);
  constexpr double kTubeMm = 5;
  for (const double slope : {0.3, 0.6, 1.0, 1.5}) {
    SCOPED_TRACE(slope);
    std::vector<Eigen::Vector3d> points;
    for (int i = 0; i < 6000; ++i) {
      const double around = std::numbers::pi * (1.4 * part(random) - 0.2);
      points.emplace_back(-40 * part(random), kTubeMm * std::cos(around),
                          kTubeMm * std::sin(around));
      const double x = 60 * part(random) - 30, y = 40 * part(random) - 20;
      const double z = slope * (x - 0.5 * kTubeMm);  // crosses the axis beyond the end
      if (x > 0 || std::hypot(y, z) > kTubeMm) points.emplace_back(x, y, z);
    }
    const std::vector<PointBlock> blocks = {{Eigen::Vector3d::Zero(), 60, points}};
    const FoundEnd found =
        FindFitting({Eigen::Vector3d::Zero(), Eigen::Vector3d::UnitX()}, kTubeMm, 0.03, blocks);
    EXPECT_EQ(found.form.length_mm, 0);
  }
}

// Where bows are not found a slight bend may stand for them, and be as uncertain as it is slight.
TEST(ReportQuality, ABendThatIsHardlyKnownIsToldToBeDoubtful) {
  Measurement measurement;
  measurement.tube = ThreeBends();
  measurement.sigma = ThreeBends().program;
  for (hal::BendRow& row : measurement.sigma.rows) row.angle_deg = 0.1;
  SayUnsureBends(0.0, measurement);
  EXPECT_TRUE(measurement.warnings.empty());
  measurement.tube.program.rows[1].angle_deg = 1.4;
  measurement.sigma.rows[1].angle_deg = 1.7;
  SayUnsureBends(0.0, measurement);
  ASSERT_EQ(measurement.warnings.size(), 1U);
  EXPECT_NE(measurement.warnings.front().find("bend 2 turns by 1.40 +- 1.70"), std::string::npos);
}

// A dent beside a bend of 75 degrees made a bend of 2.5 more of it, 8 mm behind and in its plane.
TEST(ReportQuality, ASlightBendRightBesideAnotherInItsPlaneIsDoubtful) {
  SurfaceFit fit;
  fit.margin = 22;
  fit.tube = {
      5, {{{60, 0, 50, 19}, {65, -58, 73, 18}, {8, 0.5, 2.5, 19}, {53, 0, 0, std::nullopt}}}, {}};
  fit.sigma.rows.assign(4, {0.1, 1.3, 0.2, 0.3});
  const auto warnings = [&](std::optional<std::size_t> nominal_bends) {
    Measurement measurement;
    ReportQuality(fit, fit, {}, nominal_bends, measurement);
    return measurement.warnings;
  };
  ASSERT_EQ(warnings({}).size(), 1U);
  EXPECT_NE(warnings({}).front().find("bends 2 and 3"), std::string::npos);
  EXPECT_TRUE(warnings(3).empty()) << "the nominal has it";
  fit.tube.program.rows[2].rotation_deg = 40;
  EXPECT_TRUE(warnings({}).empty()) << "in another plane";
  fit.tube.program.rows[2].rotation_deg = 0.5;
  fit.tube.program.rows[2].length_mm = 30;
  EXPECT_TRUE(warnings({}).empty()) << "a clamp holds what is between";
}

// Passes that are 0.2 mm apart, seen from other sides before and after, look like a slight bend.
TEST(ReportQuality, ABendThatLeadsNoFurtherAsideThanSidesDisagreeIsDoubtful) {
  Measurement measurement;
  measurement.tube = {
      5,
      {{{28, 0, 35, 16.8}, {14, 127, 1.17, 16.8}, {11, 88, 47, 16.9}, {30, 0, 0, std::nullopt}}},
      {}};
  measurement.sigma.rows.assign(4, {0.2, 0.2, 0.15, 0.5});
  SayUnsureBends(0.0005, measurement);
  EXPECT_TRUE(measurement.warnings.empty());
  SayUnsureBends(0.053, measurement);
  ASSERT_EQ(measurement.warnings.size(), 1U);
  EXPECT_NE(measurement.warnings.front().find("bend 2 turns by 1.17"), std::string::npos);
  EXPECT_NE(measurement.warnings.front().find("disagree"), std::string::npos);
}

// Of a bend of 90 degrees whose other end is thin 52 may be followed, and 3 mm of it look straight.
TEST(ReportQuality, ABendBesideAnEndThatGoesOnMayBeLonger) {
  for (const bool at_start : {true, false}) {
    for (const double straight_mm : {3.0, 30.0}) {
      Measurement measurement;
      measurement.tube = {
          5, {{{30, 0, 52, 17.5}, {30, 0, 40, 17.5}, {30, 0, 0, std::nullopt}}}, {}};
      measurement.sigma.rows.assign(3, {0.02, 0.02, 0.9, 0.1});
      (at_start ? measurement.tube.program.rows.front() : measurement.tube.program.rows.back())
          .length_mm = straight_mm;
      FoundEnd found;
      found.form.continues_mm = 80;
      ReportEndForm(at_start, found, measurement);
      const double sigma_deg = measurement.sigma.rows[at_start ? 0 : 1].angle_deg;
      EXPECT_EQ(sigma_deg, straight_mm > 10 ? 0.9 : at_start ? 26 : 20);
      EXPECT_EQ(measurement.sigma.rows[at_start ? 1 : 0].angle_deg, 0.9);
      EXPECT_EQ(measurement.warnings.size(), straight_mm > 10 ? 1U : 2U);
    }
  }
}

// The tube's first straight ends 13 mm beside its fourth bend.
TEST(EndForms, ABendBesideTheEndIsNoFitting) {
  hal::Tube tube;
  tube.pipe_radius_mm = 5;
  tube.program.rows = {{59, 0, 27.25, 11.32},        {38.03, -34.22, 89.7, 11.32},
                       {21.83, -17.04, 74.9, 11.32}, {51.78, 55.6, 59, 11.32},
                       {52.03, 40.24, 54.56, 11.32}, {55.78, 0, 0, {}}};
  std::mt19937_64 random(3);
  const auto cloud = tests::ScanRealTube(tube, {}, {}, random);
  const auto found = Reconstruct(cloud.points_W, {}, kClock);
  ASSERT_TRUE(found.has_value());
  EXPECT_EQ(found->first_end.length_mm, 0);
  EXPECT_EQ(found->last_end.length_mm, 0);
  const double lengths_mm =
      found->tube.program.rows.front().length_mm + found->tube.program.rows.back().length_mm;
  EXPECT_NEAR(lengths_mm, 59 + 55.78, 1);
}

// Nodes that lead from an end to another part of the tube, and a dent where the tube ends.
TEST(ReportQuality, AnEndBendWithNextToNothingBeyondItIsToldToBeDoubtful) {
  const auto said = [](double angle_deg, double last_mm, double used_beyond, bool dented,
                       std::optional<std::size_t> nominal_bends) {
    Measurement m;
    m.tube = TwoBends();
    auto& rows = m.tube.program.rows;
    rows[1].angle_deg = angle_deg;
    rows[2].length_mm = last_mm;
    SurfaceFit fit;
    fit.tube = m.tube;
    fit.used = static_cast<std::size_t>(50 * hal::SpineLength(m.tube.program));
    fit.segment_used = {3000, 500, 3000, 500, used_beyond};
    if (dented) {
      m.dents.emplace_back();
      m.dents.back().along_mm = hal::SpineLength(m.tube.program) - last_mm - 3;
    }
    SayDoubtfulEndBends(fit, nominal_bends, m);
    return m.warnings.size();
  };
  EXPECT_EQ(said(2, 40, 2000, false, {}), 0U);
  EXPECT_EQ(said(2, 40, 100, false, {}), 1U);
  EXPECT_EQ(said(2, 40, 100, false, 1U), 1U);
  EXPECT_EQ(said(2, 40, 100, false, 2U), 0U);
  EXPECT_EQ(said(30, 40, 100, false, {}), 0U);
  EXPECT_EQ(said(30, 9, 450, false, {}), 0U);
  EXPECT_EQ(said(30, 9, 450, true, {}), 1U);
  EXPECT_EQ(said(30, 30, 1500, true, {}), 0U);
}

TEST(EndForms, SamplesThatGoOnThinlyAreTold) {
  hal::Tube tube = TwoBends();
  std::mt19937_64 random(4);
  auto cloud = tests::ScanRealTube(tube, {}, {}, random);
  tests::RealScan thin{.points = 120};
  tube.program.rows.back().length_mm += 60;
  std::vector<Eigen::Vector3d> beyond;
  const Eigen::Vector3d end = hal::SpineSegments(TwoBends().program, {}).back().PointAt(70);
  const Eigen::Vector3d along = hal::SpineSegments(TwoBends().program, {}).back().tangent;
  for (int i = 0; i < 20; ++i) {
    const auto more = tests::ScanRealTube(tube, {}, thin, random);
    for (const Eigen::Vector3d& p : more.points_W) {
      if ((p - end).dot(along) > 0 && (p - end).norm() < 65) beyond.push_back(p);
    }
  }
  ASSERT_GT(beyond.size(), 100U);
  for (std::size_t i = 0; i < beyond.size(); i += beyond.size() / 60) {
    cloud.points_W.push_back(beyond[i]);
  }
  const Measurement found = Measured(cloud);
  ASSERT_EQ(found.tube.program.rows.size(), 3U);
  const std::size_t row = IsReversed(found) ? 0 : 2;
  const double missing_mm = 130 - found.tube.program.rows[row].length_mm;
  EXPECT_LT(missing_mm, 4 * found.sigma.rows[row].length_mm);
  EXPECT_TRUE(missing_mm < 10 || Says(found, "samples go on for"));
}

}  // namespace
}  // namespace bendloop::pipeline
