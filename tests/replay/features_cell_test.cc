// SPDX-License-Identifier: Apache-2.0
// What is cut into a tube, through the daemon: its result, verdict, report and text.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <numbers>

#include "hal/spine.h"
#include "live_cell.h"
#include "pipeline/tube/representations.h"
#include "tests/support/reversed_features.h"

namespace bendloop::testing {
namespace {

using ::testing::HasSubstr;

double Turn(double a_deg, double b_deg) { return std::remainder(a_deg - b_deg, 360.0); }

hal::TubeFeatures Cut(double length_mm) {
  hal::TubeFeatures features;
  features.first_end = {4, 40};
  features.last_end = {6, -120};
  features.openings = {
      {30, 60, 3, 3, 0}, {length_mm - 60, -100, 7, 3, 25}, {length_mm - 30, 10, 2.5, 2.5, 0}};
  features.dents = {{60, -70, 0.3, 1.6}};
  return features;
}

// The part as it is cut, with a hole that nobody drilled.
void WritePart(const LiveCell& cell) {
  const std::string shipped = BENDLOOP_SOURCE_DIR "/config/parts/demo.toml";
  std::ofstream(cell.scratch() / "part.toml")
      << Slurp(shipped)
      << "\n[[hole]]\nfrom_start_mm = 30\naround_deg = 60\ndiameter_mm = 3\n"
         "around_tolerance_deg = 8\n"
         "\n[[hole]]\nfrom_start_mm = 45\naround_deg = 150\n"
         "diameter_mm = 3\n";
  std::string toml = Slurp(cell.cell_file());
  toml.replace(toml.find(shipped), shipped.size(), "part.toml");
  std::ofstream(cell.cell_file()) << toml;
}

void ExpectEnds(const pipeline::Measurement& m, const hal::BendProgram& tube,
                const hal::TubeFeatures& cut) {
  for (const bool at_start : {true, false}) {
    SCOPED_TRACE(at_start);
    const auto& found = at_start ? m.features.first_end : m.features.last_end;
    const hal::EndCut& truth = at_start ? cut.first_end : cut.last_end;
    ASSERT_TRUE(found);
    EXPECT_NEAR(found->cut.obliquity_deg, truth.obliquity_deg, 3 * found->obliquity_sigma_deg);
    EXPECT_LT(std::abs(Turn(found->cut.around_deg, truth.around_deg)), 3 * found->around_sigma_deg);
    EXPECT_LT(found->obliquity_sigma_deg, 1.0);
    const std::size_t row = at_start ? 0 : tube.rows.size() - 1;
    EXPECT_NEAR(m.tube.program.rows[row].length_mm, tube.rows[row].length_mm,
                3 * m.sigma.rows[row].length_mm);
  }
}

// All openings, by their places, and nothing else.
void ExpectOpenings(const pipeline::Measurement& m, double length_mm,
                    const hal::TubeFeatures& cut) {
  EXPECT_EQ(m.features.openings.size(), cut.openings.size());
  const double longer_mm = hal::SpineLength(m.tube.program) - length_mm;
  for (const hal::WallOpening& truth : cut.openings) {
    SCOPED_TRACE(truth.along_mm);
    const double at_mm = truth.along_mm + (truth.along_mm > 0.5 * length_mm ? longer_mm : 0);
    const auto found = std::find_if(
        m.features.openings.begin(), m.features.openings.end(),
        [&](const auto& opening) { return std::abs(opening.opening.along_mm - at_mm) < 2; });
    ASSERT_NE(found, m.features.openings.end());
    const hal::WallOpening &is = found->opening, &sigma = found->sigma;
    EXPECT_EQ(is.is_hole(), truth.is_hole());
    EXPECT_NEAR(is.along_mm, at_mm, 3 * sigma.along_mm);
    EXPECT_LT(std::abs(Turn(is.around_deg, truth.around_deg)), 3 * sigma.around_deg);
    EXPECT_NEAR(is.width_mm, truth.width_mm, 3 * sigma.width_mm);
    EXPECT_NEAR(is.length_mm, truth.length_mm, 3 * sigma.length_mm);
    EXPECT_LT(sigma.width_mm, 0.15);
    if (truth.is_hole()) continue;
    EXPECT_LT(std::abs(std::remainder(is.axis_deg - truth.axis_deg, 180.0)), 3 * sigma.axis_deg);
  }
}

void ExpectDent(const pipeline::Measurement& m, const hal::PressedDent& truth) {
  ASSERT_EQ(m.dents.size(), 1U);
  const pipeline::DentFound& dent = m.dents.front();
  EXPECT_NEAR(dent.along_mm, truth.along_mm, 3 * dent.along_sigma_mm);
  EXPECT_LT(std::abs(Turn(dent.around_deg, truth.around_deg)), 3 * dent.around_sigma_deg);
  EXPECT_LT(dent.around_sigma_deg, 1.0);
  EXPECT_NEAR(dent.depth_mm, truth.depth_mm, 3 * dent.sigma_mm);
  const double area_mm2 =
      2 * std::numbers::pi * std::numbers::ln2 * truth.width_mm * truth.width_mm;
  EXPECT_NEAR(dent.area_mm2, area_mm2, 3 * dent.area_sigma_mm2);
  EXPECT_LT(dent.area_sigma_mm2, 0.2 * area_mm2);
}

// Four views; lines of a hand or an arm, none at the same places as another pass's.
std::shared_ptr<const drivers::VirtualScan> ScanOf(const hal::Tube& tube,
                                                   const hal::TubeFeatures& cut,
                                                   std::uint64_t seed) {
  drivers::VirtualScanOptions options;
  options.features = cut;
  options.seed = seed;
  options.rays = 160;
  options.fan_half_angle_deg = 6;  // most of them on the tube
  options.path.profile_spacing_mm = 0.5;
  options.path.views_deg = drivers::SpreadViewsDeg(4, true);
  options.path.jitter_mm = 0.1;
  options.path.jitter_deg = 0.1;
  options.profiles_per_second = 8000;
  options.start_t_ns = static_cast<std::int64_t>(seed) * 100'000'000'000;
  return std::make_shared<const drivers::VirtualScan>(drivers::LayOnTable(tube, seed), options);
}

TEST(FeaturesCell, EndsHolesSlotAndDentAreMeasuredThroughTheDaemon) {
  LiveCell cell;
  WritePart(cell);
  cell.StartDaemon();
  for (std::uint64_t part = 1; part <= 2; ++part) {
    SCOPED_TRACE(part);
    const hal::Tube tube{cell.plan().pipe_radius_mm, cell.Bend(), {}};
    const double length_mm = hal::SpineLength(tube.program);
    hal::TubeFeatures cut = Cut(length_mm);
    cell.Trigger(ScanOf(tube, cut, part));
    const auto result = cell.Result(static_cast<unsigned>(part));
    ASSERT_TRUE(result) << cell.log();
    ASSERT_TRUE(result->inspection);
    hal::BendProgram scanned = tube.program;
    if (result->inspection->direction.reversed) {  // the scan began at its other end
      cut = tests::ReversedFeatures(cut, tube);
      scanned = pipeline::ReverseProgram(tube.program);
    }
    ExpectEnds(result->measurement, scanned, cut);
    ExpectOpenings(result->measurement, length_mm, cut);
    ExpectDent(result->measurement, cut.dents.front());
    const auto& judged = result->inspection->features.openings;
    ASSERT_EQ(judged.size(), 2U);
    EXPECT_EQ(judged[0].state, pipeline::OpeningState::kFound);
    EXPECT_EQ(judged[1].state, pipeline::OpeningState::kMissing);
  }
  cell.StopDaemon();
  const std::string report = Slurp(cell.scratch() / "state/report.html");
  EXPECT_THAT(report, HasSubstr("the surface unrolled"));
  EXPECT_THAT(report, HasSubstr("Dents; the area"));
}

}  // namespace
}  // namespace bendloop::testing
