// SPDX-License-Identifier: Apache-2.0
#include "drivers/sqlite/damaged_file.h"

#include <algorithm>
#include <chrono>
#include <ctime>
#include <system_error>

#include "drivers/sqlite/database.h"
#include "drivers/sqlite/side_files.h"
#include "hal/folder.h"

namespace bendloop::drivers {
namespace {

namespace fs = std::filesystem;

constexpr const char* kMark = ".damaged-";
// As many files of one second are no accident any more.
constexpr int kMostOfOneName = 1000;

std::string Stamp(std::int64_t unix_ms) {
  const std::time_t seconds = unix_ms / 1000;
  std::tm utc{};
  gmtime_r(&seconds, &utc);
  char text[32];
  std::strftime(text, sizeof text, "%Y%m%dT%H%M%SZ", &utc);
  return text;
}

bool IsThere(const fs::path& path) {
  std::error_code error;
  return fs::exists(fs::symlink_status(path, error));
}

// The file alone: what follows it is worth nothing without it.
bool Rename(const fs::path& from, const fs::path& to, std::error_code& error) {
  fs::rename(from, to, error);
  return !error;
}

}  // namespace

std::string DamageOf(const fs::path& path) {
  if (!IsThere(path)) return "";
  const auto of = [](const hal::Error& error) {
    return error.kind == hal::ErrorKind::kBadInput ? error.message : std::string();
  };
  auto database = Database::Open(
      path.string(), path.string(),
      {.access = DatabaseOptions::Access::kWrite, .busy_timeout = std::chrono::seconds(2)});
  if (!database) return of(database.error());
  auto check = database->Prepare("PRAGMA quick_check(1)");
  if (!check) return of(check.error());
  if (check->Step() != Statement::Outcome::kRow) return of(database->Failed("cannot be checked"));
  const std::string said(check->Text(0));
  return said == "ok" ? "" : path.string() + ": " + said;
}

hal::Result<fs::path> MoveAside(const fs::path& path, std::int64_t unix_ms) {
  const std::string name = path.string() + kMark + Stamp(unix_ms);
  fs::path aside = name;
  for (int more = 2; IsThere(aside) && more < kMostOfOneName; ++more) {
    aside = name + "-" + std::to_string(more);
  }
  std::error_code error;
  if (IsThere(aside) || !Rename(path, aside, error)) {
    return hal::Fail(hal::ErrorKind::kDevice,
                     path.string() + ": is damaged and cannot be moved to " + aside.string() +
                         (error ? ": " + error.message() : "") + "; move it away by hand");
  }
  for (const char* side : kSideFiles) {
    if (!IsThere(Beside(path, side))) continue;
    // Left beside a new database it would be taken for that one's.
    if (!Rename(Beside(path, side), Beside(aside, side), error)) {
      return hal::Fail(hal::ErrorKind::kDevice,
                       path.string() + side + ": belongs to a damaged file and cannot be moved: " +
                           error.message() + "; move it away by hand");
    }
  }
  return aside;
}

std::vector<fs::path> MovedAside(const fs::path& path) {
  std::vector<fs::path> found;
  const std::string prefix = path.filename().string() + kMark;
  std::error_code error;
  for (const fs::path& each : hal::PathsIn(path.parent_path(), error)) {
    const std::string name = each.filename().string();
    const bool is_side = std::any_of(std::begin(kSideFiles), std::end(kSideFiles),
                                     [&](const char* side) { return name.ends_with(side); });
    if (name.starts_with(prefix) && !is_side) found.push_back(each);
  }
  std::sort(found.begin(), found.end());
  return found;
}

}  // namespace bendloop::drivers
