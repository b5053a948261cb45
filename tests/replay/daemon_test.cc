// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <fstream>
#include <thread>

#include "firmware-host/cli/demo/child_process.h"
#include "firmware-host/daemon/status_client.h"
#include "program.h"

namespace bendloop::testing {
namespace {

using namespace std::chrono_literals;

// A cell whose scanner and bender are not there: nobody listens on port 1.
class DaemonAlone : public ::testing::Test {
 protected:
  DaemonAlone() {
    std::ofstream(scratch_ / "cell.toml")
        << "schema = \"bendloop.cell/1\"\nname = \"alone\"\n"
        << "part = \"" BENDLOOP_SOURCE_DIR "/config/parts/demo.toml\"\nstate_dir = \"state\"\n"
        << "[scanner]\nkind = \"stream\"\nport = 1\n[bender]\nlink = \"modbus-tcp\"\nport = 1\n"
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
};

TEST_F(DaemonAlone, WaitsForItsScannerAnswersAndStopsCleanly) {
  auto daemon = Start();
  ASSERT_TRUE(daemon) << daemon.error().message;
  ASSERT_TRUE(Becomes("no scanner")) << Slurp(scratch_ / "bendloopd.log");
  EXPECT_EQ(scratch_.Bendloop("status --config " + (scratch_ / "cell.toml").string()).code, 0);
  EXPECT_EQ(daemon->Stop(20s), 0);  // SIGTERM
  EXPECT_FALSE(std::filesystem::exists(scratch_ / "state/status.json"));
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
