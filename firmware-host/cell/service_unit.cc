// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cell/service_unit.h"

#include <array>
#include <charconv>
#include <cmath>
#include <fstream>
#include <map>
#include <string>
#include <system_error>
#include <utility>

#include "hal/folder.h"
#include "hal/text.h"

namespace bendloop::host {
namespace {

namespace fs = std::filesystem;
using hal::Trimmed;
using std::chrono::nanoseconds;

// DefaultTimeoutStopSec of systemd-system.conf(5), where a unit says none.
constexpr std::chrono::seconds kStopOfSystemd{90};

// systemd.time(7); months and years would be no time of a stop.
constexpr std::array<std::pair<std::string_view, double>, 24> kSeconds = {{
    {"", 1},        {"s", 1},         {"sec", 1},        {"second", 1},       {"seconds", 1},
    {"us", 1e-6},   {"usec", 1e-6},   {"ms", 1e-3},      {"msec", 1e-3},      {"m", 60},
    {"min", 60},    {"minute", 60},   {"minutes", 60},   {"h", 3600},         {"hr", 3600},
    {"hour", 3600}, {"hours", 3600},  {"d", 86400},      {"day", 86400},      {"days", 86400},
    {"w", 604800},  {"week", 604800}, {"weeks", 604800}, {"\xc2\xb5s", 1e-6},
}};

// Beyond it a time counts as no bound.
constexpr double kLongestSeconds = 1e9;

// In the order that counts, highest first.
std::vector<fs::path> FoldersOf(const UnitPlaces& places) {
  std::vector<fs::path> folders;
  for (const fs::path& place : {places.etc, places.run, places.local_lib, places.usr_lib}) {
    folders.push_back(place / "systemd/system");
  }
  return folders;
}

// Of files of one name the highest counts; all that are left, in the order of their names.
std::map<std::string, fs::path> DropIns(const UnitPlaces& places) {
  std::map<std::string, fs::path> files;
  for (const std::string& kind : {std::string(kUnitName), std::string("service")}) {
    for (const fs::path& folder : FoldersOf(places)) {
      std::error_code error;
      for (const fs::path& path : hal::PathsIn(folder / (kind + ".d"), error)) {
        if (path.extension() == ".conf") files.try_emplace(path.filename().string(), path);
      }
    }
  }
  return files;
}

// A line that ends with a backslash goes on.
bool NextLine(std::istream& in, std::string& line) {
  line.clear();
  bool any = false;
  for (std::string piece; std::getline(in, piece);) {
    any = true;
    line += piece;
    if (line.empty() || line.back() != '\\') break;
    line.back() = ' ';
  }
  return any;
}

// The last that the file says of it, or nothing.
std::optional<nanoseconds> StopIn(const fs::path& path) {
  std::ifstream file(path);
  std::optional<nanoseconds> stop;
  bool in_service = false;
  for (std::string whole; NextLine(file, whole);) {
    const std::string_view line = Trimmed(whole);
    if (line.empty() || line.front() == '#' || line.front() == ';') continue;
    if (line.front() == '[') in_service = line == "[Service]";
    const std::size_t equals = line.find('=');
    if (!in_service || equals == std::string_view::npos) continue;
    const std::string_view key = Trimmed(line.substr(0, equals));
    if (key != "TimeoutStopSec" && key != "TimeoutSec") continue;
    auto span = TimeSpan(line.substr(equals + 1));
    if (!span) continue;                                // systemd warns, and goes on
    if (span->count() == 0) span = nanoseconds::max();  // for a stop 0 means that there is no bound
    stop = span;
  }
  return stop;
}

}  // namespace

std::vector<fs::path> UnitFiles(const UnitPlaces& places) {
  std::vector<fs::path> files;
  for (const fs::path& folder : FoldersOf(places)) {
    std::error_code error;
    // A link that leads nowhere is none, but one to /dev/null is: it masks the others.
    if (fs::exists(folder / kUnitName, error)) files.push_back(folder / kUnitName);
  }
  return files;
}

ServiceTimes TimesOfUnit(const UnitPlaces& places) {
  ServiceTimes times;
  const std::vector<fs::path> units = UnitFiles(places);
  if (units.empty()) return times;
  times.stop = kStopOfSystemd;
  times.stop_from = units.front().string();
  const auto read = [&](const fs::path& file) {
    const auto stop = StopIn(file);
    if (!stop) return;
    times.stop = *stop;
    times.stop_from = file.string();
  };
  read(units.front());
  for (const auto& [name, file] : DropIns(places)) read(file);
  return times;
}

std::optional<nanoseconds> TimeSpan(std::string_view text) {
  text = Trimmed(text);
  if (text == "infinity") return nanoseconds::max();
  if (text.empty()) return std::nullopt;
  double seconds = 0;
  while (!text.empty()) {
    double number = 0;
    const auto [end, error] =
        std::from_chars(text.data(), text.data() + text.size(), number, std::chars_format::fixed);
    if (error != std::errc() || !(number >= 0 && std::isfinite(number))) return std::nullopt;
    text = Trimmed(text.substr(static_cast<std::size_t>(end - text.data())));
    const std::string_view unit = text.substr(0, text.find_first_of("0123456789. \t"));
    const auto* known = kSeconds.begin();
    while (known != kSeconds.end() && known->first != unit) ++known;
    if (known == kSeconds.end()) return std::nullopt;
    seconds += number * known->second;
    text = Trimmed(text.substr(unit.size()));
  }
  if (seconds > kLongestSeconds) return nanoseconds::max();
  return std::chrono::duration_cast<nanoseconds>(std::chrono::duration<double>(seconds));
}

}  // namespace bendloop::host
