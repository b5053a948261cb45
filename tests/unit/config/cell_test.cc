// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include "config/load.h"
#include "config_text.h"

namespace bendloop::config {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::StartsWith;

constexpr char kMinimal[] = R"(schema = "bendloop.cell/1"
name = "cell"
part = "part.toml"
[scanner]
kind = "stream"
[bender]
link = "none"
)";

std::string CellErrorOf(const std::string& toml) {
  const auto cell = ParseCell(toml, "cell.toml", "/etc/bendloop");
  EXPECT_FALSE(cell) << toml;
  if (cell) return {};
  EXPECT_EQ(cell.error().kind, hal::ErrorKind::kBadInput);
  return cell.error().message;
}

TEST(Cell, MinimalFileGetsTheDefaultsOfTheStruct) {
  const auto cell = ParseCell(kMinimal, "cell.toml", "/etc/bendloop");
  ASSERT_TRUE(cell) << cell.error().message;
  const CellConfig defaults;
  EXPECT_EQ(cell->part_file, "/etc/bendloop/part.toml");
  EXPECT_EQ(cell->state_dir, "/var/lib/bendloop");
  EXPECT_EQ(cell->record.directory, "/var/lib/bendloop/sessions");
  EXPECT_EQ(cell->correction.gain_angle, defaults.correction.gain_angle);
  EXPECT_EQ(cell->bender.response_timeout, defaults.bender.response_timeout);
  EXPECT_FALSE(cell->realtime.cpu);
}

TEST(Cell, ReadsEveryKindOfValue) {
  const auto cell = ParseCell(std::string(kMinimal) + R"(
host = "10.0.0.1"
port = 1502
commit_timeout_ms = 250
[scan]
direction = "reverse"
end = "coverage"
max_seconds = 7
[correction]
enabled = false
max_total_angle_deg = 9
max_step_angle_deg = 1.25
[record]
directory = "/data"
[log]
level = "debug"
[realtime]
mode = "required"
cpu = 3
)",
                              "cell.toml", "/etc/bendloop");
  ASSERT_TRUE(cell) << cell.error().message;
  EXPECT_EQ(cell->bender.host, "10.0.0.1");
  EXPECT_EQ(cell->bender.port, 1502);
  EXPECT_EQ(cell->bender.commit_timeout.count(), 250);
  EXPECT_EQ(cell->scan.direction, ScanDirection::kReverse);
  EXPECT_EQ(cell->scan.end, ScanEnd::kCoverage);
  EXPECT_EQ(cell->scan.max_seconds, 7.0);
  EXPECT_FALSE(cell->correction.enabled);
  EXPECT_EQ(cell->correction.max_total.angle_deg, 9.0);
  EXPECT_EQ(cell->correction.max_step.angle_deg, 1.25);
  EXPECT_EQ(cell->record.directory, "/data");
  EXPECT_EQ(cell->log_level, LogLevel::kDebug);
  EXPECT_EQ(cell->realtime.mode, RealtimeMode::kRequired);
  EXPECT_EQ(cell->realtime.cpu, 3);
}

TEST(Cell, NamesFileLineKeyAndTheNearestKey) {
  EXPECT_EQ(CellErrorOf(With(kMinimal, "[bender]", "prot = 1\n[bender]")),
            "cell.toml:6: key 'scanner.prot': found an unknown key, expected a key that bendloop "
            "knows; did you mean 'port'?");
  EXPECT_THAT(CellErrorOf(With(kMinimal, "[bender]", "[bendr]")),
              HasSubstr("did you mean 'bender'?"));
  EXPECT_THAT(CellErrorOf(std::string(kMinimal) + "colour = 1"),
              AllOf(HasSubstr("cell.toml:8: key 'bender.colour': found an unknown key, expected "
                              "one of allow_non_atomic, baud, byte_timeout_ms, "),
                    Not(HasSubstr("did you mean"))));
  // The unit forgotten.
  EXPECT_THAT(CellErrorOf(std::string(kMinimal) + "commit_timeout = 1"),
              HasSubstr("did you mean 'commit_timeout_ms'?"));
}

