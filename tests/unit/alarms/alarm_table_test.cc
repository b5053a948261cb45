// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/alarms/alarm_table.h"

#include <gtest/gtest.h>

#include <fstream>
#include <sstream>

#include "firmware-host/alarms/part_alarms.h"

namespace bendloop::host {
namespace {

TEST(AlarmTable, IsInOrderAndSaysEverything) {
  unsigned before = 0;
  for (const AlarmKind& kind : AlarmTable()) {
    const auto number = static_cast<unsigned>(kind.code);
    EXPECT_GT(number, before) << "each number once, the smaller first";
    EXPECT_TRUE(number > 1000 && number < 6000) << number;
    EXPECT_EQ(&KindOf(kind.code), &kind);
    EXPECT_FALSE(std::string(kind.sentence).empty() || std::string(kind.mend).empty()) << number;
    EXPECT_EQ(CodeText(kind.code), "BL" + std::to_string(number));
    before = number;
  }
}

// The table that people read is the one that the program goes by.
TEST(AlarmTable, StandsInTheReadme) {
  std::ifstream file(BENDLOOP_SOURCE_DIR "/firmware-host/alarms/README.md");
  std::stringstream readme;
  readme << file.rdbuf();
  EXPECT_NE(readme.str().find(AlarmTableMarkdown()), std::string::npos)
      << "the table of firmware-host/alarms/README.md is to be:\n"
      << AlarmTableMarkdown();
}

TEST(AlarmTable, EachInterlockHasAnAlarmOfItsOwn) {
  std::vector<AlarmCode> codes;
  for (int kind = 0; kind <= static_cast<int>(pipeline::InterlockKind::kActiveProgram); ++kind) {
    codes.push_back(AlarmOf(static_cast<pipeline::InterlockKind>(kind)));
    EXPECT_EQ(KindOf(codes.back()).code, codes.back());
    for (std::size_t i = 0; i + 1 < codes.size(); ++i) EXPECT_NE(codes[i], codes.back());
  }
}

}  // namespace
}  // namespace bendloop::host
