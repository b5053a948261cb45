// SPDX-License-Identifier: Apache-2.0
// Virtual scans of tubes with oblique ends, holes, a slot and a dent, measured: what was cut is
// found, and of tubes that nothing was cut into nothing is.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "drivers/simulated_scanner/virtual_scan.h"
#include "hal/clock.h"
#include "hal/tube_features.h"
#include "pipeline/reconstruction.h"
#include "pipeline/tube/representations.h"
#include "tests/unit/tube_features/measured_scan.h"

namespace bendloop::pipeline {
namespace {

hal::Tube BentTube() {
  return {8, {{{90, 0, 60, 25.0}, {70, 90, 45, 25.0}, {80, 0, 0, std::nullopt}}}, {}};
}

drivers::VirtualScanOptions AllAround(std::uint64_t seed) {
  drivers::VirtualScanOptions options;
  options.seed = seed;
  options.rays = 320;
  options.path.profile_spacing_mm = 0.5;
  options.path.views_deg = drivers::SpreadViewsDeg(4, true);
  return options;
}

double Turn(double a_deg, double b_deg) { return std::remainder(a_deg - b_deg, 360.0); }

// Errors of values beside their sigma: of many one may be beyond 3 by chance (four rays lost on
// one side of a hole, say), none beyond 4.
class SigmasOf {
 public:
  void Add(double error, double sigma) {
    EXPECT_LT(std::abs(error), 4 * sigma);
    beyond_3_ += std::abs(error) < 3 * sigma ? 0 : 1;
    ++count_;
  }
  int beyond_3() const { return beyond_3_; }
  int count() const { return count_; }

