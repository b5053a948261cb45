// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <set>
#include <string>
#include <vector>

#include "hal/result.h"

namespace bendloop::host {

// A session, its result and its row of the history are kept for good while this file stands beside
// the session: part-0007.session.keep.
inline constexpr const char* kKeepSuffix = ".keep";

// However full the disk is, so many of the newest stay: the last hour of a cell in trouble is what
// everybody asks for.
inline constexpr std::size_t kNewestSessions = 20;
inline constexpr std::size_t kNewestResults = 1000;

struct RetentionLimits {
  std::uint64_t most_sessions_bytes = 4096ull << 20;
  std::uint64_t least_free_bytes = 0;  // of the file system; 0: whatever is free
  double most_days = 0;                // retention/age.h; 0: no limit
};

struct RetentionPlaces {
  std::filesystem::path sessions;  // NAME.session
  std::filesystem::path results;   // NAME.json; "": none
};

// What the file system and the clock say; tests say something else.
struct RetentionWorld {
  std::function<std::uint64_t(const std::filesystem::path&)> free_bytes;
  std::int64_t now_ms = 0;
};
RetentionWorld SystemRetentionWorld();

// Oldest first.
struct Removed {
  std::vector<std::filesystem::path> sessions;
  std::vector<std::filesystem::path> results;
};

// Removes what the limits leave no room for, the oldest first: sessions (with their SQLite side
// files) that are more than the budget or too old, results that are too old; where the disk is full
// still, sessions, then results. Old is what has a small number (part-0007), whatever the clock
// said when it was written; what has none is older than all, by its time. Names in `kept`, and
// pinned ones, are never touched, and files that cannot be removed are passed over. Where it cannot
// be told what is pinned nothing is removed.
hal::Result<Removed> KeepLimits(const RetentionPlaces& places, const RetentionLimits& limits,
                                const std::set<std::string>& kept, const RetentionWorld& world);

// Of all sessions there, side files included.
std::uint64_t BytesOfSessions(const std::filesystem::path& directory);
// Names of all sessions that are pinned.
hal::Result<std::set<std::string>> PinnedNames(const std::filesystem::path& sessions);

}  // namespace bendloop::host