TEST(Cell, LinksNeedTheirLine) {
  const auto bender = [](const std::string& text) {
    return CellErrorOf(With(kMinimal, "link = \"none\"", text + "\nregister_map = \"map.toml\""));
  };
  EXPECT_THAT(bender("link = \"modbus-rtu\""), HasSubstr("key 'bender.device': found nothing"));
  EXPECT_THAT(bender("link = \"modbus-rtu\"\ndevice = \"/dev/ttyS1\"\nbaud = 19201"),
              HasSubstr("key 'bender.baud': found 19201, expected a usual rate"));
  EXPECT_THAT(bender("link = \"modbus-rtu\"\ndevice = \"/dev/ttyS1\"\nunit_id = 0"),
              HasSubstr("key 'bender.unit_id': found 0, expected 1 to 247"));
  EXPECT_THAT(bender("link = \"can-isotp\""), HasSubstr("key 'bender.can_interface': found ''"));
  EXPECT_THAT(bender("link = \"can-isotp\"\ncan_interface = \"can0\"\ncan_reply_id = 0x7e0"),
              HasSubstr("key 'bender.can_reply_id': found 2016 as in can_request_id"));
}

TEST(Cell, NamesEveryProblemInTheOrderOfTheFile) {
  const std::string message = CellErrorOf(R"(schema = "bendloop.cell/1"
name = 5
[scanner]
kind = "usbb"
port = 70000
queue_profiles = 100.5
[scan]
max_seconds = nan
[bender]
link = "can"
host = "plc.example"
[correction]
gain_angle = 1.5
enabled = "yes"
[interlocks]
max_gap_mm = [1]
)");
  EXPECT_EQ(message,
            R"(cell.toml: 11 problems:
cell.toml:1: key 'part': found nothing, expected a text of 1 to 255 bytes in quotes
cell.toml:2: key 'name': found 5, expected a text of 1 to 255 bytes in quotes
cell.toml:4: key 'scanner.kind': found the text 'usbb', expected one of 'simulated', 'stream', 'usb', 'session'; did you mean 'usb'?
cell.toml:5: key 'scanner.port': found 70000, expected a whole number from 1 to 65535
cell.toml:6: key 'scanner.queue_profiles': found 100.5, expected a whole number from 16 to 65536
cell.toml:8: key 'scan.max_seconds': found nan, expected a number from 1 to 3600
cell.toml:10: key 'bender.link': found the text 'can', expected one of 'none', 'modbus-tcp', 'modbus-rtu', 'can-isotp', 'canopen', 'simulated'
cell.toml:11: key 'bender.host': found 'plc.example', expected a numeric address such as 192.168.0.10 (looking up a name has no bounded time)
cell.toml:13: key 'correction.gain_angle': found 1.5, expected a number from 0 to 1
cell.toml:14: key 'correction.enabled': found the text 'yes', expected true or false
cell.toml:16: key 'interlocks.max_gap_mm': found an array, expected a number from 0.1 to 10000)");
}

TEST(Cell, SuggestsTheNearestWord) {
  EXPECT_THAT(CellErrorOf(With(kMinimal, "\"none\"", "\"modbustcp\"")),
              HasSubstr("did you mean 'modbus-tcp'?"));
}

TEST(Cell, SyntaxErrorsAndDuplicateKeysHaveLineAndColumn) {
  EXPECT_THAT(CellErrorOf(With(kMinimal, "name = \"cell\"", "name = cell\"")),
              StartsWith("cell.toml:2:"));
  EXPECT_THAT(CellErrorOf(std::string(kMinimal) + "link = \"none\""), StartsWith("cell.toml:8:"));
  EXPECT_THAT(CellErrorOf(std::string(kMinimal) + "[scanner]"), StartsWith("cell.toml:8:"));
}