 private:
  int beyond_3_ = 0, count_ = 0;
};

void ScoreCuts(std::uint64_t seed, SigmasOf& sigmas) {
  const hal::Tube tube = drivers::LayOnTable(BentTube(), 4);
  drivers::VirtualScanOptions options = AllAround(seed);
  const double length_mm = hal::SpineLength(tube.program);
  options.features.first_end = {2.5, 40};
  options.features.last_end = {4.0, -120};
  options.features.openings = {
      {30, 60, 6, 6, 0}, {60, -100, 12, 5, 25}, {length_mm - 35, 10, 5, 5, 0}};
  const Measurement m = MeasureScan(tube, options);
  const TubeFeaturesFound& found = m.features;

  ASSERT_TRUE(found.first_end);
  sigmas.Add(found.first_end->cut.obliquity_deg - 2.5, found.first_end->obliquity_sigma_deg);
  sigmas.Add(Turn(found.first_end->cut.around_deg, 40), found.first_end->around_sigma_deg);
  EXPECT_LT(found.first_end->obliquity_sigma_deg, 1.0);
  ASSERT_TRUE(found.last_end);
  sigmas.Add(found.last_end->cut.obliquity_deg - 4.0, found.last_end->obliquity_sigma_deg);
  sigmas.Add(Turn(found.last_end->cut.around_deg, -120), found.last_end->around_sigma_deg);
  // To the planes at the axis, not to where the long sides stop.
  sigmas.Add(m.tube.program.rows.front().length_mm - 90, m.sigma.rows.front().length_mm);
  sigmas.Add(m.tube.program.rows.back().length_mm - 80, m.sigma.rows.back().length_mm);

  ASSERT_EQ(found.openings.size(), options.features.openings.size());
  for (std::size_t i = 0; i < found.openings.size(); ++i) {
    SCOPED_TRACE(i);
    const hal::WallOpening& truth = options.features.openings[i];
    const hal::WallOpening& opening = found.openings[i].opening;
    const hal::WallOpening& sigma = found.openings[i].sigma;
    EXPECT_EQ(opening.is_hole(), truth.is_hole());
    sigmas.Add(opening.width_mm - truth.width_mm, sigma.width_mm);
    sigmas.Add(opening.length_mm - truth.length_mm, sigma.length_mm);
    sigmas.Add(Turn(opening.around_deg, truth.around_deg), sigma.around_deg);
    const double from_end_mm =
        truth.along_mm > 0.5 * length_mm
            ? (hal::SpineLength(m.tube.program) - opening.along_mm) - (length_mm - truth.along_mm)
            : opening.along_mm - truth.along_mm;
    sigmas.Add(from_end_mm, sigma.along_mm);
    EXPECT_LT(sigma.width_mm, 0.1);
    if (truth.is_hole()) continue;
    sigmas.Add(std::remainder(opening.axis_deg - truth.axis_deg, 180.0), sigma.axis_deg);
  }
}

TEST(CutScan, FindsEndsHolesAndSlot) {
  SigmasOf sigmas;
  for (const std::uint64_t seed : {4U, 6U, 7U}) {
    SCOPED_TRACE(seed);
    ScoreCuts(seed, sigmas);
  }
  EXPECT_EQ(sigmas.count(), 3 * 19);
  EXPECT_LE(sigmas.beyond_3(), 1);
}

// Holes that few lines cross. Rays that went through are known: what such a hole lacks need not be
// so much that nothing else could be the reason. 4 of 36 were told before.
TEST(CutScan, FindsHolesThatFewLinesCross) {
  const hal::Tube tube = drivers::LayOnTable(BentTube(), 4);
  const double length_mm = hal::SpineLength(tube.program);
  std::vector<hal::WallOpening> holes;
  for (int i = 0; i < 6; ++i) {
    const double size_mm = 2.2 + 0.04 * i;
    holes.push_back({20.0 + 12.0 * i, 60.0 * i - 150, size_mm, size_mm, 0});
  }
  int found = 0;
  SigmasOf sigmas;
  for (std::uint64_t seed = 1; seed <= 6; ++seed) {
    SCOPED_TRACE(seed);
    drivers::VirtualScanOptions options = AllAround(seed);
    options.path.profile_spacing_mm = 0.7;
    options.features.openings = holes;
    const Measurement m = MeasureScan(tube, options);
    for (const OpeningFound& of : m.features.openings) {
      // From either end, as the scan began.
      const double along_mm = of.opening.along_mm;
      const auto truth = std::find_if(holes.begin(), holes.end(), [&](const auto& hole) {
        return std::min(std::abs(along_mm - hole.along_mm),
                        std::abs(length_mm - along_mm - hole.along_mm)) < 2;
      });
      ASSERT_NE(truth, holes.end());
      ++found;
      sigmas.Add(of.opening.width_mm - truth->width_mm, of.sigma.width_mm);
    }
  }
  EXPECT_GE(found, 8);
  EXPECT_LE(sigmas.beyond_3(), 1);
}

// What the fit needs of a dense scan is no longer lines; openings and ends are looked for in these.
TEST(CutScan, IsReadInItsLinesHoweverFewPointsAreFitted) {
  const hal::Tube tube = drivers::LayOnTable(BentTube(), 4);
  drivers::VirtualScanOptions options = AllAround(9);
  options.features.last_end = {4.0, -120};
  // Narrower than what thinned points leave between them.
  options.features.openings = {{35, 60, 6, 1.6, 25}, {110, -100, 2.4, 2.4, 0}};
  const Measurement all = MeasureScan(tube, options);
  ReconstructionOptions few;
  few.max_points = 5'000;
  const Measurement m = MeasureScan(tube, options, few);
  ASSERT_EQ(all.features.openings.size(), 2U);
  ASSERT_EQ(m.features.openings.size(), 2U);
  for (std::size_t i = 0; i < 2; ++i) {
    SCOPED_TRACE(i);
    const OpeningFound &full = all.features.openings[i], &thin = m.features.openings[i];
    EXPECT_NEAR(thin.opening.width_mm, full.opening.width_mm, full.sigma.width_mm);
    EXPECT_NEAR(thin.opening.length_mm, full.opening.length_mm, full.sigma.length_mm);
    EXPECT_LT(thin.sigma.width_mm, 1.3 * full.sigma.width_mm);
  }
  ASSERT_TRUE(all.features.last_end && m.features.last_end);
  EXPECT_LT(m.features.last_end->obliquity_sigma_deg,
            1.3 * all.features.last_end->obliquity_sigma_deg);
}

// Most of what the scanner sees is no tube: lines on it were thinned with those on the table, and
// the end was known a tenth as well.
TEST(CutScan, ATableTakesNoneOfItsRoom) {
  const hal::Tube tube = drivers::LayOnTable(BentTube(), 4);
  drivers::VirtualScanOptions options = AllAround(9);
  options.features.last_end = {4.0, -120};
  options.clutter.table = true;
  options.clutter.table_gap_mm = 20;
  const Measurement all = MeasureScan(tube, options);
  ReconstructionOptions few;
  few.max_points = 20'000;
  const Measurement m = MeasureScan(tube, options, few);
  ASSERT_TRUE(all.features.last_end && m.features.last_end);
  EXPECT_LT(m.features.last_end->obliquity_sigma_deg,
            1.3 * all.features.last_end->obliquity_sigma_deg);
  EXPECT_GT(m.fit.samples, all.fit.samples / 2);
}

// A wide hole across a tight bend, drilled radially: what is left of that wall is no lean's oval.
TEST(CutScan, AHoleInABendIsRadial) {
  for (std::uint64_t seed = 1; seed <= 4; ++seed) {
    SCOPED_TRACE(seed);
    const hal::Tube tube =
        drivers::LayOnTable({20, {{{200, 0, 82, 44.0}, {180, 0, 0, std::nullopt}}}, {}}, seed);
    drivers::VirtualScanOptions options = AllAround(seed);
    options.rays = 200;
    options.fan_half_angle_deg = 9.3;
    options.path.profile_spacing_mm = 1.5;
    options.path.views_deg = drivers::SpreadViewsDeg(6, true);
    options.path.jitter_mm = options.path.jitter_deg = 0.1;
    options.features.openings = {{232, -100, 19, 19, 0}};
    const Measurement m = MeasureScan(tube, options);
    ASSERT_EQ(m.features.openings.size(), 1U);
    const OpeningFound& found = m.features.openings.front();
    ASSERT_TRUE(found.opening.is_hole());
    EXPECT_EQ(found.opening.lean_along_deg, 0);
    EXPECT_EQ(found.opening.lean_around_deg, 0);
    EXPECT_NEAR(found.opening.width_mm, 19, 3 * found.sigma.width_mm);
  }
}

TEST(CutScan, LeavesLengthsRotationsAndAnglesAlone) {
  const hal::Tube tube = drivers::LayOnTable(BentTube(), 4);
  drivers::VirtualScanOptions options = AllAround(4);
  options.features.openings = {{45, 60, 8, 8, 0}, {160, 0, 14, 6, 0}};
  const Measurement m = MeasureScan(tube, options);
  EXPECT_EQ(m.features.openings.size(), 2U);
  // Whichever end came first.
  const bool reversed = std::abs(m.tube.program.rows.front().angle_deg - 45) < 5;
  const hal::BendProgram rows = reversed ? ReverseProgram(m.tube.program) : m.tube.program;
  const hal::BendProgram sigmas = reversed ? ReverseProgram(m.sigma) : m.sigma;
  for (std::size_t i = 0; i < tube.program.rows.size(); ++i) {
    const hal::BendRow& truth = tube.program.rows[i];
    const hal::BendRow& row = rows.rows[i];
    const hal::BendRow& sigma = sigmas.rows[i];
    EXPECT_NEAR(row.length_mm, truth.length_mm, 3.5 * sigma.length_mm) << i;
    if (i + 1 == tube.program.rows.size()) continue;
    EXPECT_NEAR(row.angle_deg, truth.angle_deg, 3.5 * sigma.angle_deg) << i;
    if (i > 0) {
      EXPECT_LT(std::abs(Turn(row.rotation_deg, truth.rotation_deg)),
                3.5 * std::abs(sigma.rotation_deg));
    }
  }
}

// A part with legs that hide each other's walls, scanned at 0.5 mm lines; of its points as many are
// kept as the daemon keeps, so that lines have lost three rays in four.
Measurement MeasureThinned(std::uint64_t seed, const hal::TubeFeatures& features) {
  const hal::Tube part{4,
                       {{{85, 0, 45, 20.0},
                         {60, 70, 90, 20.0},
                         {110, -40, 30, 20.0},
                         {75, 155, 62, 20.0},
                         {140, 0, 0, std::nullopt}}},
                       {}};
  drivers::VirtualScanOptions options = AllAround(seed);
  options.rays = 160;
  options.fan_half_angle_deg = 6;
  options.path.jitter_mm = options.path.jitter_deg = 0.1;
  options.features = features;
  ReconstructionOptions kept;
  kept.max_points = 50'000;
  kept.nominal = part.program;
  return MeasureScan(drivers::LayOnTable(part, seed), options, kept);
}

TEST(ThinnedScan, HasNoOpeningWhereALegHidesTheWall) {
  for (const std::uint64_t seed : {1, 4, 6, 14}) {
    SCOPED_TRACE(seed);
    const Measurement m = MeasureThinned(seed, {});
    ASSERT_EQ(m.tube.program.rows.size(), 5U);
    EXPECT_TRUE(m.features.openings.empty())
        << m.features.openings.front().opening.along_mm << " mm, "
        << m.features.openings.front().opening.width_mm << " mm wide";
  }
}

// Where the slots lie no pass sees all of them.
TEST(ThinnedScan, FindsWhatIsCut) {
  for (const std::uint64_t seed : {3, 12, 18}) {
    SCOPED_TRACE(seed);
    hal::TubeFeatures cut;
    cut.openings = {
        {30, 60, 3, 3, 0}, {489, seed == 3 ? 85.0 : -165.0, 7.4, 2.8, 40}, {520, 120, 3, 3, 0}};
    const Measurement m = MeasureThinned(seed, cut);
    ASSERT_EQ(m.features.openings.size(), 3U);
    int slots = 0;
    for (const OpeningFound& found : m.features.openings) {
      const double true_mm = found.opening.is_hole() ? 3 : 2.8;
      EXPECT_NEAR(found.opening.width_mm, true_mm, 3.5 * found.sigma.width_mm);
      if (found.opening.is_hole()) continue;
      slots += 1;
      EXPECT_NEAR(found.opening.length_mm, 7.4, 3.5 * found.sigma.length_mm);
    }
    EXPECT_EQ(slots, 1);
  }
}

struct Plain {
  const char* name;
  int views;
  bool all_around;
  int rays;
  double spacing_mm;
  int clamps;
  bool table;
  double jitter_mm;
};

class PlainScan : public testing::TestWithParam<Plain> {};

TEST_P(PlainScan, HasNoOpeningsAndSquareEnds) {
  const Plain& plain = GetParam();
  const hal::Tube tube = drivers::LayOnTable(BentTube(), 7);
  drivers::VirtualScanOptions options;
  options.seed = 7;
  options.rays = plain.rays;
  options.path.profile_spacing_mm = plain.spacing_mm;
  options.path.views_deg = drivers::SpreadViewsDeg(plain.views, plain.all_around);
  options.path.jitter_mm = plain.jitter_mm;
  options.path.jitter_deg = plain.jitter_mm;
  options.clutter.clamps = plain.clamps;
  options.clutter.table = plain.table;
  const Measurement m = MeasureScan(tube, options);
  EXPECT_TRUE(m.features.openings.empty())
      << m.features.openings.front().opening.along_mm << " mm, "
      << m.features.openings.front().opening.around_deg << " degrees, "
      << m.features.openings.front().opening.width_mm << " mm";
  // A table has far more samples than the tube, which is no thinner for it.
  EXPECT_EQ(m.first_end.continues_mm, 0);
  EXPECT_EQ(m.last_end.continues_mm, 0);
  for (const auto* end : {&m.features.first_end, &m.features.last_end}) {
    if (*end) {
      EXPECT_LT((*end)->cut.obliquity_deg, 5 * (*end)->obliquity_sigma_deg);
      EXPECT_FALSE((*end)->bevel || (*end)->burr);
      EXPECT_TRUE((*end)->border.empty());
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Scans, PlainScan,
                         testing::Values(Plain{"OneView", 1, false, 320, 1.0, 0, false, 0},
                                         Plain{"Clamps", 3, false, 320, 1.0, 2, true, 0},
                                         Plain{"Thin", 3, true, 120, 3.0, 0, false, 0.2},
                                         Plain{"Dense", 4, true, 320, 0.5, 0, true, 0}),
                         [](const testing::TestParamInfo<Plain>& plain) {
                           return plain.param.name;
                         });

}  // namespace
}  // namespace bendloop::pipeline
