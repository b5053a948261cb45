// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <fstream>
#include <thread>

#include "drivers/simulated_scanner/simulated_scanner.h"
#include "firmware-host/cli/demo/child_process.h"
#include "firmware-host/daemon/status_client.h"
#include "program.h"

namespace bendloop::testing {
namespace {

using namespace std::chrono_literals;

// A cell whose scanner and bender are not there: nobody listens on port 1.
class DaemonAlone : public ::testing::Test {
 protected:
  DaemonAlone() { WriteCell(1); }

  void WriteCell(int scanner_port) {
    std::ofstream(scratch_ / "cell.toml")
        << "schema = \"bendloop.cell/1\"\nname = \"alone\"\n"
        << "part = \"" BENDLOOP_SOURCE_DIR "/config/parts/demo.toml\"\nstate_dir = \"state\"\n"
        << "[scanner]\nkind = \"stream\"\nport = " << scanner_port
        << "\n[bender]\nlink = \"modbus-tcp\"\nport = 1\n"
        << "register_map = \"" BENDLOOP_SOURCE_DIR "/config/register-maps/default.toml\"\n";
  }

  hal::Result<host::ChildProcess> Start(std::vector<std::string> more = {}) {
    std::vector<std::string> arguments = {"--config", (scratch_ / "cell.toml").string()};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return host::ChildProcess::Start(BENDLOOP_BIN_DIR "/bendloopd", arguments,
                                     scratch_ / "bendloopd.log");
  }
  // The state that the daemon tells once it is `state`; "" when it does not become so.
  bool Becomes(const std::string& state) {
    const auto deadline = std::chrono::steady_clock::now() + 30s;
    while (std::chrono::steady_clock::now() < deadline) {
      const auto status = host::FetchStatus(scratch_ / "state/status.json");
      if (status && status->value("state", "") == state) return true;
      std::this_thread::yield();
    }
    return false;
  }

  Scratch scratch_;
  hal::SteadyClock clock_;
};

TEST_F(DaemonAlone, WaitsForItsScannerAnswersAndStopsCleanly) {
  auto daemon = Start();
  ASSERT_TRUE(daemon) << daemon.error().message;
  ASSERT_TRUE(Becomes("no scanner")) << Slurp(scratch_ / "bendloopd.log");
  EXPECT_EQ(scratch_.Bendloop("status --config " + (scratch_ / "cell.toml").string()).code, 0);
  EXPECT_EQ(daemon->Stop(20s), 0);  // SIGTERM
  EXPECT_FALSE(std::filesystem::exists(scratch_ / "state/status.json"));
}

// A name that clears the screen, begins a line of its own and colours what follows.
TEST_F(DaemonAlone, AScannersNameMovesNoCursorInTheLog) {
  const drivers::WireIdentity named{"arm\x1b[2J\n2026 error forged\x07",
                                    "\x9b"
                                    "31m\r7",
                                    "1\x7f", "", 1000};
  auto scanner = drivers::SimulatedScanner::Listen(0, named, clock_);
  ASSERT_TRUE(scanner) << scanner.error().message;
  WriteCell((*scanner)->port());
  auto daemon = Start();
  ASSERT_TRUE(daemon) << daemon.error().message;
  const auto log = [this] { return Slurp(scratch_ / "bendloopd.log"); };
  const auto deadline = std::chrono::steady_clock::now() + 30s;
  while (log().find("forged") == std::string::npos && std::chrono::steady_clock::now() < deadline) {
    ASSERT_TRUE((*scanner)->Poll(10ms));
  }
  EXPECT_EQ(daemon->Stop(20s), 0);
  EXPECT_THAT(log(), ::testing::HasSubstr("arm?[2J?2026 error forged?"));
  for (const char c : log()) {
    ASSERT_TRUE(c == '\n' || (static_cast<unsigned char>(c) >= 0x20 && c != 0x7f))
        << "byte " << static_cast<int>(static_cast<unsigned char>(c)) << " in\n"
        << log();
  }
}

TEST_F(DaemonAlone, OneDaemonAStateDirectory) {
  auto first = Start();
  ASSERT_TRUE(first);
  ASSERT_TRUE(Becomes("no scanner"));
  auto second = Start();
  ASSERT_TRUE(second);
  const auto deadline = std::chrono::steady_clock::now() + 30s;
  while (!second->Exited() && std::chrono::steady_clock::now() < deadline) {
    std::this_thread::yield();
  }
  EXPECT_EQ(second->Exited().value_or(-1), 4);
  EXPECT_THAT(Slurp(scratch_ / "bendloopd.log"), ::testing::HasSubstr("state directory"));
}

TEST_F(DaemonAlone, ADamagedLotStopsItBeforeItDecidesAnything) {
  std::filesystem::create_directories(scratch_ / "state");
  std::ofstream(scratch_ / "state/lot.json") << "{\"schema\": 7";
  auto daemon = Start();
  ASSERT_TRUE(daemon);
  const auto deadline = std::chrono::steady_clock::now() + 30s;
  while (!daemon->Exited() && std::chrono::steady_clock::now() < deadline) {
    std::this_thread::yield();
  }
  EXPECT_EQ(daemon->Exited().value_or(-1), 3);
  EXPECT_THAT(Slurp(scratch_ / "bendloopd.log"), ::testing::HasSubstr("lot.json"));
}

TEST_F(DaemonAlone, CheckOnlyTouchesNothing) {
  auto daemon = Start({"--check-only"});
  ASSERT_TRUE(daemon);
  const auto said = daemon->Expect((scratch_ / "cell.toml").string() + ":", 20s);
  EXPECT_TRUE(said);
  EXPECT_FALSE(std::filesystem::exists(scratch_ / "state"));
}

}  // namespace
}  // namespace bendloop::testing
