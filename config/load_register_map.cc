// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <optional>
#include <string>
#include <tuple>
#include <vector>

#include "config/fields.h"
#include "config/load.h"
#include "config/map_objects.h"
#include "config/parse_file.h"

namespace bendloop::config {
namespace {

using hal::RegisterField;
using hal::RegisterMap;
using hal::RegisterSpace;
using hal::RegisterType;

// Registers that belong to one key. 64 bits: the sizes come from a file.
struct Span {
  std::string path;
  RegisterSpace space = RegisterSpace::kHolding;
  std::int64_t begin = 0;
  std::int64_t count = 0;

  std::int64_t end() const { return begin + count; }
};

std::string Registers(const Span& span) {
  return span.count == 1 ? std::to_string(span.begin)
                         : std::to_string(span.begin) + " to " + std::to_string(span.end() - 1);
}

// Collects the spans of fields that were read well, and the checks that every field gets.
class MapChecker {
 public:
  explicit MapChecker(TomlDocument& document) : document_(document) {}

  void Add(std::string path, RegisterSpace space, std::int64_t begin, std::int64_t count) {
    if (!document_.IsGood(path)) return;
    spans_.push_back({std::move(path), space, begin, count});
    const Span& span = spans_.back();
    if (span.end() > 65536) {
      document_.Report(span.path, "found registers " + Registers(span) +
                                      ", expected none beyond 65535 (addresses are zero-based)");
    }
  }
  void Add(const std::string& path, const RegisterField& field) {
    Add(path, field.space, field.address, RegisterCount(field.type));
  }
  void Add(const std::string& path, const std::optional<RegisterField>& field) {
    if (field) Add(path, *field);
  }

  void CheckWritable(const std::string& path, RegisterSpace space) {
    if (space == RegisterSpace::kHolding || !document_.IsGood(path)) return;
    document_.Report(path + ".space",
                     "found 'input', expected 'holding': input registers cannot be written");
  }

  // A value that does not fit in its registers would be refused much later, at the first part.
  void CheckHolds(const std::string& path, const RegisterField& field, double min, double max) {
    if (!document_.IsGood(path)) return;
    if (field.scale == 0 || std::abs(field.scale) < 1e-9) {
      return document_.Report(
          path + ".scale", "found " + NumberText(field.scale) + ", expected a scale that is not 0");
    }
    if (field.type == RegisterType::kFloat32) return;
    const auto [low, high] = hal::RawRangeOf(field.type);
    const double a = low * field.scale + field.offset;
    const double b = high * field.scale + field.offset;
    if (std::min(a, b) <= min && std::max(a, b) >= max) return;
    document_.Report(path, "found a type and scale that hold " + NumberText(std::min(a, b)) +
                               " to " + NumberText(std::max(a, b)) + ", expected at least " +
                               NumberText(min) + " to " + NumberText(max));
  }

  // Reports each overlap once, at the later line, naming both.
  void CheckOverlaps() {
    std::sort(spans_.begin(), spans_.end(), [](const Span& a, const Span& b) {
      return std::tie(a.space, a.begin, a.path) < std::tie(b.space, b.begin, b.path);
    });
    for (std::size_t i = 0; i < spans_.size(); ++i) {
      for (std::size_t j = i + 1; j < spans_.size(); ++j) {
        if (spans_[j].space != spans_[i].space || spans_[j].begin >= spans_[i].end()) break;
        const bool i_is_later = document_.Line(spans_[i].path) > document_.Line(spans_[j].path);
        const Span& here = i_is_later ? spans_[i] : spans_[j];
        const Span& other = i_is_later ? spans_[j] : spans_[i];
        document_.Report(here.path, "found registers " + Registers(here) +
                                        ", expected them apart from '" + other.path +
                                        "', which has " + Registers(other) + " (" +
                                        document_.Place(other.path) + ")");
      }
    }
    spans_.clear();
  }

