// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>

#include "program.h"

namespace bendloop::testing {
namespace {

using ::testing::HasSubstr;
using ::testing::StartsWith;

TEST(Usage, HelpAndVersionAreNoErrors) {
  const Scratch scratch;
  EXPECT_EQ(scratch.Bendloop("--help").code, 0);
  EXPECT_THAT(scratch.Bendloop("--version").out, StartsWith("bendloop "));
  for (const char* command :
       {"demo", "reconstruct", "replay", "simulate", "convert", "check", "doctor", "status"}) {
    const Ran help = scratch.Bendloop(std::string(command) + " --help");
    EXPECT_EQ(help.code, 0) << command;
    EXPECT_THAT(help.out, HasSubstr("xample")) << command;
  }
}

TEST(Usage, AWrongCommandLineIsTwoAndOneLine) {
  const Scratch scratch;
  for (const char* arguments :
       {"", "frobnicate", "reconstruct", "replay x.session", "reconstruct a.ply --units parsecs",
        "reconstruct a.ply --pipe-radius -3", "demo --parts zero", "simulate --out x.session",
        "convert --to parsecs"}) {
    const Ran ran = scratch.Bendloop(arguments);
    EXPECT_EQ(ran.code, 2) << arguments << "\n" << ran.err;
    EXPECT_THAT(ran.err, StartsWith("bendloop: ")) << arguments;
    EXPECT_EQ(ran.out, "") << arguments;
  }
}

TEST(Usage, ANumberOutOfItsLimitsIsNamedAsItWasTyped) {
  const Scratch scratch;
  for (const char* number :
       {"--noise 500", "--noise nan", "--noise-growth -1", "--outliers 2", "--dropouts -0.1",
        "--pose-noise 101", "--jitter -1", "--spacing 0", "--rays 0", "--table-gap 1001"}) {
    const Ran ran = scratch.Bendloop(std::string("simulate --part x --out y ") + number);
    EXPECT_EQ(ran.code, 2) << number;
    const std::string words(number);
    const auto space = words.find(' ');
    EXPECT_THAT(ran.err, StartsWith("bendloop: " + words.substr(0, space) + ": found" +
                                    words.substr(space) + ", expected "));
  }
}

TEST(Usage, BadInputIsThreeAndNamesTheFile) {
  const Scratch scratch;
  const std::string text = (scratch / "not.ply").string();
  std::ofstream(text) << "ply\nformat ascii 1.0\nelement vertex 5\n";
  const std::string cell = (scratch / "cell.toml").string();
  std::ofstream(cell) << "schema = \"bendloop.cell/1\"\nnaem = \"x\"\n";
  for (const std::string& arguments :
       {"reconstruct " + text, std::string("reconstruct /does/not/exist.ply"), "check " + cell,
        "replay " + text + " --config " + cell, "simulate --part " + cell + " --out /dev/null",
        "convert --to lra " + text}) {
    const Ran ran = scratch.Bendloop(arguments);
    EXPECT_EQ(ran.code, 3) << arguments << "\n" << ran.err;
    EXPECT_THAT(ran.err, StartsWith("bendloop: ")) << arguments;
  }
  EXPECT_THAT(scratch.Bendloop("check " + cell).err, HasSubstr(cell + ":"));
}

TEST(Usage, AKnownRadiusThatThePointsContradictIsSaid) {
  const Scratch scratch;
  std::ofstream cloud(scratch / "straight.xyz");
  cloud << "% a straight of radius 5\n";
  for (int i = 0; i < 3000; ++i) {
    cloud << i * 0.04 << " " << 5 * std::cos(i * 0.7) << " " << 5 * std::sin(i * 0.7) << "\n";
  }
  cloud.close();
  const std::string file = (scratch / "straight.xyz").string();
  const Ran right = scratch.Bendloop("reconstruct " + file + " --pipe-radius 5");
  EXPECT_EQ(right.code, 0) << right.err;
  EXPECT_EQ(right.err, "");
  const Ran wrong = scratch.Bendloop("reconstruct " + file + " --pipe-radius 6");
  EXPECT_EQ(wrong.code, 0) << wrong.err;
  EXPECT_THAT(wrong.err, HasSubstr("says 6.000 mm, the points show 5.000 mm"));
}

TEST(Usage, ThePartSaysWhichOfTwoTubesItIs) {
  const Scratch scratch;
  const std::string file = (scratch / "two.xyz").string();
  std::ofstream cloud(file);
  for (int i = 0; i < 3000; ++i) {
    const double y = 5 * std::cos(i * 0.7), z = 5 * std::sin(i * 0.7);
    cloud << i * 0.04 << " " << y << " " << z << "\n"
          << i * 0.036 << " " << y + 60 << " " << z << "\n";
  }
  cloud.close();
  const std::string part = (scratch / "part.toml").string();
  std::ofstream(part) << "schema = \"bendloop.part/1\"\nname = \"short\"\npart_number = 1\n"
                         "pipe_radius_mm = 5.0\nbend_radius_mm = 15.0\n"
                         "[[row]]\nlength_mm = 50\nangle_deg = 20\n[[row]]\nlength_mm = 53\n";
  const Ran alone = scratch.Bendloop("reconstruct " + file);
  EXPECT_EQ(alone.code, 3);
  EXPECT_THAT(alone.err, HasSubstr("two tubes"));
  const Ran told = scratch.Bendloop("reconstruct " + file + " --part " + part);
  EXPECT_EQ(told.code, 0) << told.err;
  EXPECT_THAT(told.out, HasSubstr("108.0"));
  EXPECT_THAT(told.out, HasSubstr(" 0 bends"));  // whatever the part should have
  EXPECT_EQ(scratch.Bendloop("reconstruct " + file + " --part " + file).code, 3);
}

TEST(Usage, NoDaemonIsFour) {
  const Scratch scratch;
  const Ran ran = scratch.Bendloop("status --state-dir " + (scratch / "nowhere").string());
  EXPECT_EQ(ran.code, 4);
  EXPECT_THAT(ran.err, HasSubstr("no daemon"));
}

TEST(Usage, DoctorNamesEverything) {
  const Scratch scratch;
  const Ran ran = scratch.Bendloop("doctor --json");
  EXPECT_EQ(ran.code, 0);
  for (const char* what :
       {"kernel", "real-time priority", "locked memory", "clock source", "disk"}) {
    EXPECT_THAT(ran.out, HasSubstr(what));
  }
  EXPECT_EQ(scratch.Bendloop("doctor").code, 0);
}

}  // namespace
}  // namespace bendloop::testing
