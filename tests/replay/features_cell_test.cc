// SPDX-License-Identifier: Apache-2.0
// What is cut into a tube, through the daemon: its result, verdict, report and text.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <numbers>
#include <random>

#include "hal/spine.h"
#include "live_cell.h"
#include "pipeline/tube/representations.h"
#include "tests/support/reversed_features.h"

namespace bendloop::testing {
namespace {

using ::testing::HasSubstr;

double Turn(double a_deg, double b_deg) { return std::remainder(a_deg - b_deg, 360.0); }

// Of each part others, but for the hole that the part file names.
hal::TubeFeatures Cut(double length_mm, std::uint64_t part) {
  std::mt19937_64 random(part);
  const auto within = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  const auto around = [&] { return within(-180, 180); };
  hal::TubeFeatures features;
  features.first_end = {within(3, 8), around()};
  features.last_end = {within(3, 8), around()};
  const double second_mm = within(2.4, 3.2);
  features.openings = {
      {30, 60, 3, 3, 0},
      {length_mm - within(56, 64), around(), within(6, 8), within(2.6, 3.2), within(-80, 80)},
      {length_mm - within(26, 32), around(), second_mm, second_mm, 0}};
  features.dents = {{within(56, 62), around(), within(0.25, 0.4), within(1.4, 1.8)}};
  return features;
}

// Errors in sigmas of all values of all parts: each within three, and as large as they say.
class AllErrors {
 public:
  void Add(const char* what, double error, double sigma) {
    EXPECT_GT(sigma, 0) << what;
    EXPECT_LT(std::abs(error), 3 * sigma) << what << " is off by " << error;
    squares_ += std::pow(error / sigma, 2);
    count_ += 1;
  }
  double count() const { return count_; }
  double Rms() const { return std::sqrt(squares_ / count_); }

