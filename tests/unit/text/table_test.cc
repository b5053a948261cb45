// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/text/table.h"

#include <gmock/gmock.h>
#include <stdlib.h>
#include <unistd.h>

#include <regex>
#include <sstream>

namespace bendloop::host {
namespace {

std::vector<std::string> Lines(const std::string& text) {
  std::vector<std::string> lines;
  std::istringstream in(text);
  for (std::string line; std::getline(in, line);) lines.push_back(line);
  return lines;
}

TEST(Table, LinesNumbersUpAtTheDecimalPoint) {
  Table table({{"row", Align::kRight}, {"angle deg", Align::kDecimal}, {"note"}});
  table.Add({"1", "35.2", "first"});
  table.Add({"2", "-190.125"});
  table.AddGap();
  table.Add({"10", "7", "whole"});
  table.Add({"11", "-", "none"});
  EXPECT_EQ(table.Render(false),
            "  row  angle deg  note\n"
            "  ---  ---------  -----\n"
            "    1     35.2    first\n"
            "    2   -190.125\n"
            "\n"
            "   10      7      whole\n"
            "   11      -      none\n");
}

TEST(Table, CountsCodePointsAndNotBytes) {
  Table table({{"part"}, {"x", Align::kRight}});
  table.Add({"Kr\xC3\xBCmmer", "1"});
  table.Add({"Krummer", "2"});
  const auto lines = Lines(table.Render(false));
  EXPECT_EQ(lines[2].size(), lines[3].size() + 1);
}

TEST(Table, ColourChangesNothingButColour) {
  Table table({{"row", Align::kRight}, {"angle", Align::kDecimal}, {"state"}});
  table.Add({"1", "3.25", {"OUT", Style::kBad}});
  table.Add({"2", {"-13.5", Style::kGood}, {"in", Style::kGood}});
  const std::string plain = table.Render(false), coloured = table.Render(true);
  EXPECT_THAT(plain, testing::Not(testing::HasSubstr("\x1b")));
  EXPECT_THAT(coloured, testing::HasSubstr("\x1b"));
  EXPECT_EQ(std::regex_replace(coloured, std::regex("\x1b\\[[0-9;]*m"), ""), plain);
}

TEST(Table, NamesCannotMoveTheCursor) {
  Table table({{"part"}});
  table.Add({"evil\x1b[2J\r\nname\xC2\x9B"});
  EXPECT_THAT(table.Render(false), testing::HasSubstr("evil?[2J??name?\n"));
}

TEST(Fixed, HasNoMinusZeroAndNoNan) {
  EXPECT_EQ(Fixed(-0.0004, 3), "0.000");
  EXPECT_EQ(Fixed(-0.0006, 3), "-0.001");
  EXPECT_EQ(Fixed(0.0 / 0.0, 3), "-");
  EXPECT_EQ(Signed(-1e-9, 2), "+0.00");
  EXPECT_EQ(Signed(1.25, 1), "+1.2");
  EXPECT_EQ(Fixed(1e300, 3), "-");
}

TEST(ColourAllowed, OnlyOnATerminalAndWithoutNoColor) {
  setenv("TERM", "xterm", 1);
  unsetenv("NO_COLOR");
  int ends[2];
  ASSERT_EQ(pipe(ends), 0);
  EXPECT_FALSE(ColourAllowed(ends[1]));
  close(ends[0]);
  close(ends[1]);

  const int terminal = posix_openpt(2 /* O_RDWR */);
  if (terminal < 0) GTEST_SKIP() << "no pseudo-terminals here";
  EXPECT_TRUE(ColourAllowed(terminal));
  setenv("NO_COLOR", "1", 1);
  EXPECT_FALSE(ColourAllowed(terminal));
  unsetenv("NO_COLOR");
  setenv("TERM", "dumb", 1);
  EXPECT_FALSE(ColourAllowed(terminal));
  close(terminal);
}

}  // namespace
}  // namespace bendloop::host
