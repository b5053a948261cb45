// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <fstream>

#include "config/load.h"
#include "drivers/simulated_bender/simulated_bender.h"
#include "firmware-host/commit/commit_journal.h"
#include "firmware-host/console/temporary_folder.h"
#include "firmware-host/daemon/daemon.h"
#include "firmware-host/daemon/daemon_options.h"
#include "firmware-host/daemon/status_client.h"

namespace bendloop::host {
namespace {

// What was staged to be never committed is what the bender holds: the first look tells so, and
// whoever finds the daemon ready finds that it is locked.
TEST(DaemonStart, SaysFromTheBeginThatCorrectionsAreLocked) {
  const auto folder = TemporaryFolder::Make();
  ASSERT_TRUE(folder);
  const auto state = folder->path() / "state";
  std::filesystem::create_directory(state);
  constexpr std::uint32_t kSequence = 5;
  ASSERT_TRUE(CommitJournal::Open(state / "journal.db")->NoteVoid(kSequence));
  const std::string config = BENDLOOP_SOURCE_DIR "/config";
  drivers::SimulatedBenderOptions holds;
  holds.map = config::LoadRegisterMap(config + "/register-maps/default.toml").value();
  holds.program.sequence = kSequence;
  holds.program.program.rows = {{100, 0, 60, 20.0}, {100, 0, 0, {}}};
  const auto bender = drivers::SimulatedBender::Start(std::move(holds));
  ASSERT_TRUE(bender) << bender.error().message;
  DaemonOptions options;
  options.config = folder->path() / "cell.toml";
  std::ofstream(options.config) << "schema = \"bendloop.cell/1\"\nname = \"test\"\npart = \""
                                << config << "/parts/demo.toml\"\nstate_dir = \"state\"\n"
                                << "[scanner]\nkind = \"stream\"\nport = 1\n"
                                << "[bender]\nlink = \"modbus-tcp\"\nport = " << (*bender)->port()
                                << "\nregister_map = \"" << config
                                << "/register-maps/default.toml\"\n";
  const auto daemon = Daemon::Start(options);
  ASSERT_TRUE(daemon) << daemon.error().message;
  const auto status = FetchStatus(state / "status.json");
  ASSERT_TRUE(status) << status.error().message;
  EXPECT_NE(status->dump().find("BL4002"), std::string::npos) << status->dump();
}

}  // namespace
}  // namespace bendloop::host
