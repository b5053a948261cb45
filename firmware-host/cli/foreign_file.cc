// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cli/foreign_file.h"

#include <algorithm>
#include <cctype>
#include <filesystem>
#include <fstream>
#include <string_view>
#include <system_error>

namespace bendloop::host {
namespace {

constexpr const char* kExpected =
    "expected a cell, part or register map (TOML), an object dictionary (EDS) or a session "
    "(SQLite database)";

// Where a file that has a `schema` has it: long before.
constexpr std::size_t kSeenBytes = 4096;

// How a database begins, and how long that is (sqlite.org/fileformat2.html).
constexpr std::string_view kDatabaseStart = "SQLite format 3";
constexpr std::size_t kDatabaseHeaderBytes = 100;

// What other files are, by how they begin or, where they say nothing of themselves, by how their
// names end.
struct Foreign {
  std::string_view start;
  std::string_view ending;
  const char* is;
};
constexpr Foreign kForeign[] = {
    {"ply", ".ply", "a point cloud; `bendloop reconstruct` measures it"},
    {"# .PCD", ".pcd", "a point cloud; `bendloop reconstruct` measures it"},
    {"ISO-10303-21", ".step", "CAD (STEP); `bendloop nominal` makes a part of it"},
    {"ISO-10303-21", ".stp", "CAD (STEP); `bendloop nominal` makes a part of it"},
    {"", ".iges", "CAD (IGES); `bendloop nominal` makes a part of it"},
    {"", ".igs", "CAD (IGES); `bendloop nominal` makes a part of it"},
    {"", ".csv", "a table or a point cloud; `bendloop convert` or `bendloop reconstruct` reads it"},
    {"", ".xyz", "a point cloud; `bendloop reconstruct` measures it"},
};

std::string FirstBytes(const std::string& file) {
  std::string text(kSeenBytes, '\0');
  std::ifstream stream(file, std::ios::binary);
  if (!stream) return {};
  stream.read(text.data(), static_cast<std::streamsize>(text.size()));
  text.resize(static_cast<std::size_t>(std::max<std::streamsize>(stream.gcount(), 0)));
  return text;
}

}  // namespace

std::string WhyForeign(const std::string& file) {
  std::error_code error;
  if (!std::filesystem::is_regular_file(file, error)) return {};
  const auto bytes = std::filesystem::file_size(file, error);
  if (error) return {};
  if (bytes == 0) {
    return file + ": the file is empty (0 bytes), " + kExpected + "; copy or write it again";
  }
  const std::string text = FirstBytes(file);
  std::string ending = std::filesystem::path(file).extension().string();
  std::transform(ending.begin(), ending.end(), ending.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  if (text.empty() || text.find("schema") != std::string::npos) return {};
  const bool is_session = ending == ".session" || ending == ".db";
  const auto seen = std::min(text.size(), kDatabaseStart.size());
  const bool starts_as_database =
      text.compare(0, seen, kDatabaseStart.substr(0, seen)) == 0 && (is_session || seen > 5);
  if (starts_as_database && bytes < kDatabaseHeaderBytes) {
    return file + ": the file ends after byte " + std::to_string(bytes) +
           ", expected at least the " + std::to_string(kDatabaseHeaderBytes) +
           " bytes that a session (SQLite database) begins with; copy it again";
  }
  if (is_session && !starts_as_database) {
    return file + ": byte 1: found no session, expected it to begin with '" +
           std::string(kDatabaseStart) + "'; is this the right file, copied as it is?";
  }
  for (const Foreign& other : kForeign) {
    const bool starts =
        !other.start.empty() && text.compare(0, other.start.size(), other.start) == 0;
    if (starts || ending == other.ending) {
      return file + ":1: found " + (starts ? "" : "a name of ") + other.is + "; " + kExpected;
    }
  }
  return {};
}

}  // namespace bendloop::host
