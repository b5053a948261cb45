// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/recorder/disk_budget.h"

#include <algorithm>
#include <system_error>

namespace bendloop::host {
namespace {

namespace fs = std::filesystem;

struct Session {
  fs::path path;
  fs::file_time_type written;
  std::uint64_t bytes = 0;
};

constexpr const char* kSideFiles[] = {"-wal", "-shm", "-journal"};

fs::path Beside(const fs::path& path, const char* suffix) { return path.string() + suffix; }

std::uint64_t SizeOf(const fs::path& path) {
  std::error_code error;
  const auto bytes = fs::file_size(path, error);
  return error ? 0 : bytes;
}

std::uint64_t SizeWithSides(const fs::path& path) {
  std::uint64_t bytes = SizeOf(path);
  for (const char* side : kSideFiles) bytes += SizeOf(Beside(path, side));
  return bytes;
}

}  // namespace

std::uint64_t BytesOfSessions(const fs::path& directory) {
  std::uint64_t total = 0;
  std::error_code error;
  for (fs::directory_iterator it(directory, error), end; !error && it != end; it.increment(error)) {
    if (it->path().extension() == ".session") total += SizeWithSides(it->path());
  }
  return total;
}

std::vector<fs::path> KeepDiskBudget(const fs::path& directory, std::uint64_t budget_bytes,
                                     const fs::path& in_use) {
  std::vector<Session> sessions;
  std::uint64_t total = 0;
  std::error_code error;
  for (fs::directory_iterator it(directory, error), end; !error && it != end; it.increment(error)) {
    if (it->path().extension() != ".session" || !it->is_regular_file(error)) continue;
    Session session{it->path(), it->last_write_time(error), SizeWithSides(it->path())};
    total += session.bytes;
    const bool pinned = fs::exists(Beside(session.path, kKeepSuffix), error);
    if (!pinned && session.path != in_use) sessions.push_back(std::move(session));
  }
  // The name decides between files of the same time, so that the order is the same every time.
  std::sort(sessions.begin(), sessions.end(), [](const Session& a, const Session& b) {
    return a.written != b.written ? a.written < b.written : a.path < b.path;
  });
  std::vector<fs::path> removed;
  for (const Session& session : sessions) {
    if (total <= budget_bytes) break;
    if (!fs::remove(session.path, error)) continue;
    for (const char* side : kSideFiles) fs::remove(Beside(session.path, side), error);
    total -= session.bytes;
    removed.push_back(session.path);
  }
  return removed;
}

}  // namespace bendloop::host