 private:
  double squares_ = 0, count_ = 0;
};

// The part as it is cut, with a hole that nobody drilled.
void WritePart(const LiveCell& cell) {
  const std::string shipped = BENDLOOP_SOURCE_DIR "/config/parts/demo.toml";
  std::ofstream(cell.scratch() / "part.toml")
      << Slurp(shipped)
      << "\n[[hole]]\nfrom_start_mm = 30\naround_deg = 60\ndiameter_mm = 3\n"
         "around_tolerance_deg = 8\n"
         "\n[[hole]]\nfrom_start_mm = 45\naround_deg = 150\n"
         "diameter_mm = 4\n";
  std::string toml = Slurp(cell.cell_file());
  toml.replace(toml.find(shipped), shipped.size(), "part.toml");
  std::ofstream(cell.cell_file()) << toml;
}

void ExpectEnds(const pipeline::Measurement& m, const hal::BendProgram& tube,
                const hal::TubeFeatures& cut, AllErrors& errors) {
  for (const bool at_start : {true, false}) {
    SCOPED_TRACE(at_start);
    const auto& found = at_start ? m.features.first_end : m.features.last_end;
    const hal::EndCut& truth = at_start ? cut.first_end : cut.last_end;
    ASSERT_TRUE(found);
    errors.Add("obliquity", found->cut.obliquity_deg - truth.obliquity_deg,
               found->obliquity_sigma_deg);
    errors.Add("longest at", Turn(found->cut.around_deg, truth.around_deg),
               found->around_sigma_deg);
    EXPECT_LT(found->obliquity_sigma_deg, 1.0);
    EXPECT_FALSE(found->bevel || found->burr);
    EXPECT_TRUE(found->border.empty());
    const std::size_t row = at_start ? 0 : tube.rows.size() - 1;
    errors.Add("length", m.tube.program.rows[row].length_mm - tube.rows[row].length_mm,
               m.sigma.rows[row].length_mm);
  }
}

std::string Shown(const pipeline::Measurement& m) {
  std::string shown;
  for (const pipeline::OpeningFound& found : m.features.openings) {
    const hal::WallOpening& is = found.opening;
    shown += std::to_string(is.length_mm) + " x " + std::to_string(is.width_mm) + " at " +
             std::to_string(is.along_mm) + " mm, " + std::to_string(is.around_deg) + " degrees\n";
  }
  return shown;
}

// All openings, by their places, and nothing else.
void ExpectOpenings(const pipeline::Measurement& m, double length_mm, const hal::TubeFeatures& cut,
                    AllErrors& errors) {
  EXPECT_EQ(m.features.openings.size(), cut.openings.size()) << Shown(m);
  const double longer_mm = hal::SpineLength(m.tube.program) - length_mm;
  for (const hal::WallOpening& truth : cut.openings) {
    SCOPED_TRACE(truth.along_mm);
    const double at_mm = truth.along_mm + (truth.along_mm > 0.5 * length_mm ? longer_mm : 0);
    const auto found = std::find_if(
        m.features.openings.begin(), m.features.openings.end(),
        [&](const auto& opening) { return std::abs(opening.opening.along_mm - at_mm) < 2; });
    ASSERT_NE(found, m.features.openings.end());
    const hal::WallOpening &is = found->opening, &sigma = found->sigma;
    ASSERT_EQ(is.is_hole(), truth.is_hole());
    errors.Add("along", is.along_mm - at_mm, sigma.along_mm);
    errors.Add("around", Turn(is.around_deg, truth.around_deg), sigma.around_deg);
    errors.Add("width", is.width_mm - truth.width_mm, sigma.width_mm);
    EXPECT_LT(sigma.width_mm, 0.15);
    if (truth.is_hole()) continue;
    errors.Add("slot's length", is.length_mm - truth.length_mm, sigma.length_mm);
    errors.Add("slot's axis", std::remainder(is.axis_deg - truth.axis_deg, 180.0), sigma.axis_deg);
  }
}

void ExpectDent(const pipeline::Measurement& m, double length_mm, const hal::PressedDent& truth,
                AllErrors& errors) {
  ASSERT_EQ(m.dents.size(), 1U);
  const pipeline::DentFound& dent = m.dents.front();
  const double longer_mm = hal::SpineLength(m.tube.program) - length_mm;
  errors.Add("dent along",
             dent.along_mm - truth.along_mm - (2 * truth.along_mm > length_mm ? longer_mm : 0),
             dent.along_sigma_mm);
  errors.Add("dent around", Turn(dent.around_deg, truth.around_deg), dent.around_sigma_deg);
  EXPECT_LT(dent.around_sigma_deg, 1.0);
  errors.Add("dent's depth", dent.depth_mm - truth.depth_mm, dent.sigma_mm);
  const double area_mm2 =
      2 * std::numbers::pi * std::numbers::ln2 * truth.width_mm * truth.width_mm;
  errors.Add("dent's area", dent.area_mm2 - area_mm2, dent.area_sigma_mm2);
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
  constexpr std::uint64_t kParts = 10;
  LiveCell cell;
  WritePart(cell);
  cell.StartDaemon();
  AllErrors errors;
  for (std::uint64_t part = 1; part <= kParts; ++part) {
    SCOPED_TRACE(part);
    const hal::Tube tube{cell.plan().pipe_radius_mm, cell.Bend(), {}};
    const double length_mm = hal::SpineLength(tube.program);
    hal::TubeFeatures cut = Cut(length_mm, part);
    cell.Trigger(ScanOf(tube, cut, part));
    const auto result = cell.Result(static_cast<unsigned>(part));
    ASSERT_TRUE(result) << cell.log();
    ASSERT_TRUE(result->inspection);
    hal::BendProgram scanned = tube.program;
    if (result->inspection->direction.reversed) {  // the scan began at its other end
      cut = tests::ReversedFeatures(cut, tube);
      scanned = pipeline::ReverseProgram(tube.program);
    }
    ExpectEnds(result->measurement, scanned, cut, errors);
    ExpectOpenings(result->measurement, length_mm, cut, errors);
    ExpectDent(result->measurement, length_mm, cut.dents.front(), errors);
    const auto& judged = result->inspection->features.openings;
    ASSERT_EQ(judged.size(), 2U);
    EXPECT_EQ(judged[0].state, pipeline::OpeningState::kFound);
    EXPECT_EQ(judged[1].state, pipeline::OpeningState::kMissing);
  }
  EXPECT_EQ(errors.count(), kParts * 21);
  EXPECT_LT(errors.Rms(), 1.15);
  EXPECT_GT(errors.Rms(), 0.7);
  cell.StopDaemon();
  const std::string report = Slurp(cell.scratch() / "state/report.html");
  EXPECT_THAT(report, HasSubstr("the surface unrolled"));
  EXPECT_THAT(report, HasSubstr("Dents; the area"));
}

}  // namespace
}  // namespace bendloop::testing
