// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/text/result_text.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <sstream>

#include "firmware-host/text/table.h"
#include "tests/support/sample_run.h"

namespace bendloop::host {
namespace {

using testing::HasSubstr;
using testing::Not;

TEST(ComparisonText, PutsNominalMeasuredAndCorrectedSideBySide) {
  const std::string text = ComparisonText(SampleRun(1, 1.5), false);
  // Bend 2: 45 nominal, 46.5 measured, OUT of 0.5, corrected by 0.8 of 1.5.
  EXPECT_THAT(text, testing::ContainsRegex("angle +deg +45\\.000 +46\\.500 +0\\.015 +\\+1\\.500 +"
                                           "0\\.5 +OUT +43\\.800 +-1\\.200"));
  EXPECT_THAT(text, testing::ContainsRegex("4 +length .*50\\.300 .*\\+0\\.000\n"));
  EXPECT_THAT(text, HasSubstr("\n  deadband: L4\n"));
  EXPECT_THAT(text, Not(HasSubstr("\x1b")));
}

TEST(ComparisonText, FitsAnEightyColumnTerminal) {
  RunResult run = SampleRun(1, 1.5);
  run.inspection->rows[1].rotation_deg.state = pipeline::ToleranceState::kUndecided;
  pipeline::Deviation& longest = run.inspection->rows[2].length_mm;
  longest.nominal += 1'200;
  longest.measured += 1'200;
  run.correction->rows[2].length_mm.corrected += 1'200;
  for (const std::string& text : {ComparisonText(run, false), RunText(run, false, 80)}) {
    std::istringstream in(text);
    for (std::string line; std::getline(in, line);) EXPECT_LE(line.size(), 80u) << line;
  }
}

TEST(MeasurementText, FitsAnEightyColumnTerminal) {
  pipeline::Measurement m = SampleRun().measurement;
  m.fit.samples = 1'234'567;
  m.fit.outliers = 1'234'567;
  m.dents.resize(1);
  m.seam = {-179.5, 123.4, 1.234, 0.123, 12.3};
  m.wrinkles = {{11, 12.345, 1.234, {0, 0, 0}}};
  m.bend_easings.resize(30);
  m.joint.known_together = {{.first_bend = 0,
                             .last_bend = 2,
                             .values = {{1, pipeline::RowValueKind::kRotation},
                                        {1, pipeline::RowValueKind::kAngle},
                                        {2, pipeline::RowValueKind::kRotation}},
                             .direction_sigma_deg = 0.03,
                             .plane_sigma_deg = 0.03,
                             .length_mm = 1234,
                             .length_sigma_mm = 0.03}};
  std::istringstream in(MeasurementText(m, false));
  for (std::string line; std::getline(in, line);) EXPECT_LE(line.size(), 80u) << line;
}

TEST(ComparisonText, EveryNumberOfAColumnHasItsPointInTheSamePlace) {
  std::istringstream in(ComparisonText(SampleRun(), false));
  std::vector<std::vector<std::size_t>> points;
  for (std::string line; std::getline(in, line);) {
    std::vector<std::size_t> found;
    for (std::size_t i = 0; i < line.size(); ++i) {
      if (line[i] == '.') found.push_back(i);
    }
    if (!found.empty()) points.push_back(found);
  }
  ASSERT_EQ(points.size(), 5u + 4 + 3 + 4);
  for (const auto& line : points) {
    const std::size_t common = std::min(line.size(), points.front().size());
    EXPECT_TRUE(
        std::equal(line.begin(), line.begin() + static_cast<long>(common), points.front().begin()));
  }
}

TEST(RunText, TellsTheVerdictAndWhatRefused) {
  RunResult run = SampleRun();
  EXPECT_THAT(RunText(run, false), HasSubstr("part manifold-return: FAIL; corrected program "
                                             "committed as sequence 102\n"));
  run.bender.reset();
  run.interlocks->checks[1].passed = false;
  const std::string text = RunText(run, false);
  EXPECT_THAT(text, HasSubstr("FAIL; correction refused, nothing was sent"));
  EXPECT_THAT(text, HasSubstr("refused: 96.4 % of the spine seen"));
  EXPECT_THAT(RunText(run, true), HasSubstr("\x1b[1;31mFAIL\x1b[0m"));
  EXPECT_THAT(RunText(SampleRun(2, 0.1), false), HasSubstr("PASS"));
}

TEST(MeasurementText, HoldsWithoutSigmasAndRows) {
  pipeline::Measurement m = SampleRun().measurement;
  m.sigma.rows.clear();
  EXPECT_THAT(MeasurementText(m, false), HasSubstr("46.500   -"));
  const std::string freeform = MeasurementText({}, false);
  EXPECT_THAT(freeform, HasSubstr("no rows: see the spine"));
  EXPECT_THAT(freeform, Not(HasSubstr("bend")));  // which it does not count
}

// A shallow bend 2: its plane and where it lies along the tube are hardly known.
pipeline::Measurement Shallow() {
  pipeline::Measurement m;
  m.tube.program.rows = {{40.12345, 0, 60.12345, 20.12345},
                         {50.12345, 31.2345, 3.12345, 20.12345},
                         {45.12345, -81.2345, 0.12345, 20.12345},
                         {40.12345, 0, 0, std::nullopt}};
  m.sigma.rows = {{0.0234, 0, 0.0021, 0.0996},
                  {3.46, 12.3, 0.0317, 123.0},
                  {3.51, 5.1, 0.2, 0.00012},
                  {0.2, 0, 0, std::nullopt}};
  using Kind = pipeline::RowValueKind;
  m.joint.known_together = {{.first_bend = 1,
                             .last_bend = 1,
                             .values = {{1, Kind::kLength}, {1, Kind::kRotation}},
                             .direction_sigma_deg = 0.0312,
                             .length_mm = 96.12345,
                             .length_sigma_mm = 0.0456}};
  return m;
}

TEST(MeasurementText, ShowsTheDigitsThatAreKnown) {
  const std::string text = MeasurementText(Shallow(), false);
  EXPECT_THAT(text, testing::ContainsRegex("1 +40\\.123 +0\\.023 +- +- +60\\.123 +0\\.002 +"
                                           "20\\.12 +0\\.10\n"));
  EXPECT_THAT(text, testing::ContainsRegex("2 +50\\.1 +3\\.5 +~31 +12 +3\\.123 +0\\.032 +"
                                           "~20 +123\n"));
  EXPECT_THAT(text, testing::ContainsRegex("3 +45\\.1 +3\\.5 +~-81\\.2 +5\\.1 +~0\\.12 +0\\.20 +"
                                           "20\\.123 +0\\.000\n"));
  EXPECT_THAT(text, HasSubstr("~ not known"));
  EXPECT_THAT(
      text,
      HasSubstr("  hardly told apart: L2, R2; but direction behind bend 2 +- 0.031 deg, from\n    "
                "bend 1 to bend 3 96.123 +- 0.046 mm\n"));
  EXPECT_THAT(MeasurementText(SampleRun().measurement, false), Not(HasSubstr("~")));
}

TEST(MeasurementText, ManyVaguePlacesAreNoFlood) {
  pipeline::Measurement m = Shallow();
  m.joint.known_together.resize(14, m.joint.known_together.front());
  const std::string text = MeasurementText(m, false);
  EXPECT_LT(std::count(text.begin(), text.end(), '\n'), 26);
  EXPECT_THAT(text, HasSubstr("and 8 more places like these"));
}

TEST(SigmaDecimals, GiveTwoDigitsOfSigma) {
  for (const auto& [sigma, decimals] : std::vector<std::pair<double, int>>{{0.0001, 3},
                                                                           {0.012, 3},
                                                                           {0.0994, 3},
                                                                           {0.0996, 2},
                                                                           {0.12, 2},
                                                                           {0.994, 2},
                                                                           {1.2, 1},
                                                                           {9.96, 0},
                                                                           {12, 0},
                                                                           {1e300, 0},
                                                                           {1e-300, 3},
                                                                           {0, 3},
                                                                           {-1, 3}}) {
    EXPECT_EQ(SigmaDecimals(sigma, 3), decimals) << sigma;
  }
  EXPECT_EQ(SigmaDecimals(std::nan(""), 3), 3);
}

}  // namespace
}  // namespace bendloop::host
