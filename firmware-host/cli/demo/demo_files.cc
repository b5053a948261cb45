// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cli/demo/demo_files.h"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <cerrno>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

#include "firmware-host/cell/part_plan.h"
#include "firmware-host/cli/demo/shipped_texts.h"
#include "firmware-host/console/output_file.h"
#include "firmware-host/console/whole_file.h"
#include "firmware-host/result/program_json.h"
#include "pipeline/correction/material.h"

namespace bendloop::host {
namespace {

namespace fs = std::filesystem;

// By this a folder is known to be a demo's own.
constexpr const char* kMarker = ".bendloop-demo";

constexpr const char* kCellHead =
    R"(# Written by `bendloop demo`. The live run reached its scanner and a bender on TCP by the daemon's
# options --scanner and --bender, one on CAN by live-cell.toml; a replay of cell.toml starts the
# simulated bender itself.
schema = "bendloop.cell/1"
name = "Demo cell"
part = "part.toml"
state_dir = "."

[scanner]
kind = "simulated"
queue_profiles = 4096   # 4 s of scan: other work on this machine must not cost profiles
)";

constexpr const char* kCellTail = R"(
[correction]
gain_length = 1.0
gain_rotation = 1.0
gain_angle = 1.0

[record]
directory = "sessions"
)";

std::string CellText(const std::string& bender) {
  return std::string(kCellHead) + "\n[bender]\n" + bender + kCellTail;
}

// The marker stays: it is the lock, and a removal cut short can be taken up again.
void Clear(const fs::path& out) {
  std::error_code error;
  for (const char* name : {"cell.toml",
                           "live-cell.toml",
                           "part.toml",
                           "register-map.toml",
                           "canopen-map.toml",
                           "bender.eds",
                           "first-program.json",
                           "journal.db",
                           "journal.db-wal",
                           "journal.db-shm",
                           "history.db",
                           "history.db-wal",
                           "history.db-shm",
                           "lot.json",
                           "lock",
                           "status.json",
                           "status.sock",
                           "report.html",
                           "results",
                           "sessions",
                           "tray",
                           "scans",
                           "logs"}) {
    fs::remove_all(out / name, error);
  }
}

}  // namespace

DemoLock::~DemoLock() {
  if (descriptor_ >= 0) ::close(descriptor_);
}

hal::Result<DemoLock> LockDemoFolder(const fs::path& out) {
  std::error_code error;
  if (fs::exists(out, error) && !fs::is_directory(out, error)) {
    return hal::Fail(hal::ErrorKind::kUsage,
                     "--out: '" + out.string() + "' is no folder; name another one");
  }
  if (!fs::exists(out / kMarker, error) && fs::exists(out, error) && !fs::is_empty(out, error)) {
    return hal::Fail(hal::ErrorKind::kUsage, "--out: '" + out.string() +
                                                 "' holds files that are not of a demo; name an "
                                                 "empty or a new folder");
  }
  const auto failed = [&](const std::string& why) {
    return hal::Fail(hal::ErrorKind::kDevice, out.string() + ": cannot be created: " + why);
  };
  fs::create_directories(out, error);
  if (error) return failed(error.message());
  const int file = ::open((out / kMarker).c_str(), O_RDWR | O_CREAT | O_NOFOLLOW | O_CLOEXEC, 0644);
  if (file < 0) return failed(std::generic_category().message(errno));
  DemoLock lock(file);
  if (::flock(file, LOCK_EX | LOCK_NB) != 0) {
    return hal::Fail(hal::ErrorKind::kUsage, "--out: another demo runs in '" + out.string() +
                                                 "'; name another folder, or wait for its end");
  }
  return lock;
}

void RemoveUnfinished(const fs::path& out) {
  std::error_code error;
  std::vector<fs::path> unfinished;
  for (const auto& entry : fs::directory_iterator(out / "sessions", error)) {
    const std::string name = entry.path().string();
    if (name.ends_with("-wal")) unfinished.emplace_back(name.substr(0, name.size() - 4));
  }
  for (const fs::path& session : unfinished) {
    for (const char* what : {"", "-wal", "-shm"}) {
      fs::remove(session.string() + what, error);
    }
  }
}

fs::path LiveCellFile(const DemoOptions& options) {
  return options.out / (options.link == DemoLink::kTcp ? "cell.toml" : "live-cell.toml");
}

hal::Result<void> WriteDemoFiles(const DemoOptions& options) {
  const fs::path& out = options.out;
  std::string part = kDemoPart;
  if (!options.part.empty()) {
    auto text = ReadWholeFile(options.part);
    if (!text) return hal::Fail(text.error());
    part = std::move(*text);
  }
  Clear(out);
  std::error_code error;
  fs::create_directories(out / "tray", error);
  fs::create_directories(out / "logs", error);
  fs::create_directories(out / "scans", error);
  if (error) {
    return hal::Fail(hal::ErrorKind::kDevice,
                     out.string() + ": cannot be created: " + error.message());
  }
  std::vector<std::pair<const char*, std::string>> files = {
      {"cell.toml", CellText("link = \"simulated\"\nregister_map = \"register-map.toml\"\n")},
      {"part.toml", part},
      {"register-map.toml", kDefaultRegisterMap}};
  const std::string interface = "can_interface = \"" + options.can_interface + "\"\n";
  if (options.link == DemoLink::kCanIsotp) {
    files.emplace_back("live-cell.toml", CellText("link = \"can-isotp\"\n" + interface +
                                                  "register_map = \"register-map.toml\"\n"));
  }
  if (options.link == DemoLink::kCanopen) {
    files.emplace_back("live-cell.toml",
                       CellText("link = \"canopen\"\n" + interface +
                                "can_node_id = " + std::to_string(kDemoNodeId) +
                                "\nobject_dictionary = \"bender.eds\"\nregister_map = "
                                "\"canopen-map.toml\"\n"));
    files.emplace_back("canopen-map.toml", kCanopenRegisterMap);
    files.emplace_back("bender.eds", kDefaultObjectDictionary);
  }
  for (const auto& [name, text] : files) {
    if (auto written = WriteOutputFile(out / name, text); !written) return written;
  }
  return {};
}

hal::Result<void> WriteFirstProgram(const fs::path& out, const config::CellConfig& cell) {
  const auto nominal = NominalProgram(cell.part);
  if (!nominal) return hal::Fail(nominal.error());
  const auto first = pipeline::InitialProgram(*nominal, MaterialOf(cell.part));
  if (!first) return hal::Fail(first.error());
  return WriteOutputFile(out / "first-program.json", Dump({{"rows", RowsJson(*first)}}, 2) + "\n");
}

}  // namespace bendloop::host
