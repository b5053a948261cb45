// SPDX-License-Identifier: Apache-2.0
#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <pty.h>
#include <sys/file.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cmath>
#include <cstdlib>
#include <fstream>
#include <sstream>

#include "drivers/session/session_database.h"
#include "drivers/session/session_writer.h"
#include "hal/clock.h"
#include "program.h"

namespace bendloop::testing {
namespace {

using ::testing::HasSubstr;
using ::testing::StartsWith;

TEST(Usage, HelpAndVersionAreNoErrors) {
  const Scratch scratch;
  EXPECT_EQ(scratch.Bendloop("--help").code, 0);
  EXPECT_THAT(scratch.Bendloop("--version").out, StartsWith("bendloop "));
  for (const char* command : {"demo", "reconstruct", "replay", "simulate", "convert", "check",
                              "doctor", "history", "status"}) {
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

TEST(Usage, CheckSaysWhyAFileIsNone) {
  const Scratch scratch;
  struct Case {
    const char* name;
    std::string text;
    const char* says;
  };
  for (const Case& c :
       {Case{"e.session", "", "empty (0 bytes)"}, Case{"e.csv", "", "empty (0 bytes)"},
        Case{"e.ply", "", "empty (0 bytes)"}, Case{"e.step", "", "empty (0 bytes)"},
        Case{"e.db", "", "empty (0 bytes)"}, Case{"e.toml", "", "empty (0 bytes)"},
        Case{"e", "", "empty (0 bytes)"}, Case{"cut.session", "SQLite for", "ends after byte 10"},
        Case{"s.session", "no session", "found no session"},
        Case{"cut.ply", "ply\nformat ascii 1.0\n", "a point cloud"},
        Case{"cut.stp", "ISO-10303-21;\nHEAD", "CAD (STEP)"},
        Case{"p.csv", "x,y,z\n1,2", "a table"},
        Case{"binary",
             std::string("\x7f"
                         "ELF\0\0",
                         6),
             "zero byte at byte 4"}}) {
    std::ofstream(scratch / c.name, std::ios::binary) << c.text;
    for (const char* option : {"", "--unit-drop-in "}) {
      const Ran ran =
          scratch.Bendloop("check " + std::string(option) + (scratch / c.name).string());
      EXPECT_EQ(ran.code, 3) << c.name;
      EXPECT_THAT(ran.err, StartsWith("bendloop: " + (scratch / c.name).string() + ":"));
      EXPECT_THAT(ran.err, HasSubstr(c.says)) << c.name;
      EXPECT_THAT(ran.err, HasSubstr("expected")) << c.name;
    }
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

TEST(Usage, ADashIsStandardInput) {
  const Scratch scratch;
  const std::string file = (scratch / "straight.xyz").string();
  std::ofstream cloud(file);
  for (int i = 0; i < 3000; ++i) {
    cloud << i * 0.04 << " " << 5 * std::cos(i * 0.7) << " " << 5 * std::sin(i * 0.7) << "\n";
  }
  cloud.close();
  const Ran named = scratch.Bendloop("reconstruct " + file);
  ASSERT_EQ(named.code, 0) << named.err;
  const std::string out = (scratch / "piped").string();
  const std::string line = "cat " + file + " | " BENDLOOP_BIN_DIR "/bendloop reconstruct - >" + out;
  EXPECT_EQ(std::system(line.c_str()), 0);
  EXPECT_EQ(Slurp(out), named.out);
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
  // The tube of the part's length, to a few of its sigmas: 0.06 mm.
  const auto row = told.out.find("  1    ");
  ASSERT_NE(row, std::string::npos) << told.out;
  EXPECT_NEAR(std::strtod(told.out.c_str() + row + 3, nullptr), 108.0, 0.2) << told.out;
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

// A program of ours with its standard output where it does not fit.
Ran IntoAFullDisk(const Scratch& scratch, const std::string& program,
                  const std::string& arguments) {
  const auto err = scratch / ".err";
  const std::string line = std::string(BENDLOOP_BIN_DIR) + "/" + program + " " + arguments +
                           " >/dev/full 2>" + err.string() + " </dev/null";
  const int status = std::system(line.c_str());
  return {WIFEXITED(status) ? WEXITSTATUS(status) : -1, "", Slurp(err)};
}

TEST(Usage, AFullStandardOutputIsFour) {
  const Scratch scratch;
  const std::string part = BENDLOOP_SOURCE_DIR "/config/parts/demo.toml";
  std::ofstream(scratch / "lra.txt") << "L R A CLR\n100 0 90 20\n50\n";
  for (const std::string& arguments :
       {std::string("--help"), std::string("--version"), std::string("doctor"),
        std::string("doctor --json"), std::string("check --help"), "check " + part,
        "convert --to xyz " + (scratch / "lra.txt").string()}) {
    const Ran ran = IntoAFullDisk(scratch, "bendloop", arguments);
    EXPECT_EQ(ran.code, 4) << arguments;
    EXPECT_THAT(ran.err, HasSubstr("standard output: cannot be written")) << arguments;
  }
  for (const char* program : {"bendloop-simbender", "bendloop-simscanner", "bendloopd"}) {
    EXPECT_EQ(IntoAFullDisk(scratch, program, "--help").code, 4) << program;
  }
}

// What the program says on a terminal of 80 columns, standard error included.
std::string OnATerminal(const std::string& arguments) {
  winsize size{};
  size.ws_col = 80;
  size.ws_row = 25;
  int terminal = -1;
  const std::string line = "NO_COLOR=1 " BENDLOOP_BIN_DIR "/bendloop " + arguments;
  const pid_t child = forkpty(&terminal, nullptr, nullptr, &size);
  if (child == 0) {
    execl("/bin/sh", "sh", "-c", line.c_str(), nullptr);
    _exit(127);
  }
  std::string text;
  char block[1000];
  for (ssize_t got; (got = read(terminal, block, sizeof block)) > 0;) text.append(block, got);
  close(terminal);
  waitpid(child, nullptr, 0);
  std::erase(text, '\r');
  return text;
}

void ExpectNarrow(const std::string& what, const std::string& text) {
  EXPECT_NE(text, "") << what;
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) {
    EXPECT_LE(line.size(), 80u) << what << ": " << line;
  }
}

TEST(Usage, NothingIsWiderThanATerminal) {
  const Scratch scratch;
  for (const char* arguments :
       {"--help", "demo --help", "reconstruct --help", "replay --help", "simulate --help",
        "convert --help", "check --help", "doctor --help", "status --help", "lot --help",
        "lot show --help", "undo --help", "first-program --help", "doctor", "--version"}) {
    ExpectNarrow(arguments, scratch.Bendloop(arguments).out);
  }
  for (const char* program :
       {"bendloop-simbender", "bendloop-simscanner", "bendloop-usbscanner", "bendloopd"}) {
    const auto out = (scratch / "help").string();
    const std::string line = BENDLOOP_BIN_DIR "/" + std::string(program) + " --help >" + out;
    EXPECT_EQ(std::system(line.c_str()), 0) << program;
    ExpectNarrow(program, Slurp(out));
  }
  const std::string file = (scratch / "straight.xyz").string();
  std::ofstream cloud(file);
  for (int i = 0; i < 3000; ++i) {
    cloud << i * 0.04 << " " << 5 * std::cos(i * 0.7) << " " << 5 * std::sin(i * 0.7) << "\n";
  }
  cloud.close();
  for (const std::string& arguments :
       {"reconstruct " + file, "reconstruct " + file + " --pipe-radius 6",
        std::string("status --state-dir /var/lib/some-folder-where-no-daemon-is"),
        std::string("reconstruct x --pipe-radius 1000000000")}) {
    ExpectNarrow(arguments, OnATerminal(arguments));
  }
  ExpectNarrow("reconstruct", scratch.Bendloop("reconstruct " + file).out);
}

TEST(Usage, NamesCannotMoveTheCursor) {
  const Scratch scratch;
  const Ran ran = scratch.Bendloop("reconstruct \"$(printf 'no\\033[2Jsuch.ply')\"");
  EXPECT_EQ(ran.code, 3);
  EXPECT_THAT(ran.err, HasSubstr("no?[2Jsuch.ply: "));
}

TEST(Usage, AllProgramsKnowTheSameClutter) {
  const Scratch scratch;
  for (const char* program : {"bendloop simulate", "bendloop-simscanner"}) {
    const std::string err = (scratch / "err").string();
    const std::string line =
        BENDLOOP_BIN_DIR "/" + std::string(program) + " --clutter tube 2>" + err + " </dev/null";
    EXPECT_EQ(WEXITSTATUS(std::system(line.c_str())), 2) << program;
    EXPECT_THAT(Slurp(err), HasSubstr("{table,clamps,second-tube}")) << program;
  }
}

TEST(Usage, NamesTheUnknownWordAndWhatWasMeant) {
  const Scratch scratch;
  const auto error_of = [&](const char* arguments) { return scratch.Bendloop(arguments).err; };
  EXPECT_THAT(error_of("recontsruct x"),
              HasSubstr("no command recontsruct; did you mean reconstruct?"));
  EXPECT_THAT(error_of("reconstruct x --unitz mm"),
              HasSubstr("no option --unitz; did you mean --units?"));
  EXPECT_THAT(error_of("lot shwo"), HasSubstr("no command shwo; did you mean show?"));
  const Ran help = scratch.Bendloop("help");
  EXPECT_EQ(help.code, 0);
  EXPECT_EQ(help.out, scratch.Bendloop("--help").out);
  EXPECT_EQ(scratch.Bendloop("help convert").out, scratch.Bendloop("convert --help").out);
  const Ran version = scratch.Bendloop("-V");
  EXPECT_EQ(version.code, 0);
  EXPECT_THAT(version.out, HasSubstr("\nbuild: "));
  EXPECT_THAT(version.out, HasSubstr("Eigen 3"));
}

TEST(Usage, NotANumberIsNoNumber) {
  const Scratch scratch;
  for (const char* arguments : {"reconstruct x --pipe-radius nan",
                                "convert --to lra --bend-radius nan", "demo --spacing nan"}) {
    const Ran ran = scratch.Bendloop(arguments);
    EXPECT_EQ(ran.code, 2) << arguments;
    EXPECT_THAT(ran.err, HasSubstr("found nan, expected ")) << arguments;
  }
}

TEST(Usage, WhatIsNoSessionIsNotWrittenOver) {
  const Scratch scratch;
  const std::string file = (scratch / "notes.txt").string();
  std::ofstream(file) << "dear";
  const std::string simulate = std::string("simulate --part ") + BENDLOOP_SOURCE_DIR +
                               "/config/parts/demo.toml --spacing 10 --rays 50 --views 1 --out ";
  const Ran refused = scratch.Bendloop(simulate + file);
  EXPECT_EQ(refused.code, 2);
  EXPECT_THAT(refused.err, HasSubstr("is no session and is not written over"));
  EXPECT_EQ(Slurp(file), "dear");
  EXPECT_EQ(scratch.Bendloop(simulate + file + " --force").code, 0);
  EXPECT_EQ(scratch.Bendloop(simulate + file).code, 0);  // a session by now
}

TEST(Usage, CheckIsOnlyContentWithWhatAReplayTakes) {
  const Scratch scratch;
  const std::string session = (scratch / "a.session").string();
  const hal::ManualClock clock;
  {
    auto writer = drivers::SessionWriter::Create(session, clock);
    ASSERT_TRUE(writer->SetMeta("context", "{"));
    hal::LaserProfile profile(1);
    ASSERT_TRUE(writer->Write(profile));
    ASSERT_TRUE(writer->Finish());
  }
  const Ran ran = scratch.Bendloop("check " + session);
  EXPECT_EQ(ran.code, 3);
  EXPECT_THAT(ran.err, HasSubstr("meta 'context': found text that is not JSON"));
}

// A session of `bendloop simulate` without its checksums, as others write them: nothing but what
// stands in it tells.
void WriteWithoutSums(const Scratch& scratch, const std::string& file, const std::string& change) {
  std::filesystem::copy_file(scratch / "sound.session", file,
                             std::filesystem::copy_options::overwrite_existing);
  auto database = drivers::OpenSessionForWriting(file);
  ASSERT_TRUE(database);
  const auto done = database->Execute(
      "ALTER TABLE profile DROP COLUMN crc; DELETE FROM meta WHERE key='digest';"
      "PRAGMA user_version=1;" +
      change);
  ASSERT_TRUE(done) << done.error().message;
}

TEST(Usage, CheckRefusesWhatAReplayRefuses) {
  const Scratch scratch;
  const std::string shipped = BENDLOOP_SOURCE_DIR "/config/";
  const std::string cell = (scratch / "cell.toml").string();
  std::ofstream(cell) << "schema = \"bendloop.cell/1\"\nname = \"c\"\npart = \"" << shipped
                      << "parts/demo.toml\"\n[scanner]\nkind = \"simulated\"\n[bender]\n"
                         "link = \"none\"\n";
  ASSERT_EQ(scratch
                .Bendloop("simulate --part " + shipped + "parts/demo.toml --spacing 4 --rays 60" +
                          " --views 1 --out " + (scratch / "sound.session").string())
                .code,
            0);
  const std::string file = (scratch / "a.session").string();
  WriteWithoutSums(scratch, file, "");
  const Ran sound = scratch.Bendloop("check " + file);
  EXPECT_EQ(sound.code, 0) << sound.err;
  for (const char* change :
       {"DELETE FROM profile WHERE seq > 10 + (SELECT min(seq) FROM profile)",
        "UPDATE profile SET t_ns = 0", "UPDATE profile SET t_ns = 9223372036854775807",
        "UPDATE event SET t_ns = -9223372036854775807 - 1",
        "UPDATE profile SET points = zeroblob(0), intensity = NULL",
        "INSERT OR REPLACE INTO meta VALUES('end', 'nonsense')",
        "INSERT OR REPLACE INTO meta VALUES('start', 'nonsense')"}) {
    WriteWithoutSums(scratch, file, change);
    const Ran checked = scratch.Bendloop("check " + file);
    EXPECT_EQ(checked.code, 3) << change << "\n" << checked.out;
    EXPECT_THAT(checked.err, StartsWith("bendloop: " + file + ": ")) << change;
    const Ran replayed = scratch.Bendloop("replay " + file + " --config " + cell);
    EXPECT_EQ(replayed.code, 3) << change << "\n" << replayed.out;
  }
}

TEST(Usage, AMapCoarserThanTheToleranceIsRefused) {
  const Scratch scratch;
  const std::filesystem::path shipped = BENDLOOP_SOURCE_DIR "/config";
  std::string map = Slurp(shipped / "register-maps/default.toml");
  const std::string fine = "type = \"int32\", scale = 0.001";
  const std::size_t at = map.find(fine, map.find("angle_deg "));
  ASSERT_NE(at, std::string::npos);
  map.replace(at, fine.size(), "type = \"int32\", scale = 1.0");
  std::ofstream(scratch / "map.toml") << map;
  std::ofstream(scratch / "part.toml") << Slurp(shipped / "parts/demo.toml");
  std::ofstream(scratch / "cell.toml")
      << "schema = \"bendloop.cell/1\"\nname = \"c\"\npart = \"part.toml\"\n"
         "[scanner]\nkind = \"simulated\"\n[bender]\nlink = \"simulated\"\n"
         "register_map = \"map.toml\"\n";
  const Ran ran = scratch.Bendloop("check " + (scratch / "cell.toml").string());
  EXPECT_EQ(ran.code, 3) << ran.err;
  EXPECT_THAT(ran.err, HasSubstr("coarser than the part's tolerance"));
}

TEST(Usage, TwoDemosDoNotShareAFolder) {
  const Scratch scratch;
  const auto folder = scratch / "out";
  std::filesystem::create_directory(folder);
  const int marker = open((folder / ".bendloop-demo").c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0644);
  ASSERT_EQ(flock(marker, LOCK_EX), 0);
  const Ran second = scratch.Bendloop("demo --quick --out " + folder.string());
  EXPECT_EQ(second.code, 2);
  EXPECT_THAT(second.err, HasSubstr("another demo runs in"));
  close(marker);
}

TEST(Usage, AnInterruptedDemoLeavesNothingHalfOpen) {
  const Scratch scratch;
  const auto folder = scratch / "out";
  // As Ctrl-C does: to the demo and to the processes that it started.
  const std::string line = "timeout -s INT 3 " BENDLOOP_BIN_DIR "/bendloop demo --out " +
                           folder.string() + " >" + (scratch / "log").string() + " 2>&1";
  EXPECT_NE(std::system(line.c_str()), 0);
  EXPECT_THAT(Slurp(scratch / "log"), HasSubstr("bendloop: interrupted"));
  std::size_t files = 0;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder)) {
    const std::string name = entry.path().filename().string();
    EXPECT_FALSE(name.ends_with("-wal") || name.ends_with("-shm")) << entry.path();
    EXPECT_NE(name, "status.json") << entry.path();
    files += entry.is_regular_file();
  }
  EXPECT_GT(files, 0u) << Slurp(scratch / "log");
}

}  // namespace
}  // namespace bendloop::testing
