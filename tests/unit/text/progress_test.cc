// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/text/progress.h"

#include <gmock/gmock.h>

#include <sstream>

namespace bendloop::host {
namespace {

pipeline::LiveView View(std::size_t bends, double covered_mm) {
  pipeline::LiveView view;
  view.spine_samples = 10;
  view.covered_mm = covered_mm;
  view.pipe_radius_mm = 4;
  for (std::size_t i = 0; i < bends; ++i) {
    view.program.rows.push_back({10, 0, 41.2, 20.0});
    view.sigma.rows.push_back({0.1, 0, 0.12, 0.1});
  }
  view.program.rows.push_back({10, 0, 0, std::nullopt});
  view.sigma.rows.push_back({0.1, 0, 0, std::nullopt});
  return view;
}

TEST(ProgressText, SaysWhatIsSeenAndWhatIsMissing) {
  EXPECT_EQ(ProgressText(View(3, 440), 620),
            "bend 3 seen, 41.2 +- 0.1 deg; 180 mm of 620 still missing");
  EXPECT_EQ(ProgressText(View(0, 12), std::nullopt), "first straight seen; 12 mm seen");
  EXPECT_EQ(ProgressText({}, 620), "waiting for the tube; 620 mm of 620 still missing");
  EXPECT_THAT(ProgressText(View(3, 700), 620), testing::HasSubstr("0 mm of 620"));
}

TEST(ProgressText, DoesNotTellOfABendThatStillGrows) {
  pipeline::LiveView view = View(2, 100);
  view.program.rows.back().length_mm = 1;
  EXPECT_THAT(ProgressText(view, 620), testing::HasSubstr("bend 1 seen"));
  view = View(1, 100);
  view.program.rows.back().length_mm = 1;
  EXPECT_THAT(ProgressText(view, 620), testing::HasSubstr("first straight seen"));
}

TEST(Progress, WritesOverItselfOnATerminal) {
  std::ostringstream out;
  Progress progress(out, true, 30);
  progress.Show(View(1, 100), 620);
  progress.Show(View(1, 100), 620);  // nothing new
  progress.Show(View(2, 200), 620);
  progress.End();
  EXPECT_EQ(out.str(),
            "\r  bend 1 seen, 41.2 +- 0.1 de\x1b[K\r  bend 2 seen, 41.2 +- 0.1 de\x1b[K\n");
}

TEST(Progress, IsAFewPlainLinesElsewhere) {
  std::ostringstream out;
  Progress progress(out, false);
  for (int mm = 0; mm <= 620; ++mm) {
    progress.Show(View(static_cast<std::size_t>(mm / 150), mm), 620);
  }
  progress.End();
  const std::string text = out.str();
  EXPECT_EQ(std::count(text.begin(), text.end(), '\n'), 9);  // the start, 4 bends, 4 quarters
  EXPECT_THAT(text,
              testing::Not(testing::AnyOf(testing::HasSubstr("\r"), testing::HasSubstr("\x1b"))));
}

}  // namespace
}  // namespace bendloop::host
