// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <filesystem>
#include <iterator>
#include <system_error>

namespace bendloop::drivers {

// What SQLite keeps beside a database, by what follows its name.
inline constexpr const char* kSideFiles[] = {"-wal", "-shm", "-journal"};

inline std::filesystem::path Beside(const std::filesystem::path& path, const char* side) {
  return path.string() + side;
}

using SidePaths = std::array<std::filesystem::path, std::size(kSideFiles)>;
inline SidePaths SidesOf(const std::filesystem::path& path) {
  SidePaths sides;
  for (std::size_t i = 0; i < sides.size(); ++i) sides[i] = Beside(path, kSideFiles[i]);
  return sides;
}

// Those of a database that is gone: left beside a new one they would be taken for that one's.
inline void RemoveSideFiles(const std::filesystem::path& path) {
  std::error_code none;
  for (const std::filesystem::path& side : SidesOf(path)) std::filesystem::remove(side, none);
}

}  // namespace bendloop::drivers