TEST(Cell, RefusesWhatOneKeyAloneDoesNotShow) {
  EXPECT_THAT(CellErrorOf(With(kMinimal, "\"none\"", "\"modbus-tcp\"")),
              HasSubstr("key 'bender.register_map': found nothing"));
  EXPECT_THAT(CellErrorOf(With(kMinimal, "\"stream\"", "\"session\"")),
              HasSubstr("key 'scanner.session': found nothing"));
  for (const char* id : {"1209", "1209:001", "1209:000g", "0x12:0001", "+209:0001", "1209:00012"}) {
    EXPECT_THAT(
        CellErrorOf(With(kMinimal, "\"stream\"", std::string("\"usb\"\nusb_id = \"") + id + "\"")),
        HasSubstr("key 'scanner.usb_id': found '" + std::string(id) + "', expected vendor"));
  }
  const auto id = ParseUsbId("04b4:00F1");
  ASSERT_TRUE(id);
  EXPECT_EQ(id->vendor, 0x04b4);
  EXPECT_EQ(id->product, 0x00f1);
  EXPECT_THAT(CellErrorOf(std::string(kMinimal) +
                          "[correction]\nmax_step_angle_deg = 5\nmax_total_angle_deg = 4"),
              HasSubstr("cell.toml:9: key 'correction.max_step_angle_deg': found 5, expected at "
                        "most max_total_angle_deg = 4"));
}

TEST(Cell, ReadsHowTubesAreToldApart) {
  const auto scan = [](const std::string& keys) {
    const auto cell = ParseCell(std::string(kMinimal) + "[scan]\n" + keys, "cell.toml", "/");
    EXPECT_TRUE(cell) << cell.error().message;
    return cell ? cell->scan : ScanConfig{};
  };
  EXPECT_EQ(scan("").tubes, TubeSource::kAuto);
  EXPECT_EQ(scan("").parts_between, 0);
  EXPECT_EQ(scan("tubes = \"counted\"\nparts_between = 5").tubes, TubeSource::kCounted);
  EXPECT_EQ(scan("tubes = \"counted\"\nparts_between = 5").parts_between, 5);
  EXPECT_EQ(scan("parts_between = \"auto\"").parts_between, std::nullopt);
  EXPECT_EQ(scan("tubes = \"each-scan\"").tubes, TubeSource::kEachScan);
  EXPECT_EQ(scan("silence_seconds = 0.5").silence_seconds, 0.5);

  const auto error = [](const std::string& keys) {
    return CellErrorOf(std::string(kMinimal) + "[scan]\n" + keys);
  };
  EXPECT_THAT(error("tubes = \"count\""),
              AllOf(HasSubstr("cell.toml:9: key 'scan.tubes': found the text 'count', expected one "
                              "of 'auto', 'counted', 'each-scan'"),
                    HasSubstr("did you mean 'counted'?")));
  for (const char* wrong : {"21", "-1", "1.0", "true", "\"automatic\""}) {
    EXPECT_THAT(error("parts_between = " + std::string(wrong)),
                AllOf(HasSubstr("cell.toml:9: key 'scan.parts_between': found "),
                      HasSubstr("expected a whole number from 0 to 20 or 'auto'")))
        << wrong;
  }
  EXPECT_THAT(error("\nsilence_seconds = 0.4"),
              HasSubstr("cell.toml:10: key 'scan.silence_seconds': found 0.4, expected a number "
                        "from 0.5 to 3600"));
}

// Without the bender's count nobody knows which tube of several is scanned.
TEST(Cell, TubesBetweenBenderAndScannerNeedTheCount) {
  for (const char* between : {"1", "\"auto\""}) {
    EXPECT_THAT(CellErrorOf(std::string(kMinimal) +
                            "[scan]\ntubes = \"each-scan\"\nparts_between = " + between),
                AllOf(HasSubstr("cell.toml:10: key 'scan.parts_between': found "),
                      HasSubstr("with tubes = 'each-scan', expected 0")))
        << between;
  }
}

