// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>

namespace bendloop::host {

// What a file system has left for who is not root.
struct FreeSpace {
  std::uint64_t bytes = 0;
  // Files that may still be made (inodes): a disk without them is full, whatever room it has.
  // UINT64_MAX where the file system has no limit of its own.
  std::uint64_t names = UINT64_MAX;
};

// Fewer than a recording, its side files and its result take, some ten times.
inline constexpr std::uint64_t kLeastFreeNames = 64;

// Of the file system that has `place`, or would have it if it were made; empty where that cannot be
// told.
std::optional<FreeSpace> FreeSpaceAt(const std::filesystem::path& place);

}  // namespace bendloop::host
