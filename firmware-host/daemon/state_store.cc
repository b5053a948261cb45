// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/daemon/state_store.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cstdio>
#include <system_error>
#include <utility>
#include <vector>

#include "firmware-host/cell/run_context.h"
#include "firmware-host/console/output_file.h"
#include "firmware-host/console/whole_file.h"
#include "firmware-host/workers/want_of_memory.h"
#include "hal/folder.h"

namespace bendloop::host {
namespace {

namespace fs = std::filesystem;

std::string Text(int error_number) { return std::generic_category().message(error_number); }

constexpr std::string_view kNamePrefix = "part-";

fs::path LotFile(const fs::path& directory, std::uint32_t part) {
  return directory / (part == 0 ? "lot.json" : "lot-" + std::to_string(part) + ".json");
}

unsigned LargestNumber(const fs::path& directory) {
  unsigned largest = 0;
  std::error_code error;
  for (const fs::path& each : hal::PathsIn(directory, error)) {
    largest = std::max(largest, NumberInName(each.filename().string()));
  }
  return largest;
}

// What a power cut left of files that were being written (output_file.cc): ".lot.json." and 16 hex
// digits. Who holds the lock is the only one who writes there.
void RemoveHalfWritten(const fs::path& directory) {
  constexpr std::size_t kDigits = 16;
  std::vector<fs::path> found;
  std::error_code error;
  for (const fs::path& each : hal::PathsIn(directory, error)) {
    const std::string name = each.filename().string();
    const std::size_t dot = name.rfind('.');
    if (name.starts_with('.') && dot > 0 && name.size() == dot + 1 + kDigits &&
        name.find_first_not_of("0123456789abcdef", dot + 1) == std::string::npos) {
      found.push_back(each);
    }
  }
  for (const fs::path& path : found) fs::remove(path, error);
}

// What root wrote while the daemon was away belongs to whom the folder does, or the daemon could
// not go on with it. No link is followed, and no file that has another name: they may be anywhere.
void GiveToOwnerOf(const fs::path& directory) {
  struct stat folder {};
  if (::geteuid() != 0 || ::stat(directory.c_str(), &folder) != 0 || folder.st_uid == 0) return;
  std::error_code error;
  for (const fs::path& each : hal::PathsIn(directory, error)) {
    struct stat file {};
    const std::string path = each.string();
    if (::lstat(path.c_str(), &file) != 0 || file.st_uid != 0) continue;
    const bool is_folder = S_ISDIR(file.st_mode);
    if (!is_folder && !(S_ISREG(file.st_mode) && file.st_nlink == 1)) continue;
    // One that cannot be given away stays root's, as it was.
    [[maybe_unused]] const int kept = ::lchown(path.c_str(), folder.st_uid, folder.st_gid);
  }
}

}  // namespace

hal::Result<StateStore> StateStore::Open(const fs::path& directory, StateUser user) {
  std::error_code error;
  fs::create_directories(directory / "results", error);
  if (!error) fs::create_directories(directory / "requests", error);
  if (error) {
    return hal::Fail(hal::ErrorKind::kDevice,
                     directory.string() + ": cannot create the state directory: " +
                         error.message() + "; set state_dir to one that may be written");
  }
  const std::string path = (directory / "lock").string();
  const int lock = ::open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0644);
  if (lock < 0) {
    return hal::Fail(hal::ErrorKind::kDevice, path + ": cannot be opened: " + Text(errno) +
                                                  "; set state_dir to one that may be written");
  }
  if (::flock(lock, LOCK_EX | LOCK_NB) != 0) {
    ::close(lock);
    return hal::Fail(hal::ErrorKind::kDevice,
                     path +
                         ": another bendloopd or replay works with this state directory; stop "
                         "it or give this one its own state_dir");
  }
  StateStore store(directory, lock);
  RemoveHalfWritten(directory);
  RemoveHalfWritten(store.results());
  if (user == StateUser::kCell && fs::exists(store.acceptance(), error)) {
    return hal::Fail(hal::ErrorKind::kDevice,
                     store.acceptance().string() +
                         ": an acceptance run was cut, and the bender may hold a program of its; "
                         "'bendloop acceptance --restore --config CELL.toml' puts back the cell's");
  }
  return store;
}

StateStore::StateStore(StateStore&& other) noexcept
    : directory_(std::move(other.directory_)), lock_(std::exchange(other.lock_, -1)) {}

StateStore::~StateStore() {
  if (lock_ < 0) return;
  HasMemoryFor([this] {
    GiveToOwnerOf(directory_);
    GiveToOwnerOf(results());
  });
  ::close(lock_);
}

unsigned StateStore::LastNumber(const fs::path& sessions) const {
  return std::max(LargestNumber(results()), LargestNumber(sessions));
}

unsigned NumberInName(const std::string& name) {
  if (name.rfind(kNamePrefix, 0) != 0) return 0;
  unsigned number = 0;
  const char* begin = name.data() + kNamePrefix.size();
  std::from_chars(begin, name.data() + name.size(), number);
  return number;
}

std::string PartName(unsigned number) {
  char name[32];
  std::snprintf(name, sizeof name, "part-%04u", number);
  return name;
}

hal::Result<std::optional<pipeline::LotState>> ReadLotOf(const fs::path& directory,
                                                         std::string_view key, std::uint32_t part) {
  const fs::path file = LotFile(directory, part);
  std::error_code error;
  if (!fs::exists(file, error)) return std::optional<pipeline::LotState>();
  const auto text = ReadWholeFile(file);
  if (!text) return hal::Fail(text.error());
  auto lot = ReadLot(*text, file.string(), key);
  if (!lot) {
    return hal::Fail(lot.error().kind,
                     lot.error().message + "; remove the file to begin a new lot");
  }
  return lot;
}

hal::Result<std::optional<pipeline::LotState>> StateStore::Lot(std::string_view key,
                                                               std::uint32_t part) const {
  return ReadLotOf(directory_, key, part);
}

bool StateStore::HasLot(std::uint32_t part) const {
  std::error_code error;
  return fs::exists(LotFile(directory_, part), error) || error;
}

hal::Result<void> StateStore::KeepLot(const pipeline::LotState& lot, std::string_view key,
                                      std::uint32_t part) const {
  return WriteOutputFile(LotFile(directory_, part), WriteLot(lot, key));
}

}  // namespace bendloop::host
