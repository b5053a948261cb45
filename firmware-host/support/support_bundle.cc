// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/support/support_bundle.h"

#include <sys/utsname.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdio>
#include <memory>
#include <system_error>
#include <utility>

#include "drivers/sqlite/database.h"
#include "firmware-host/console/temporary_folder.h"
#include "firmware-host/console/version.h"
#include "firmware-host/console/whole_file.h"
#include "firmware-host/daemon/state_store.h"
#include "firmware-host/daemon/status_client.h"
#include "firmware-host/ledger/moment.h"
#include "firmware-host/result/json.h"
#include "firmware-host/support/cell_places.h"
#include "firmware-host/support/tar_file.h"

namespace bendloop::host {
namespace {

namespace fs = std::filesystem;

// Of the service's log: some days of a cell.
constexpr const char* kLogCommand =
    "timeout 30 journalctl -u bendloopd -n 20000 --no-pager -o short-iso 2>&1";
constexpr std::size_t kMostLogBytes = 32u << 20;
// More recordings than anybody asks for.
constexpr std::uint64_t kMostUnpackedBytes = 64ull << 30;

// What `bendloop` and the daemon keep of each name, newest last.
std::vector<fs::path> ByNumber(const fs::path& directory, const char* extension) {
  std::vector<std::pair<unsigned, fs::path>> found;
  std::error_code error;
  for (fs::directory_iterator it(directory, error), end; !error && it != end; it.increment(error)) {
    if (it->path().extension() != extension) continue;
    found.emplace_back(NumberInName(it->path().filename().string()), it->path());
  }
  std::sort(found.begin(), found.end());
  std::vector<fs::path> paths;
  for (auto& [number, path] : found) paths.push_back(std::move(path));
  return paths;
}

void KeepNewest(std::vector<fs::path>& paths, std::size_t count) {
  const std::size_t many = paths.size() > count ? paths.size() - count : 0;
  paths.erase(paths.begin(), paths.begin() + static_cast<std::ptrdiff_t>(many));
}

class Bundle {
 public:
  Bundle(TarWriter tar, const config::CellConfig& cell, std::vector<std::string> notes)
      : tar_(std::move(tar)), cell_(cell), notes_(std::move(notes)) {}

  // The first trouble with the tar itself ends it; trouble with what goes into it is a note.
  hal::Result<void> Fill(const SupportBundleOptions& options);
  const std::vector<std::string>& notes() const { return notes_; }

 private:
  void Text(const std::string& name, const std::string& text) {
    if (done_) done_ = tar_.AddText(name, text);
  }
  void File(const std::string& name, const fs::path& path);
  void Database(const std::string& name, const fs::path& path);
  void Settings();
  void State();
  void Recordings(const SupportBundleOptions& options);
  void Log(const fs::path& file);

