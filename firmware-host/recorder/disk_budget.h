// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <vector>

namespace bendloop::host {

// A session is kept for good while this file stands beside it: part-0007.session.keep.
inline constexpr const char* kKeepSuffix = ".keep";

// Removes the oldest *.session files (with their SQLite side files) of `directory` until all of
// them together take at most `budget_bytes`. Pinned ones and `in_use` stay. Returns what was
// removed, oldest first; files that cannot be removed are passed over.
std::vector<std::filesystem::path> KeepDiskBudget(const std::filesystem::path& directory,
                                                  std::uint64_t budget_bytes,
                                                  const std::filesystem::path& in_use);

// Of all sessions there, side files included.
std::uint64_t BytesOfSessions(const std::filesystem::path& directory);

}  // namespace bendloop::host
