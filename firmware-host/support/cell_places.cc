// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/support/cell_places.h"

#include <array>
#include <regex>
#include <utility>

#include "config/load.h"
#include "firmware-host/console/whole_file.h"

namespace bendloop::host {
namespace {

namespace fs = std::filesystem;

// The keys of a cell file that name files, and what they say in the bundle.
constexpr std::array<std::pair<const char*, const char*>, 6> kPathKeys = {{
    {"part", "part.toml"},
    {"parts_dir", "parts"},
    {"register_map", "register-map.toml"},
    {"object_dictionary", "object-dictionary.eds"},
    {"state_dir", "../state"},
    {"directory", "sessions"},
}};

// The key's line up to its value, and the value in its quotes.
std::regex LineOf(const char* key) {
  return std::regex("(^|\n)([ \t]*" + std::string(key) + "[ \t]*=[ \t]*)(\"[^\"\n]*\"|'[^'\n]*')");
}

// What the text says of a key, from `folder`; `otherwise` where it says nothing.
fs::path Named(const std::string& text, const char* key, const fs::path& folder,
               const fs::path& otherwise) {
  std::smatch found;
  if (!std::regex_search(text, found, LineOf(key))) return otherwise;
  const std::string quoted = found[3].str();
  const std::string value = quoted.substr(1, quoted.size() - 2);
  return value.empty() ? otherwise : (folder / value).lexically_normal();
}

}  // namespace

hal::Result<config::CellConfig> PlacesOfCell(const fs::path& file,
                                             std::vector<std::string>& notes) {
  auto cell = config::LoadCell(file);
  if (cell) return cell;
  const auto text = ReadWholeFile(file, config::kMaxFileBytes);
  if (!text) return hal::Fail(cell.error());
  notes.push_back("settings that hold: " + cell.error().message);
  config::CellConfig places;
  places.file = fs::absolute(file).lexically_normal();
  const fs::path folder = places.file.parent_path();
  places.part_file = Named(*text, "part", folder, {});
  places.parts_dir = Named(*text, "parts_dir", folder, {});
  places.bender.register_map_file = Named(*text, "register_map", folder, {});
  places.bender.object_dictionary_file = Named(*text, "object_dictionary", folder, {});
  places.state_dir = Named(*text, "state_dir", folder, places.state_dir);
  places.record.directory =
      Named(*text, "directory", places.state_dir, places.state_dir / places.record.directory);
  return places;
}

std::string WithBundledPaths(const std::string& cell_text) {
  std::string text = cell_text;
  for (const auto& [key, value] : kPathKeys) {
    text = std::regex_replace(text, LineOf(key), "$1$2\"" + std::string(value) + "\"");
  }
  return text;
}

}  // namespace bendloop::host