  TarWriter tar_;
  const config::CellConfig& cell_;
  hal::Result<void> done_;
  std::vector<std::string> notes_;
};

void Bundle::File(const std::string& name, const fs::path& path) {
  std::error_code error;
  if (!done_ || path.empty()) return;
  if (!fs::exists(path, error) || ::access(path.c_str(), R_OK) != 0) {
    notes_.push_back(path.string() + ": not there, or not to be read by this user");
    return;
  }
  done_ = tar_.AddFile(name, path);
}

// As it is at one moment, with what stands in its log only.
void Bundle::Database(const std::string& name, const fs::path& path) {
  std::error_code error;
  if (!done_ || !fs::exists(path, error)) return;
  // A folder that nobody else may look into, as the copy's own mode is anybody's.
  const auto folder = TemporaryFolder::Make();
  if (!folder) {
    notes_.push_back(folder.error().message + "; the file as it lies there is in the bundle");
    return File(name, path);
  }
  const fs::path copy = folder->path() / "copy";
  auto database = drivers::Database::Open(
      path.string(), path.string(),
      {.access = drivers::DatabaseOptions::Access::kRead, .busy_timeout = std::chrono::seconds(5)});
  hal::Result<void> copied;
  if (!database) {
    copied = hal::Fail(database.error());
  } else if (auto vacuum = database->Prepare("VACUUM INTO ?"); !vacuum) {
    copied = hal::Fail(vacuum.error());
  } else {
    vacuum->Bind(copy.string());
    copied = database->Run(*vacuum, "copying");
  }
  if (copied) {
    File(name, copy);
  } else {
    notes_.push_back(copied.error().message + "; the file as it lies there is in the bundle");
    File(name, path);
  }
}

void Bundle::Settings() {
  if (const auto text = ReadWholeFile(cell_.file)) {
    Text("config/cell.toml", WithBundledPaths(*text));
    Text("config/cell.toml.original", *text);
  }
  File("config/part.toml", cell_.part_file);
  File("config/register-map.toml", cell_.bender.register_map_file);
  File("config/object-dictionary.eds", cell_.bender.object_dictionary_file);
  if (cell_.parts_dir.empty()) return;
  for (const fs::path& part : ByNumber(cell_.parts_dir, ".toml")) {
    File("config/parts/" + part.filename().string(), part);
  }
}

void Bundle::State() {
  const fs::path& state = cell_.state_dir;
  Database("state/journal.db", state / "journal.db");
  Database("state/history.db", state / "history.db");
  std::error_code error;
  for (fs::directory_iterator it(state, error), end; !error && it != end; it.increment(error)) {
    const std::string name = it->path().filename().string();
    const bool is_lot = name.starts_with("lot") && it->path().extension() == ".json";
    if (is_lot || name == "requests.log" || name == "acceptance.json") {
      File("state/" + name, it->path());
    }
  }
  if (error) notes_.push_back(state.string() + ": cannot be read: " + error.message());
  if (const auto status = FetchStatus(state / "status.json")) {
    Text("status.json", Dump(*status, 2) + "\n");
  } else {
    notes_.push_back("status: " + status.error().message);
  }
}

void Bundle::Recordings(const SupportBundleOptions& options) {
  auto results = ByNumber(cell_.state_dir / "results", ".json");
  KeepNewest(results, options.results);
  for (const fs::path& result : results) {
    File("state/results/" + result.filename().string(), result);
  }
  auto sessions = ByNumber(cell_.record.directory, ".session");
  KeepNewest(sessions, options.sessions);
  for (const fs::path& session : sessions) {
    const std::string name = "state/sessions/" + session.filename().string();
    std::error_code error;
    // One that is being written, or was cut, has a log beside it.
    fs::exists(session.string() + "-wal", error) ? Database(name, session) : File(name, session);
  }
}

void Bundle::Log(const fs::path& file) {
  if (!file.empty()) return File("bendloopd.log", file);
  const std::unique_ptr<FILE, int (*)(FILE*)> journal(popen(kLogCommand, "r"), pclose);
  std::string log;
  std::array<char, 4096> piece{};
  while (journal && log.size() < kMostLogBytes) {
    const std::size_t bytes = std::fread(piece.data(), 1, piece.size(), journal.get());
    if (bytes == 0) break;
    log.append(piece.data(), bytes);
  }
  Text("bendloopd.log", log);
}

hal::Result<void> Bundle::Fill(const SupportBundleOptions& options) {
  Settings();
  State();
  Recordings(options);
  Log(options.log);
  if (!options.findings.empty()) Text("doctor.json", options.findings);
  utsname machine{};
  uname(&machine);
  Text("bundle.json", Dump({{"schema", "bendloop.support/1"},
                            {"software", BuildText()},
                            {"time", UtcText(SystemMoment().unix_ms)},
                            {"kernel", std::string(machine.release) + " " + machine.machine},
                            {"missing", notes_}},
                           2) +
                          "\n");
  if (done_) done_ = tar_.Finish();
  return done_;
}

}  // namespace

hal::Result<std::vector<std::string>> WriteSupportBundle(const fs::path& out,
                                                         const SupportBundleOptions& options) {
  std::vector<std::string> notes;
  const auto cell = PlacesOfCell(options.config, notes);
  if (!cell) return hal::Fail(cell.error());
  auto tar = TarWriter::Create(out);
  if (!tar) return hal::Fail(tar.error());
  Bundle bundle(std::move(*tar), *cell, std::move(notes));
  if (auto filled = bundle.Fill(options); !filled) return hal::Fail(filled.error());
  return bundle.notes();
}

hal::Result<UnpackedBundle> UnpackSupportBundle(const fs::path& tar, const fs::path& into,
                                                const std::string& session) {
  if (auto done = Unpack(tar, into, kMostUnpackedBytes); !done) return hal::Fail(done.error());
  UnpackedBundle bundle;
  bundle.cell = into / "config/cell.toml";
  std::error_code error;
  const auto sessions = ByNumber(into / "state/sessions", ".session");
  if (!session.empty()) {
    bundle.session = into / "state/sessions" / (session + ".session");
  } else if (!sessions.empty()) {
    bundle.session = sessions.back();
  }
  if (bundle.session.empty() || !fs::exists(bundle.session, error)) {
    return hal::Fail(hal::ErrorKind::kBadInput,
                     tar.string() + ": no recording " + (session.empty() ? "" : session + " ") +
                         "in it; 'bendloop support-bundle --sessions N' puts the newest in");
  }
  if (fs::exists(bundle.cell, error)) return bundle;
  return hal::Fail(hal::ErrorKind::kBadInput, tar.string() + ": no config/cell.toml in it");
}

}  // namespace bendloop::host