TEST(Cell, TimesThatCannotHoldTogetherAreRefused) {
  const auto bender = [](const std::string& keys) {
    return With(kMinimal, "link = \"none\"",
                "link = \"modbus-tcp\"\nregister_map = \"map.toml\"\n" + keys);
  };
  EXPECT_THAT(
      CellErrorOf(bender("response_timeout_ms = 500\ncommit_timeout_ms = 499\n")),
      HasSubstr("cell.toml:10: key 'bender.commit_timeout_ms': found 499, expected at least "
                "response_timeout_ms = 500"));
  EXPECT_THAT(
      CellErrorOf(bender("commit_timeout_ms = 2001\n[interlocks]\nmax_session_age_s = 2\n")),
      HasSubstr("cell.toml:9: key 'bender.commit_timeout_ms': found 2001, expected at most "
                "max_session_age_s, 2000 ms"));
  // The scan would be held as too long before it could end by silence.
  const std::string coverage = std::string(kMinimal) + "[scan]\nend = \"coverage\"\n";
  EXPECT_THAT(CellErrorOf(coverage + "silence_seconds = 8\nmax_seconds = 7"),
              HasSubstr("cell.toml:10: key 'scan.silence_seconds': found 8, expected at most "
                        "max_seconds = 7"));
  for (const std::string& good :
       {bender("response_timeout_ms = 500\ncommit_timeout_ms = 500\n"),
        bender("commit_timeout_ms = 2000\n[interlocks]\nmax_session_age_s = 2\n"),
        coverage + "silence_seconds = 7\nmax_seconds = 7",
        // Silence means nothing where the scanner says the end, and the default is no one's fault.
        std::string(kMinimal) + "[scan]\nmax_seconds = 3",
        std::string(kMinimal) + "commit_timeout_ms = 10"}) {
    const auto cell = ParseCell(good, "cell.toml", "/");
    EXPECT_TRUE(cell) << cell.error().message;
  }
}

TEST(Cell, OtherSchemasAreNamedAndNothingElse) {
  EXPECT_EQ(CellErrorOf("schema = \"bendloop.part/1\"\nwhatever = 1"),
            "cell.toml:1: key 'schema': found 'bendloop.part/1', expected 'bendloop.cell/1' of a "
            "cell file");
  EXPECT_EQ(CellErrorOf(""),
            "cell.toml:1: key 'schema': found nothing, expected 'bendloop.cell/1' as the first "
            "line of a cell file");
}

TEST(Cell, HostileTextsAreRefusedQuickly) {
  const std::string head(kMinimal);
  // Each would need one stack frame a level, in the parser or when the tables are freed.
  std::string dots = "a";
  for (int i = 0; i < 200000; ++i) dots += ".a";
  EXPECT_THAT(CellErrorOf(dots + " = 1"), HasSubstr("cell.toml:1: found deeper nesting"));
  EXPECT_THAT(CellErrorOf(head + "[" + dots + "]"), HasSubstr("nesting"));
  EXPECT_THAT(CellErrorOf(head + "a = " + std::string(300000, '[')), HasSubstr("nesting"));
  EXPECT_THAT(CellErrorOf(std::string(kMaxFileBytes + 1, ' ')),
              HasSubstr("bytes, expected at most"));
  EXPECT_THAT(CellErrorOf(head + std::string(1, '\0')), HasSubstr("zero byte"));
  // Brackets and dots in texts and comments are not nesting.
  std::string free = "# " + std::string(100, '[') + std::string(100, '.') + "\n" + head;
  EXPECT_TRUE(
      ParseCell(With(free, "\"cell\"", "\"" + std::string(50, '[') + std::string(50, '.') + "\""),
                "cell.toml"));
  // Many problems are counted, not all kept.
  std::string many = head;
  for (int i = 0; i < 5000; ++i) many += "k" + std::to_string(i) + " = 1\n";
  EXPECT_THAT(CellErrorOf(many), StartsWith("cell.toml: 5000 problems, the first 100 are:\n"));
}

