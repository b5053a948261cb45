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

// On a disk of 1 MB: the end comes at once, with the daemon's reason.
TEST(Demo, EndsWithTheReasonWhenTheDiskIsFull) {
  const Scratch scratch;
  const std::string disk = (scratch / "disk").string();
  std::filesystem::create_directory(disk);
  // In a mount namespace of its own, which ends with it.
  const std::string inside = "mount -t tmpfs -o size=1m tmpfs " + disk;
  if (std::system(("unshare -rm sh -c '" + inside + "' >/dev/null 2>&1").c_str()) != 0) {
    GTEST_SKIP() << "no mount namespaces here";
  }
  const std::string log = (scratch / "log").string();
  const std::string line = "unshare -rm sh -c '" + inside +
                           " && timeout -k 5 60 " BENDLOOP_BIN_DIR "/bendloop demo --out " + disk +
                           "/demo' >" + log + " 2>&1 </dev/null";
  const int status = std::system(line.c_str());
  ASSERT_TRUE(WIFEXITED(status));
  EXPECT_EQ(WEXITSTATUS(status), 4) << Slurp(log);  // 124: it waited
  EXPECT_THAT(Slurp(log), ::testing::ContainsRegex("bendloop demo: .*(full|No space left)"));
}

}  // namespace
}  // namespace bendloop::testing
