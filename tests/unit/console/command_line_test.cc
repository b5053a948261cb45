// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/console/command_line.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <vector>

#include "firmware-host/console/message.h"
#include "firmware-host/console/suggestion.h"
#include "firmware-host/console/version.h"
#include "firmware-host/console/wrap.h"

namespace bendloop::host {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::StartsWith;

TEST(Nearest, KnowsSlipsOfTheHandAndNoOthers) {
  const std::vector<std::string> words = {"reconstruct", "replay", "status", "demo"};
  EXPECT_EQ(Nearest("recontsruct", words), "reconstruct");
  EXPECT_EQ(Nearest("rec", words), "reconstruct");
  EXPECT_EQ(Nearest("staus", words), "status");
  EXPECT_EQ(Nearest("dmeo", words), "demo");
  EXPECT_EQ(Nearest("frobnicate", words), "");
  EXPECT_EQ(Nearest("", words), "");
}

TEST(WrapWords, BreaksAtBlanks) {
  EXPECT_THAT(WrapWords("one two three", 7), ElementsAre("one two", "three"));
  EXPECT_THAT(WrapWords("indivisible a", 3), ElementsAre("indivisible", "a"));
  EXPECT_THAT(WrapWords("\u00e4\u00f6\u00fc \u00e4", 5), ElementsAre("\u00e4\u00f6\u00fc \u00e4"));
  EXPECT_THAT(WrapWords("", 7), ElementsAre(""));
}

// What the user is told of these words.
std::string Wrong(std::vector<std::string> words) {
  CLI::App app("test", "bend");
  DressCommandLine(app, "bend 1");
  app.require_subcommand(1);
  CLI::App* command = app.add_subcommand("reconstruct", "a cloud");
  std::string cloud, units;
  command->add_option("cloud", cloud)->required();
  command->add_option("--units", units);
  std::reverse(words.begin(), words.end());
  try {
    app.parse(words);
  } catch (const CLI::ParseError& error) {
    return WhatIsWrong(app, error);
  }
  return "";
}

TEST(CommandLine, NamesTheUnknownWordAndWhatWasMeant) {
  EXPECT_EQ(Wrong({"recontsruct", "x"}),
            "no command recontsruct; did you mean reconstruct? try bend --help");
  EXPECT_EQ(Wrong({"frobnicate"}), "no command frobnicate; try bend --help");
  EXPECT_EQ(Wrong({"reconstruct", "a.ply", "--unitz", "mm"}),
            "no option --unitz; did you mean --units? try bend reconstruct --help");
  EXPECT_EQ(Wrong({"reconstruct", "--unitz=mm"}),
            "no option --unitz; did you mean --units? try bend reconstruct --help");
  EXPECT_EQ(Wrong({"--vresion"}), "no option --vresion; did you mean --version? try bend --help");
  EXPECT_EQ(Wrong({"reconstruct"}), "cloud is required; try bend reconstruct --help");
}

TEST(CommandLine, HelpHasEightyColumns) {
  CLI::App app(std::string(50, 'a') + " " + std::string(50, 'b'), "bend");
  DressCommandLine(app, "bend 1");
  std::string value = "a default";
  app.add_option("--long-option-name", value, "words and words and words and words and words again")
      ->check(CLI::IsMember({"alternatives", "and", "further", "ones", "that", "are", "many"}))
      ->capture_default_str();
  bool x = false;
  app.add_flag("-x", x, "short");
  const std::string help = app.help();
  EXPECT_THAT(help, HasSubstr("\n  -x                      short\n"));
  for (std::size_t at = 0; at < help.size();) {
    const std::size_t end = std::min(help.find('\n', at), help.size());
    EXPECT_LE(end - at, kPlainColumns) << help.substr(at, end - at);
    at = end + 1;
  }
}

TEST(CommandLine, NamesTheWordOfACommandWithinACommand) {
  CLI::App app("", "bend");
  DressCommandLine(app, "bend 1");
  CLI::App* lot = app.add_subcommand("lot");
  lot->require_subcommand(1);
  lot->add_subcommand("show");
  const auto wrong = [&](const std::vector<std::string>& reversed) {
    try {
      app.parse(std::vector<std::string>(reversed));
    } catch (const CLI::ParseError& error) {
      return WhatIsWrong(app, error);
    }
    return std::string();
  };
  EXPECT_EQ(wrong({"shwo", "lot"}), "no command shwo; did you mean show? try bend lot --help");
  EXPECT_EQ(wrong({"more", "show", "lot"}),
            "one argument too many: more; try bend lot show --help");
}

TEST(Wrap, LeavesAUnitWithItsNumber) {
  EXPECT_EQ(WrapWords("in tolerance with 99.9 % or 12 mm, 3 degrees.", 22),
            (std::vector<std::string>{"in tolerance with", "99.9 % or 12 mm,", "3 degrees."}));
}

TEST(Wrap, BreaksLinesThatAreSetUnderTheirWords) {
  const std::string set = "Faults:\n  late N    answers so many milliseconds late\n  crash\n";
  EXPECT_EQ(WrapLines(set, 80), set);
  EXPECT_EQ(WrapLines(set, 36),
            "Faults:\n  late N    answers so many\n            milliseconds late\n  crash\n");
  EXPECT_EQ(WrapLines("words and more words to break", 22), "words and more words\nto break");
  EXPECT_EQ(WrapLines("", 80), "");
  EXPECT_EQ(WrapProse("a sentence that is too wide\nfor its lines goes on.\nAnother.\n", 20),
            "a sentence that is\ntoo wide for its\nlines goes on.\nAnother.\n");
  EXPECT_EQ(WrapProse("a sentence that is too wide\n\n  command  what it does\n", 20),
            "a sentence that is\ntoo wide\n\n  command  what it does\n");
  EXPECT_EQ(WrapProse("it ends. And once more it does end.\nAnother one", 20),
            "it ends. And once\nmore it does end.\nAnother one");
}

TEST(Message, IsOnOneLineOrBrokenAndCannotMoveTheCursor) {
  EXPECT_EQ(MessageText("bend", "a\x1b[2Jb.toml: bad\nsecond", 0),
            "bend: a?[2Jb.toml: bad\nsecond\n");
  EXPECT_EQ(MessageText("bend", "one two three four five six", 20),
            "bend: one two\n    three four five\n    six\n");
  EXPECT_EQ(MessageText("bend", "", 0), "bend: \n");
}

TEST(Version, NamesCommitBuildAndLibraries) {
  EXPECT_THAT(kSoftware, ::testing::MatchesRegex("bendloop [0-9.]+ \\([0-9a-z+]+, [A-Za-z]+\\)"));
  const std::string text = BuildText();
  EXPECT_THAT(text, StartsWith(std::string(kSoftware) + "\nbuild: "));
  for (const char* library : {"Ceres 2", "Eigen 3", "SQLite 3", "libmodbus 3", "libusb 1"}) {
    EXPECT_THAT(text, HasSubstr(library));
  }
}

}  // namespace
}  // namespace bendloop::host