 private:
  TomlDocument& document_;
  std::vector<Span> spans_;
};

void AddArea(MapChecker& checker, const RegisterMap& map, const std::string& path,
             const hal::ProgramArea& area) {
  checker.Add(path + ".part_number", area.part_number);
  checker.Add(path + ".sequence", area.sequence);
  checker.Add(path + ".row_count", area.row_count);
  checker.Add(path + ".crc", area.crc);
  checker.Add(path + ".rows", area.rows_space, area.rows_address,
              std::int64_t{map.max_rows} * map.row_stride);
}

using Codes = std::vector<std::pair<std::string, std::uint32_t>>;

Codes ModeCodes(const RegisterMap& map) {
  return {{"not_ready", map.mode_not_ready},
          {"idle", map.mode_idle},
          {"bending", map.mode_bending},
          {"fault", map.mode_fault}};
}

Codes ReplyCodes(const RegisterMap& map) {
  return {{"accepted", map.reply_accepted}, {"rejected", map.reply_rejected}};
}

// `type`: what holds them; of an object it is not known here.
void CheckDistinct(TomlDocument& document, const std::string& table, const Codes& codes,
                   std::optional<RegisterType> type) {
  for (std::size_t i = 0; i < codes.size(); ++i) {
    const std::string path = table + "." + codes[i].first;
    const double most = hal::RawRangeOf(type.value_or(RegisterType::kUint32)).max;
    if (codes[i].second > most) {
      document.Report(path, "found " + std::to_string(codes[i].second) + ", expected at most " +
                                NumberText(most) + ", which the register's type holds");
    }
    for (std::size_t j = 0; j < i; ++j) {
      if (codes[i].second != codes[j].second) continue;
      document.Report(path, "found " + std::to_string(codes[i].second) +
                                ", expected another value than '" + codes[j].first + "' has (" +
                                document.Place(table + "." + codes[j].first) + ")");
    }
  }
}

// One sequence number travels through all four: they must hold the same numbers.
void CheckSequences(TomlDocument& document, const RegisterMap& map) {
  const RegisterType type = map.staging.sequence.type;
  const auto check = [&](const std::string& path, const RegisterField& field) {
    if (field.type == type || !document.IsGood(path)) return;
    document.Report(path, std::string("found another type than 'staging.sequence' has (") +
                              document.Place("staging.sequence") + "), expected the same");
  };
  check("active.sequence", map.active.sequence);
  check("commit.reply_sequence", map.reply_sequence);
  if (map.commit) check("commit.sequence", *map.commit);
  if (map.active.part_number.type != map.staging.part_number.type &&
      document.IsGood("active.part_number")) {
    document.Report("active.part_number", "found another type than 'staging.part_number' has (" +
                                              document.Place("staging.part_number") +
                                              "), expected the same");
  }
}

void CheckArea(TomlDocument& document, MapChecker& checker, const std::string& path,
               const hal::ProgramArea& area, bool is_written) {
  if (area.crc.type != RegisterType::kUint32 && document.IsGood(path + ".crc")) {
    document.Report(path + ".crc.type",
                    "found another type, expected 'uint32': the crc has 32 bits");
  }
  if (!is_written) return;
  checker.CheckWritable(path + ".part_number", area.part_number.space);
  checker.CheckWritable(path + ".sequence", area.sequence.space);
  checker.CheckWritable(path + ".row_count", area.row_count.space);
  checker.CheckWritable(path + ".crc", area.crc.space);
  checker.CheckWritable(path + ".rows", area.rows_space);
}

bool IsSamePlace(const RegisterField& a, const RegisterField& b) {
  return a.address == b.address && a.space == b.space && a.type == b.type;
}

bool IsSamePlace(const hal::ProgramArea& a, const hal::ProgramArea& b) {
  return IsSamePlace(a.part_number, b.part_number) && IsSamePlace(a.sequence, b.sequence) &&
         IsSamePlace(a.row_count, b.row_count) && IsSamePlace(a.crc, b.crc) &&
         a.rows_address == b.rows_address && a.rows_space == b.rows_space;
}

void CheckRow(TomlDocument& document, MapChecker& checker, const RegisterMap& map) {
  const auto check = [&](const std::string& key, const RegisterField& field) {
    const std::string path = "row." + key;
    if (document.IsGood(path) && field.address + RegisterCount(field.type) > map.row_stride &&
        document.IsGood("row.stride")) {
      document.Report(path, "found registers up to " +
                                std::to_string(field.address + RegisterCount(field.type) - 1) +
                                " of the row, expected less than the stride of " +
                                std::to_string(map.row_stride) + " (" +
                                document.Place("row.stride") + ")");
    }
    checker.Add(path, RegisterSpace::kHolding, field.address, RegisterCount(field.type));
  };
  check("length_mm", map.row_length_mm);
  check("rotation_deg", map.row_rotation_deg);
  check("angle_deg", map.row_angle_deg);
  if (map.row_bend_radius_mm) check("bend_radius_mm", *map.row_bend_radius_mm);
  checker.CheckOverlaps();

  checker.CheckHolds("row.length_mm", map.row_length_mm, 0, map.length_cumulative ? 6000 : 1000);
  checker.CheckHolds("row.rotation_deg", map.row_rotation_deg, map.rotation_cumulative ? 0 : -179,
                     map.rotation_cumulative ? 359 : 180);
  checker.CheckHolds("row.angle_deg", map.row_angle_deg, 0, 180);
  if (map.row_bend_radius_mm)
    checker.CheckHolds("row.bend_radius_mm", *map.row_bend_radius_mm, 0, 200);
}

// What the PLC reads must be written.
void AddPlc(MapChecker& checker, RegisterMap& map) {
  VisitPlaces(map, [&](const MapPlace& place) {
    if (!place.path.starts_with("report.") && !place.path.starts_with("orders.")) return;
    if (place.text) {
      checker.Add(place.path, place.text->space, place.text->address, place.text->registers());
    } else {
      checker.Add(place.path, *place.field);
    }
    if (place.is_written) {
      checker.CheckWritable(place.path, place.text ? place.text->space : place.field->space);
    }
  });
}

void CheckRegisterMap(TomlDocument& document, RegisterMap& map) {
  MapChecker checker(document);
  CheckOneKind(document, map);
  if (map.of_objects()) {
    CheckDistinct(document, "state.mode", ModeCodes(map), {});
    CheckDistinct(document, "commit.reply", ReplyCodes(map), {});
    CheckRow(document, checker, map);
    return CheckObjects(document, map);
  }
  CheckArea(document, checker, "active", map.active, false);
  CheckArea(document, checker, "staging", map.staging, true);
  if (map.commit) checker.CheckWritable("commit.sequence", map.commit->space);
  CheckDistinct(document, "state.mode", ModeCodes(map), map.mode.type);
  CheckDistinct(document, "commit.reply", ReplyCodes(map), map.reply.type);
  CheckSequences(document, map);
  CheckRow(document, checker, map);

  checker.Add("state.mode", map.mode);
  checker.Add("state.fault_code", map.fault_code);
  checker.Add("state.heartbeat", map.heartbeat);
  checker.Add("state.parts_bent", map.parts_bent);
  AddPlc(checker, map);
  checker.Add("commit.sequence", map.commit);
  checker.Add("commit.reply_sequence", map.reply_sequence);
  checker.Add("commit.reply", map.reply);
  checker.Add("commit.reply_code", map.reply_code);
  AddArea(checker, map, "active", map.active);
  // A controller with a single program has no commit: what is staged is what it bends.
  if (map.commit || !IsSamePlace(map.active, map.staging)) {
    AddArea(checker, map, "staging", map.staging);
  }
  checker.CheckOverlaps();
}

}  // namespace

hal::Result<RegisterMap> ParseRegisterMap(std::string_view toml, std::string_view name) {
  RegisterMap initial;
  initial.active.crc.type = RegisterType::kUint32;
  initial.staging.crc.type = RegisterType::kUint32;
  return ParseDocument(toml, name, FileKind::kRegisterMap, {}, VisitRegisterMap, CheckRegisterMap,
                       initial);
}

hal::Result<RegisterMap> LoadRegisterMap(const std::filesystem::path& file) {
  const hal::Result<std::string> text = ReadTextFile(file);
  if (!text) return hal::Fail(text.error());
  return ParseRegisterMap(*text, file.string());
}

}  // namespace bendloop::config
