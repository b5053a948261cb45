// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/retention/retention.h"

#include <algorithm>
#include <charconv>
#include <chrono>
#include <optional>
#include <string_view>
#include <system_error>
#include <tuple>

#include "drivers/sqlite/side_files.h"
#include "firmware-host/retention/age.h"
#include "hal/folder.h"

namespace bendloop::host {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kNamePrefix = "part-";

struct File {
  fs::path path;
  std::string name;          // "part-0007"
  std::uint64_t number = 0;  // 7; 0: it has none
  std::int64_t written_ms = 0;
  std::uint64_t bytes = 0;
  bool is_kept = false;
};

std::uint64_t SizeOf(const fs::path& path) {
  std::error_code error;
  const auto bytes = fs::file_size(path, error);
  return error ? 0 : bytes;
}

std::uint64_t SizeWithSides(const fs::path& path) {
  std::uint64_t bytes = SizeOf(path);
  for (const char* side : drivers::kSideFiles) bytes += SizeOf(drivers::Beside(path, side));
  return bytes;
}

std::uint64_t NumberOf(std::string_view name) {
  std::uint64_t number = 0;
  if (!name.starts_with(kNamePrefix)) return number;
  std::from_chars(name.data() + kNamePrefix.size(), name.data() + name.size(), number);
  return number;
}

std::int64_t UnixMs(fs::file_time_type time) {
  const auto system = std::chrono::file_clock::to_sys(time).time_since_epoch();
  return std::chrono::duration_cast<std::chrono::milliseconds>(system).count();
}

// Those of `directory` that end so, oldest first.
std::vector<File> FilesOf(const fs::path& directory, std::string_view extension,
                          const std::set<std::string>& kept) {
  std::vector<File> files;
  std::error_code error;
  for (const fs::path& path : hal::PathsIn(directory, error)) {
    std::error_code none;
    if (path.extension() != extension || !fs::is_regular_file(path, none)) continue;
    File file;
    file.path = path;
    file.name = file.path.stem().string();
    file.number = NumberOf(file.name);
    const auto written = fs::last_write_time(path, none);
    if (!none) file.written_ms = UnixMs(written);
    file.bytes = SizeWithSides(file.path);
    file.is_kept = kept.count(file.name) > 0;
    files.push_back(std::move(file));
  }
  // By the path in the end, so that the order is the same every time.
  std::sort(files.begin(), files.end(), [](const File& a, const File& b) {
    const std::int64_t time_a = a.number == 0 ? a.written_ms : 0;
    const std::int64_t time_b = b.number == 0 ? b.written_ms : 0;
    return std::tie(a.number, time_a, a.path) < std::tie(b.number, time_b, b.path);
  });
  return files;
}

// Takes it out of `files` if it is gone.
bool Remove(std::vector<File>& files, std::size_t at, std::vector<fs::path>& removed) {
  const File& file = files[at];
  if (file.is_kept) return false;
  // All that wants memory comes first: what goes, goes with its side files, and is told.
  const drivers::SidePaths sides = drivers::SidesOf(file.path);
  removed.push_back(file.path);
  std::error_code error;
  if (!fs::remove(file.path, error)) {
    removed.pop_back();
    return false;
  }
  for (const fs::path& side : sides) fs::remove(side, error);
  files.erase(files.begin() + static_cast<std::ptrdiff_t>(at));
  return true;
}

void RemoveOld(std::vector<File>& files, const RetentionLimits& limits, std::int64_t now_ms,
               std::vector<fs::path>& removed) {
  if (limits.most_days <= 0) return;
  Age age(now_ms);
  std::size_t old = 0;  // so many at the beginning are
  for (std::size_t i = files.size(); i > 0 && old == 0; --i) {
    if (age.DaysOf(files[i - 1].written_ms) > limits.most_days) old = i;
  }
  for (std::size_t at = 0; old > 0; --old) at += Remove(files, at, removed) ? 0 : 1;
}

void RemoveBeyondBudget(std::vector<File>& files, std::uint64_t most_bytes,
                        std::vector<fs::path>& removed) {
  std::uint64_t total = 0;
  for (const File& file : files) total += file.bytes;
  for (std::size_t at = 0; at < files.size() && total > most_bytes;) {
    const std::uint64_t bytes = files[at].bytes;
    if (Remove(files, at, removed)) {
      total -= bytes;
    } else {
      ++at;
    }
  }
}

void RemoveUntilFree(std::vector<File>& files, std::size_t newest,
                     const std::function<bool()>& is_free, std::vector<fs::path>& removed) {
  for (std::size_t at = 0; files.size() > newest + at && !is_free();) {
    at += Remove(files, at, removed) ? 0 : 1;
  }
}

}  // namespace

RetentionWorld SystemRetentionWorld() {
  RetentionWorld world;
  world.free_bytes = [](const fs::path& directory) -> std::uint64_t {
    std::error_code error;
    const fs::space_info space = fs::space(directory, error);
    return error ? UINT64_MAX : space.available;
  };
  const auto now = std::chrono::system_clock::now().time_since_epoch();
  world.now_ms = std::chrono::duration_cast<std::chrono::milliseconds>(now).count();
  return world;
}

hal::Result<Removed> KeepLimits(const RetentionPlaces& places, const RetentionLimits& limits,
                                const std::set<std::string>& kept, const RetentionWorld& world) {
  const auto pinned = PinnedNames(places.sessions);
  if (!pinned) return hal::Fail(pinned.error());
  std::set<std::string> untouched = *pinned;
  untouched.insert(kept.begin(), kept.end());
  Removed removed;
  std::vector<File> sessions = FilesOf(places.sessions, ".session", untouched);
  std::vector<File> results;
  if (!places.results.empty()) results = FilesOf(places.results, ".json", untouched);
  RemoveOld(sessions, limits, world.now_ms, removed.sessions);
  RemoveOld(results, limits, world.now_ms, removed.results);
  RemoveBeyondBudget(sessions, limits.most_sessions_bytes, removed.sessions);
  if (limits.least_free_bytes == 0) return removed;
  const auto is_free = [&](const fs::path& place) {
    return world.free_bytes(place) >= limits.least_free_bytes;
  };
  RemoveUntilFree(
      sessions, kNewestSessions, [&] { return is_free(places.sessions); }, removed.sessions);
  RemoveUntilFree(
      results, kNewestResults, [&] { return is_free(places.results); }, removed.results);
  return removed;
}

std::uint64_t BytesOfSessions(const fs::path& directory) {
  std::uint64_t total = 0;
  std::error_code error;
  for (const fs::path& path : hal::PathsIn(directory, error)) {
    if (path.extension() == ".session") total += SizeWithSides(path);
  }
  return total;
}

hal::Result<std::set<std::string>> PinnedNames(const fs::path& sessions) {
  std::set<std::string> names;
  std::error_code error;
  for (const fs::path& path : hal::PathsIn(sessions, error)) {
    if (path.extension() != kKeepSuffix || path.stem().extension() != ".session") continue;
    names.insert(path.stem().stem().string());
  }
  // One that is not there has none.
  if (error && error != std::errc::no_such_file_or_directory) {
    return hal::Fail(hal::ErrorKind::kDevice, sessions.string() + ": cannot be listed: " +
                                                  error.message() + "; nothing is removed");
  }
  return names;
}

}  // namespace bendloop::host
