// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>

#include "program.h"

namespace bendloop::testing {
namespace {

using ::testing::HasSubstr;

TEST(Demo, BendsScansCorrectsAndTheReplayGivesTheSameBytes) {
  const Scratch scratch;
  const std::string out = (scratch / "demo").string();
  const Ran demo = scratch.Bendloop("demo --quick --no-color --parts 2 --out " + out, 240);
  ASSERT_EQ(demo.code, 0) << demo.out << demo.err << Slurp(out + "/logs/bendloopd.log");
  EXPECT_THAT(demo.out, HasSubstr("bendloop replay "));
  EXPECT_THAT(Slurp(out + "/report.html"), HasSubstr("</html>"));
  for (const std::string part : {"part-0001", "part-0002"}) {
    const std::string json = (scratch / "again.json").string();
    const Ran replay = scratch.Bendloop("replay " + out + "/sessions/" + part +
                                        ".session --config " + out + "/cell.toml --json " + json);
    EXPECT_THAT(replay.code, ::testing::AnyOf(0, 1)) << replay.err;
    const std::string live = Slurp(out + "/results/" + part + ".json");
    const std::string again = Slurp(json);
    const std::size_t timing = live.find("\"timing_ms\"");
    ASSERT_NE(timing, std::string::npos);
    // Not EXPECT_EQ: it would print both.
    EXPECT_TRUE(live.substr(0, timing) == again.substr(0, again.find("\"timing_ms\""))) << part;
  }
}

TEST(Demo, LeavesOtherPeoplesFilesAlone) {
  const Scratch scratch;
  const std::string out = (scratch / "mine").string();
  std::filesystem::create_directory(out);
  std::ofstream(out + "/notes.txt") << "keep";
  const Ran demo = scratch.Bendloop("demo --out " + out);
  EXPECT_EQ(demo.code, 2) << demo.err;
  EXPECT_EQ(Slurp(out + "/notes.txt"), "keep");
}

}  // namespace
}  // namespace bendloop::testing
