// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/text/result_text.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <sstream>

#include "tests/unit/result/sample_run.h"

namespace bendloop::host {
namespace {

using testing::HasSubstr;
using testing::Not;

TEST(ComparisonText, PutsNominalMeasuredAndCorrectedSideBySide) {
  const std::string text = ComparisonText(SampleRun(1, 1.5), false);
  // Bend 2: 45 nominal, 46.5 measured, OUT of 0.5, corrected by 0.8 of 1.5.
  EXPECT_THAT(text, testing::ContainsRegex("angle +deg +45\\.000 +46\\.500 +0\\.015 +\\+1\\.500 +"
                                           "0\\.500 +OUT +43\\.800 +-1\\.200"));
  EXPECT_THAT(text, testing::ContainsRegex("4 +length .*50\\.300 .*\\+0\\.000 +deadband"));
  EXPECT_THAT(text, Not(HasSubstr("\x1b")));
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
  EXPECT_THAT(MeasurementText({}, false), HasSubstr("0 bends"));
}

}  // namespace
}  // namespace bendloop::host