TEST(Cell, MessagesStayOnOneLine) {
  const std::string message = CellErrorOf(std::string(kMinimal) + "\"a\\nb\\u001b[31m\" = 1");
  EXPECT_THAT(message, HasSubstr("key 'bender.a\\x0ab\\x1b[31m'"));
  EXPECT_THAT(message, Not(HasSubstr("\n")));
}

class CellFiles : public ::testing::Test {
 protected:
  void SetUp() override {
    directory_ = std::filesystem::path(::testing::TempDir()) /
                 ("bendloop_cell_" + std::to_string(::getpid()));
    std::filesystem::create_directories(directory_);
  }
  void TearDown() override { std::filesystem::remove_all(directory_); }
  std::filesystem::path Write(const std::string& name, const std::string& text) {
    std::ofstream(directory_ / name) << text;
    return directory_ / name;
  }

  std::filesystem::path directory_;
};

TEST_F(CellFiles, LoadNamesProblemsOfPartAndMapTogether) {
  const auto file = Write("cell.toml", With(kMinimal, "link = \"none\"",
                                            "link = \"modbus-tcp\"\nregister_map = \"map.toml\""));
  Write("part.toml", "schema = \"bendloop.part/1\"\n");
  const auto cell = LoadCell(file);
  ASSERT_FALSE(cell);
  EXPECT_THAT(cell.error().message, AllOf(HasSubstr("part.toml: 4 problems"),
                                          HasSubstr("key 'bender.register_map': found '"),
                                          HasSubstr("which does not exist")));
}

TEST_F(CellFiles, LoadChecksThatThePartFitsTheMap) {
  const std::string map = ReadAll(ShippedConfig() / "register-maps/default.toml");
  Write("map.toml", With(map, "max_rows       = 40", "max_rows = 4"));
  Write("part.toml", ReadAll(ShippedConfig() / "parts/demo.toml"));
  const auto file = Write("cell.toml", With(kMinimal, "link = \"none\"",
                                            "link = \"modbus-tcp\"\nregister_map = \"map.toml\""));
  const auto cell = LoadCell(file);
  ASSERT_FALSE(cell);
  EXPECT_THAT(cell.error().message, HasSubstr("found a part of 5 rows, expected at most 4"));
}

TEST_F(CellFiles, CountedTubesNeedACountInTheMap) {
  std::string map = ReadAll(ShippedConfig() / "register-maps/default.toml");
  const std::size_t count = map.find("\nparts_bent");
  ASSERT_NE(count, std::string::npos);
  const std::string toml =
      With(kMinimal, "link = \"none\"", "link = \"modbus-tcp\"\nregister_map = \"map.toml\"") +
      "[scan]\ntubes = \"counted\"\n";
  Write("part.toml", ReadAll(ShippedConfig() / "parts/demo.toml"));
  Write("map.toml", map);
  const auto counted = LoadCell(Write("cell.toml", toml));
  ASSERT_TRUE(counted) << counted.error().message;
  Write("map.toml", map.erase(count + 1, map.find('\n', count + 1) - count));
  const auto refused = LoadCell(Write("cell.toml", toml));
  ASSERT_FALSE(refused);
  EXPECT_THAT(refused.error().message,
              AllOf(HasSubstr("cell.toml:10: key 'scan.tubes': found 'counted'"),
                    HasSubstr("state.parts_bent")));
  // Unsaid, it is no error: nothing is corrected, and check says so.
  EXPECT_TRUE(LoadCell(Write("cell.toml", With(toml, "counted", "auto"))));
}

