// SPDX-License-Identifier: Apache-2.0
//
// The simulator as its own process, as the operator and the demo use it.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdio>
#include <filesystem>
#include <fstream>

#include "config/load.h"
#include "drivers/modbus_bender/modbus_bender.h"
#include "tests/support/child_process.h"

namespace bendloop::test {
namespace {

using testing::HasSubstr;
using testing::StartsWith;

const char kSimulator[] = BENDLOOP_BIN_DIR "/bendloop-simbender";
const char kMap[] = BENDLOOP_SOURCE_DIR "/config/register-maps/default.toml";
const char kEds[] = BENDLOOP_SOURCE_DIR "/config/object-dictionaries/default.eds";

class SimbenderCommand : public testing::Test {
 protected:
  SimbenderCommand()
      : folder_(std::filesystem::path(testing::TempDir()) /
                ("bendloop-simbender-" + std::to_string(getpid()) +
                 testing::UnitTest::GetInstance()->current_test_info()->name())) {
    std::filesystem::create_directories(folder_);
    WriteProgram(R"({"rows": [
      {"length_mm": 100, "rotation_deg": 0, "angle_deg": 90, "bend_radius_mm": 30},
      {"length_mm": 80, "rotation_deg": 0, "angle_deg": 0, "bend_radius_mm": null}]})");
  }
  ~SimbenderCommand() override { std::filesystem::remove_all(folder_); }

  std::filesystem::path program() const { return folder_ / "program.json"; }
  void WriteProgram(const std::string& text) { std::ofstream(program()) << text; }
  std::vector<std::string> Command(const std::vector<std::string>& more = {}) const {
    std::vector<std::string> command{kSimulator,
                                     "--map",
                                     kMap,
                                     "--program",
                                     program(),
                                     "--pipe-radius",
                                     "8",
                                     "--tray",
                                     folder_ / "tray",
                                     "--part-number",
                                     "5",
                                     "--port",
                                     "0",
                                     "--cycle-ms",
                                     "1"};
    command.insert(command.end(), more.begin(), more.end());
    return command;
  }

  std::filesystem::path folder_;
};

TEST_F(SimbenderCommand, ListensBendsAndEndsWithItsInput) {
  ChildProcess simulator(Command({"--springback-20", "1", "--springback-120", "2"}));
  const auto line = simulator.ReadLine();
  ASSERT_TRUE(line);
  int port = 0;
  ASSERT_EQ(std::sscanf(line->c_str(), "listening %d", &port), 1) << *line;

  hal::SteadyClock clock;
  drivers::ModbusBenderOptions options;
  options.port = static_cast<std::uint16_t>(port);
  options.response_timeout = std::chrono::seconds(10);
  const auto link =
      drivers::MakeModbusBender(config::LoadRegisterMap(kMap).value(), options, clock);
  const auto active = link->ReadActive();
  ASSERT_TRUE(active) << active.error().message;
  EXPECT_EQ(active->part_number, 5u);
  EXPECT_EQ(active->sequence, 1u);
  EXPECT_EQ(active->program.rows[0].angle_deg, 90);

  simulator.WriteLine("bend");
  EXPECT_EQ(simulator.ReadLine(), "bent part-0001.json");
  EXPECT_TRUE(std::filesystem::exists(folder_ / "tray" / "part-0001.json"));
  simulator.WriteLine("status");
  EXPECT_EQ(simulator.ReadLine(), "active part 5 sequence 1 rows 2 accepted 0 rejected 0");
  simulator.WriteLine("misbehave exception 6");
  EXPECT_EQ(simulator.ReadLine(), "ok");
  const auto state = link->ReadState();
  ASSERT_FALSE(state);
  EXPECT_THAT(state.error().message, HasSubstr("exception 6, device busy"));
  simulator.WriteLine("misbehave behave");
  EXPECT_EQ(simulator.ReadLine(), "ok");
  EXPECT_TRUE(link->ReadState());
  simulator.WriteLine("juggle");
  EXPECT_THAT(simulator.ReadLine().value_or(""), StartsWith("error"));
  simulator.CloseInput();
  EXPECT_EQ(simulator.Wait(), 0);
}

