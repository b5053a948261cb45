// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <system_error>

namespace bendloop::drivers {

// What SQLite keeps beside a database, by what follows its name.
inline constexpr const char* kSideFiles[] = {"-wal", "-shm", "-journal"};

inline std::filesystem::path Beside(const std::filesystem::path& path, const char* side) {
  return path.string() + side;
}

// Those of a database that is gone: left beside a new one they would be taken for that one's.
inline void RemoveSideFiles(const std::filesystem::path& path) {
  std::error_code none;
  for (const char* side : kSideFiles) std::filesystem::remove(Beside(path, side), none);
}

}  // namespace bendloop::drivers