// Every correction would be refused: said before the first, and not part after part.
TEST_F(CellFiles, AMapWithoutACommitRegisterMustBeAllowed) {
  std::string map = ReadAll(ShippedConfig() / "register-maps/default.toml");
  const std::size_t commit = map.find("\nsequence       = { address = 2000");
  ASSERT_NE(commit, std::string::npos);
  Write("map.toml", map.erase(commit + 1, map.find('\n', commit + 1) - commit));
  Write("part.toml", ReadAll(ShippedConfig() / "parts/demo.toml"));
  const std::string bender = "link = \"modbus-tcp\"\nregister_map = \"map.toml\"";
  const std::string toml = With(kMinimal, "link = \"none\"", bender);
  const auto refused = LoadCell(Write("cell.toml", toml));
  ASSERT_FALSE(refused);
  EXPECT_THAT(refused.error().message,
              AllOf(HasSubstr("cell.toml:8: key 'bender.register_map'"),
                    HasSubstr("without a commit register"), HasSubstr("allow_non_atomic = true")));
  const auto allowed =
      LoadCell(Write("cell.toml", With(toml, bender, bender + "\nallow_non_atomic = true")));
  ASSERT_TRUE(allowed) << allowed.error().message;
  EXPECT_TRUE(allowed->bender.allow_non_atomic);
  EXPECT_TRUE(LoadCell(Write("cell.toml", toml + "[correction]\nenabled = false\n")));
}

// What the PLC could set, and would not get.
TEST_F(CellFiles, ValidateLooksAtThePartsThatThePlcMaySet) {
  const std::string part = ReadAll(ShippedConfig() / "parts/demo.toml");
  std::filesystem::create_directory(directory_ / "parts");
  Write("parts/own.toml", part);
  const auto cell = Write(
      "cell.toml", With(kMinimal, "\"part.toml\"", "\"parts/own.toml\"\nparts_dir = \"parts\""));
  const auto good = ValidateFile(cell);
  EXPECT_TRUE(good) << good.error().message;
  Write("parts/twin.toml", part);
  Write("parts/spoilt.toml", With(part, "part_number = 1001", "part_number = -1"));
  const auto bad = ValidateFile(cell);
  ASSERT_FALSE(bad);
  EXPECT_THAT(bad.error().message, AllOf(HasSubstr("twin.toml"), HasSubstr("found 1001"),
                                         HasSubstr("spoilt.toml"), HasSubstr("part_number")));
}

TEST_F(CellFiles, ValidateSaysWhatAFileIs) {
  const auto other = ValidateFile(Write("other.toml", "schema = \"bendloop.cel/1\"\n"));
  ASSERT_FALSE(other);
  EXPECT_THAT(other.error().message, HasSubstr("did you mean 'bendloop.cell/1'?"));
  EXPECT_FALSE(ValidateFile(Write("none.toml", "x = 1\n")));
  EXPECT_FALSE(ValidateFile(directory_));
  for (const char* name : {"empty.toml", "empty.eds"}) {
    const auto empty = ValidateFile(Write(name, ""));
    ASSERT_FALSE(empty);
    EXPECT_EQ(empty.error().kind, hal::ErrorKind::kBadInput);
    EXPECT_THAT(empty.error().message, HasSubstr("empty (0 bytes)"));
  }
  const auto cut = ValidateFile(Write("cut.toml", "schema = \"bendloop.cell/1"));
  ASSERT_FALSE(cut);
  EXPECT_THAT(cut.error().message, AllOf(HasSubstr("cut.toml:1:"), HasSubstr("copied to its end")));
  const auto missing = ValidateFile(directory_ / "missing.toml");
  ASSERT_FALSE(missing);
  EXPECT_EQ(missing.error().kind, hal::ErrorKind::kBadInput);
}

}  // namespace
}  // namespace bendloop::config