// An integrator tries the PLC's side by hand.
TEST_F(SimbenderCommand, SaysWhatThePlcIsToSayAndTellsWhatItWasTold) {
  ChildProcess simulator(Command({"--say", "part_number 1002"}));
  const auto listening = simulator.ReadLine();
  ASSERT_TRUE(listening);
  int port = 0;
  ASSERT_EQ(std::sscanf(listening->c_str(), "listening %d", &port), 1) << *listening;
  hal::SteadyClock clock;
  drivers::ModbusBenderOptions options;
  options.port = static_cast<std::uint16_t>(port);
  options.response_timeout = std::chrono::seconds(10);
  const auto link =
      drivers::MakeModbusBender(config::LoadRegisterMap(kMap).value(), options, clock);
  const auto answer = [&](const std::string& line) {
    simulator.WriteLine(line);
    return simulator.ReadLine().value_or("");
  };

  for (const char* line : {"say identity COIL 7/T-1", "say scan 1", "say hold 1", "say new_lot 7",
                           "say acknowledge 8"}) {
    EXPECT_EQ(answer(line), "ok") << line;
  }
  auto state = link->ReadState();
  ASSERT_TRUE(state) << state.error().message;
  const hal::PlcOrders said{1002u, "COIL 7/T-1", true, hal::ScanOrder::kMayRun, true, 7u, 8u};
  EXPECT_EQ(state->orders, said);
  EXPECT_EQ(answer("say identity"), "ok");
  EXPECT_EQ(answer("say hold 0"), "ok");
  state = link->ReadState();
  ASSERT_TRUE(state);
  EXPECT_EQ(state->orders.identity, "");
  EXPECT_EQ(state->orders.hold, false);
  for (const char* line : {"say", "say scan", "say scan 3", "say hold 1 2", "say new_lot -1",
                           "say part_number 4294967296", "say hello 1",
                           "say identity 123456789012345678901234567890123"}) {
    EXPECT_THAT(answer(line), StartsWith("error say \"")) << line;
  }

  hal::CellReport report;
  report.state = hal::CellState::kHeld;
  report.verdict = hal::TubeVerdict::kPass;
  report.identity = "COIL 7/T-1";
  report.tubes = 3;
  ASSERT_TRUE(link->Report(report));
  EXPECT_THAT(answer("told"),
              testing::AllOf(HasSubstr("state 5 held, "), HasSubstr("verdict 1 pass"),
                             HasSubstr("identity \"COIL 7/T-1\", tubes 3")));

  // The changeover: the operator loads the other part's program.
  EXPECT_EQ(answer("load " + program().string() + " 1002"), "ok");
  const auto active = link->ReadActive();
  ASSERT_TRUE(active);
  EXPECT_EQ(active->part_number, 1002u);
  EXPECT_EQ(active->sequence, 0u);
  EXPECT_THAT(answer("load " + program().string()), StartsWith("error load"));
  EXPECT_THAT(answer("load nowhere.json 7"), StartsWith("error nowhere.json"));
}

TEST_F(SimbenderCommand, HelpShowsFaultsAndAnExample) {
  ChildProcess simulator({kSimulator, "--help"});
  const std::string help = simulator.ReadAll();
  EXPECT_EQ(simulator.Wait(), 0);
  EXPECT_THAT(help, HasSubstr("--springback-20"));
  EXPECT_THAT(help, HasSubstr("drop-after-stage"));
  EXPECT_THAT(help, HasSubstr("Example"));
}

TEST_F(SimbenderCommand, ExitCodesSayWhoHasToAct) {
  const auto exit_code = [](const std::vector<std::string>& command) {
    ChildProcess simulator(command);
    simulator.CloseInput();
    simulator.ReadAll();
    return simulator.Wait();
  };
  EXPECT_EQ(exit_code(Command()), 0);
  EXPECT_EQ(exit_code({kSimulator}), 2);
  EXPECT_EQ(exit_code(Command({"--frobnicate"})), 2);
  EXPECT_EQ(exit_code(Command({"--springback-20", "nan"})), 3);
  EXPECT_EQ(exit_code(Command({"--misbehave", "dance"})), 2);
  EXPECT_EQ(exit_code(Command({"--say", "hold maybe"})), 2);
  EXPECT_EQ(exit_code(Command({"--canopen", "nocan9"})), 2);  // without --object-dictionary
  EXPECT_EQ(exit_code(Command({"--canopen", "nocan9", "--object-dictionary", kEds})), 2);  // map
  EXPECT_EQ(exit_code({kSimulator, "--canopen", "nocan9", "--object-dictionary", kEds, "--map",
                       BENDLOOP_SOURCE_DIR "/config/register-maps/canopen.toml", "--program",
                       program().string(), "--pipe-radius", "4"}),
            4);
  for (const char* bad :
       {"", "{", "[]", R"({"rows": 3})", R"({"rows": []})", R"({"rows": [{"length_mm": 1}]})",
        R"({"rows": [{"length_mm": null, "rotation_deg": 0, "angle_deg": 0,
                             "bend_radius_mm": null}]})"}) {
    WriteProgram(bad);
    EXPECT_EQ(exit_code(Command()), 3) << bad;
  }
  std::filesystem::remove(program());
  EXPECT_EQ(exit_code(Command()), 3);
}

}  // namespace
}  // namespace bendloop::test
