// SPDX-License-Identifier: Apache-2.0
#include "drivers/register_bender/program_codec.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include "drivers/register_bender/field_codec.h"

namespace bendloop::drivers {
namespace {

using hal::ErrorKind;
using hal::RegisterField;
using hal::RegisterMap;

constexpr double kTurnDeg = 360;
// Sums of rotations are rounded to this before they meet the carrier's resolution, so that the
// rounding noise of a sum never shows in the registers.
constexpr double kRotationGridDeg = 1e-9;

std::vector<RegisterField> RowFields(const RegisterMap& map) {
  std::vector<RegisterField> fields{map.row_length_mm, map.row_rotation_deg, map.row_angle_deg};
  if (map.row_bend_radius_mm) fields.push_back(*map.row_bend_radius_mm);
  return fields;
}

RegisterField AtRow(const RegisterMap& map, const hal::ProgramArea& area, RegisterField field,
                    std::size_t row) {
  field.address =
      static_cast<std::uint16_t>(area.rows_address + row * map.row_stride + field.address);
  field.space = area.rows_space;
  field.object = area.rows_object;
  return field;
}

std::string RowName(std::size_t row, const char* value) {
  return "row " + std::to_string(row + 1) + " " + value;
}

hal::Result<void> BadMap(const RegisterMap& map, const std::string& what) {
  return hal::Fail(ErrorKind::kBadInput, "register map \"" + map.name + "\": " + what);
}

hal::Result<void> CheckField(const RegisterMap& map, const RegisterField& field,
                             const std::string& name) {
  if (!std::isfinite(field.scale) || field.scale == 0 || !std::isfinite(field.offset)) {
    return BadMap(map, name + " has scale " + std::to_string(field.scale) +
                           "; a finite scale other than 0 was expected");
  }
  if (field.address + RegisterCount(field.type) > static_cast<int>(kAddressSpaceSize)) {
    return BadMap(map, name + " at register " + std::to_string(field.address) +
                           " reaches beyond register 65535");
  }
  return {};
}

hal::Result<void> CheckArea(const RegisterMap& map, const hal::ProgramArea& area,
                            const std::string& name) {
  const std::pair<const RegisterField*, const char*> heads[] = {{&area.part_number, "part_number"},
                                                                {&area.sequence, "sequence"},
                                                                {&area.row_count, "row_count"},
                                                                {&area.crc, "crc"}};
  for (const auto& [field, field_name] : heads) {
    if (auto ok = CheckField(map, *field, name + "." + field_name); !ok) return ok;
  }
  if (area.crc.type != hal::RegisterType::kUint32 || area.crc.scale != 1 || area.crc.offset != 0) {
    return BadMap(map, name + ".crc must be a uint32 with scale 1 and offset 0");
  }
  const std::size_t end = area.rows_address + std::size_t{map.max_rows} * map.row_stride;
  if (end > kAddressSpaceSize) {
    return BadMap(map, name + " rows end at register " + std::to_string(end - 1) +
                           ", beyond register 65535; fewer max_rows or a lower rows_address");
  }
  return {};
}

// What the controller wants to see as rotation of each row.
std::vector<double> RotationsOut(const RegisterMap& map, const hal::BendProgram& program) {
  std::vector<double> rotations;
  double sum = 0;
  for (const hal::BendRow& row : program.rows) {
    double rotation = hal::WrapRotationDeg(row.rotation_deg);
    if (map.rotation_sign_reversed) rotation = -rotation;
    if (map.rotation_cumulative) {
      sum += rotation;
      rotation = std::round(sum / kRotationGridDeg) * kRotationGridDeg;
      rotation -= kTurnDeg * std::floor(rotation / kTurnDeg);
      if (rotation >= kTurnDeg) rotation = 0;
    }
    rotations.push_back(rotation);
  }
  return rotations;
}

hal::Result<void> PutRotation(const RegisterMap& map, const RegisterField& field, double rotation,
                              const std::string& name, RegisterImage& image) {
  if (auto ok = PutField(map, field, rotation, name, image); !ok) return ok;
  if (!map.rotation_cumulative) return {};
  // 359.996 at a resolution of 0.01 has become 360.00: a full turn is 0.
  const auto rounded = GetField(map, field, name, image);
  if (rounded && *rounded >= kTurnDeg) return PutField(map, field, 0, name, image);
  return {};
}

// Row i as the controller wants to see it.
hal::Result<void> PutRow(const RegisterMap& map, const hal::ProgramArea& area, std::size_t i,
                         const hal::BendRow& row, RegisterImage& image) {
  auto ok = PutField(map, AtRow(map, area, map.row_length_mm, i), row.length_mm,
                     RowName(i, "length_mm"), image);
  if (ok) {
    ok = PutRotation(map, AtRow(map, area, map.row_rotation_deg, i), row.rotation_deg,
                     RowName(i, "rotation_deg"), image);
  }
  if (ok) {
    ok = PutField(map, AtRow(map, area, map.row_angle_deg, i), row.angle_deg,
                  RowName(i, "angle_deg"), image);
  }
  if (!ok || !map.row_bend_radius_mm) return ok;
  const RegisterField radius = AtRow(map, area, *map.row_bend_radius_mm, i);
  const std::string name = RowName(i, "bend_radius_mm");
  ok = PutField(map, radius, row.bend_radius_mm.value_or(0), name, image);
  if (!ok) return ok;
  if (row.bend_radius_mm && !(GetField(map, radius, name, image).value_or(0) > 0)) {
    return hal::Fail(ErrorKind::kBadInput,
                     name + ": " + std::to_string(*row.bend_radius_mm) +
                         " is 0 or less at the bender's resolution; a radius above 0 was "
                         "expected");
  }
  return {};
}

// After the rows, of which the crc is.
hal::Result<void> PutHead(const RegisterMap& map, const hal::ProgramArea& area,
                          const hal::ProgramBlock& block, RegisterImage& image) {
  const auto count = static_cast<std::uint32_t>(block.program.rows.size());
  const std::pair<const RegisterField*, std::pair<std::uint32_t, const char*>> heads[] = {
      {&area.part_number, {block.part_number, "part_number"}},
      {&area.sequence, {block.sequence, "sequence"}},
      {&area.row_count, {count, "row_count"}},
      {&area.crc, {ProgramCrc(map, area, block.part_number, block.sequence, count, image), "crc"}}};
  for (const auto& [field, value] : heads) {
    if (auto ok = PutField(map, *field, value.first, value.second, image); !ok) return ok;
    const auto back = GetInteger(map, *field, value.second, image);
    if (!back || *back != value.first) {
      return hal::Fail(ErrorKind::kBadInput, std::string(value.second) + ": " +
                                                 std::to_string(value.first) + " loses digits in " +
                                                 PlaceOf(*field));
    }
  }
  return {};
}

void CrcByte(std::uint32_t& crc, std::uint8_t byte) {
  constexpr std::uint32_t kReversedPolynomial = 0xEDB88320u;
  crc ^= byte;
  for (int bit = 0; bit < 8; ++bit) crc = crc >> 1 ^ (crc & 1 ? kReversedPolynomial : 0);
}

}  // namespace

hal::Result<void> CheckRegisterMap(const RegisterMap& map) {
  constexpr int kMaxRead = 125;  // the Modbus specification's limits
  constexpr int kMaxWrite = 123;
  if (map.max_rows < 2) return BadMap(map, "max_rows must be at least 2: one bend and the end");
  if (map.max_read_registers < 1 || map.max_read_registers > kMaxRead) {
    return BadMap(map, "max_read_registers must be 1 to 125");
  }
  if (map.max_write_registers < 1 || map.max_write_registers > kMaxWrite) {
    return BadMap(map, "max_write_registers must be 1 to 123");
  }
  for (const RegisterField& field : RowFields(map)) {
    if (auto ok = CheckField(map, field, "a row value"); !ok) return ok;
    if (field.address + RegisterCount(field.type) > map.row_stride) {
      return BadMap(map, "a row value at row register " + std::to_string(field.address) +
                             " reaches beyond row_stride " + std::to_string(map.row_stride));
    }
  }
  if (map.commit && RegisterCount(map.commit->type) > map.max_write_registers) {
    return BadMap(map, "the commit register does not fit one write of max_write_registers");
  }
  std::vector<std::pair<RegisterField, const char*>> fields{
      {map.mode, "mode"}, {map.reply_sequence, "reply_sequence"}, {map.reply, "reply"}};
  if (map.fault_code) fields.emplace_back(*map.fault_code, "fault_code");
  if (map.heartbeat) fields.emplace_back(*map.heartbeat, "heartbeat");
  if (map.parts_bent) fields.emplace_back(*map.parts_bent, "parts_bent");
  if (map.commit) fields.emplace_back(*map.commit, "commit");
  if (map.reply_code) fields.emplace_back(*map.reply_code, "reply_code");
  for (const auto& [field, name] : fields) {
    if (auto ok = CheckField(map, field, name); !ok) return ok;
  }
  if (auto ok = CheckArea(map, map.active, "active"); !ok) return ok;
  if (auto ok = CheckArea(map, map.staging, "staging"); !ok) return ok;
  const hal::ProgramArea& staging = map.staging;
  for (hal::RegisterSpace space : {staging.part_number.space, staging.sequence.space,
                                   staging.row_count.space, staging.crc.space, staging.rows_space,
                                   map.commit ? map.commit->space : staging.crc.space}) {
    if (space == hal::RegisterSpace::kInput) {
      return BadMap(map, "staging and commit must be holding registers: inputs cannot be written");
    }
  }
  return {};
}

RegisterRange RowsRange(const RegisterMap& map, const hal::ProgramArea& area, std::size_t rows) {
  return {area.rows_space, area.rows_address, static_cast<std::uint32_t>(rows * map.row_stride)};
}

std::vector<RegisterRange> HeadRanges(const hal::ProgramArea& area) {
  return {RangeOf(area.part_number), RangeOf(area.sequence), RangeOf(area.row_count),
          RangeOf(area.crc)};
}

hal::Result<void> EncodeProgram(const RegisterMap& map, const hal::ProgramArea& area,
                                const hal::ProgramBlock& block, RegisterImage& image) {
  const std::vector<hal::BendRow>& rows = block.program.rows;
  if (rows.empty() || rows.size() > map.max_rows) {
    return hal::Fail(ErrorKind::kBadInput,
                     "program of " + std::to_string(rows.size()) + " rows: the bender takes 1 to " +
                         std::to_string(map.max_rows) + " rows (register map \"" + map.name +
                         "\", max_rows)");
  }
  const RegisterRange all = RowsRange(map, area, rows.size());
  std::fill_n(image.At(all.space, area.rows_address), all.count, std::uint16_t{0});

  const std::vector<double> rotations = RotationsOut(map, block.program);
  double feed_mm = 0;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    feed_mm = map.length_cumulative ? feed_mm + rows[i].length_mm : rows[i].length_mm;
    hal::BendRow out = rows[i];
    out.length_mm = feed_mm;
    out.rotation_deg = rotations[i];
    if (auto ok = PutRow(map, area, i, out, image); !ok) return ok;
  }
  return PutHead(map, area, block, image);
}

hal::Result<hal::ProgramBlock> DecodeProgram(const RegisterMap& map, const hal::ProgramArea& area,
                                             const RegisterImage& image) {
  hal::ProgramBlock block;
  std::uint32_t count = 0;
  const std::pair<const RegisterField*, std::pair<std::uint32_t*, const char*>> heads[] = {
      {&area.part_number, {&block.part_number, "part_number"}},
      {&area.sequence, {&block.sequence, "sequence"}},
      {&area.row_count, {&count, "row_count"}},
      {&area.crc, {&block.crc, "crc"}}};
  for (const auto& [field, value] : heads) {
    const auto read = GetInteger(map, *field, value.second, image);
    if (!read) return hal::Fail(read.error());
    *value.first = *read;
  }
  if (count > map.max_rows) {
    return hal::Fail(ErrorKind::kDevice, "row_count: " + PlaceOf(area.row_count) + " says " +
                                             std::to_string(count) + " rows; at most " +
                                             std::to_string(map.max_rows) + " were expected");
  }
  double last_rotation = 0;
  double last_feed_mm = 0;
  for (std::size_t i = 0; i < count; ++i) {
    hal::BendRow row;
    const auto length =
        GetField(map, AtRow(map, area, map.row_length_mm, i), RowName(i, "length_mm"), image);
    const auto rotation =
        GetField(map, AtRow(map, area, map.row_rotation_deg, i), RowName(i, "rotation_deg"), image);
    const auto angle =
        GetField(map, AtRow(map, area, map.row_angle_deg, i), RowName(i, "angle_deg"), image);
    for (const auto* value : {&length, &rotation, &angle}) {
      if (!*value) return hal::Fail(value->error());
    }
    row.length_mm = map.length_cumulative ? *length - last_feed_mm : *length;
    last_feed_mm = *length;
    const double turn = map.rotation_cumulative ? *rotation - last_rotation : *rotation;
    last_rotation = *rotation;
    row.rotation_deg = hal::WrapRotationDeg(map.rotation_sign_reversed ? 0.0 - turn : turn);
    row.angle_deg = *angle;
    if (map.row_bend_radius_mm) {
      const auto radius = GetField(map, AtRow(map, area, *map.row_bend_radius_mm, i),
                                   RowName(i, "bend_radius_mm"), image);
      if (!radius) return hal::Fail(radius.error());
      if (*radius != 0) row.bend_radius_mm = *radius;
    }
    block.program.rows.push_back(row);
  }
  return block;
}

std::uint32_t ProgramCrc(const RegisterMap& map, const hal::ProgramArea& area,
                         std::uint32_t part_number, std::uint32_t sequence, std::uint32_t row_count,
                         const RegisterImage& image) {
  std::uint32_t crc = 0xFFFFFFFFu;
  for (std::uint32_t head : {part_number, sequence, row_count}) {
    for (int shift : {24, 16, 8, 0}) CrcByte(crc, static_cast<std::uint8_t>(head >> shift));
  }
  std::vector<bool> used(map.row_stride, false);
  for (const RegisterField& field : RowFields(map)) {
    for (int i = 0; i < RegisterCount(field.type); ++i) used[field.address + i] = true;
  }
  const std::uint16_t* word = image.At(area.rows_space, area.rows_address);
  const std::uint32_t rows = std::min<std::uint32_t>(row_count, map.max_rows);
  for (std::uint32_t row = 0; row < rows; ++row) {
    for (std::uint16_t i = 0; i < map.row_stride; ++i, ++word) {
      const std::uint16_t value = used[i] ? *word : 0;
      CrcByte(crc, static_cast<std::uint8_t>(value >> 8));
      CrcByte(crc, static_cast<std::uint8_t>(value));
    }
  }
  return ~crc;
}

std::vector<RegisterRange> PlanRequests(std::vector<RegisterRange> ranges,
                                        std::uint16_t max_count) {
  std::sort(ranges.begin(), ranges.end(), [](const RegisterRange& a, const RegisterRange& b) {
    return std::pair(a.space, a.address) < std::pair(b.space, b.address);
  });
  std::vector<RegisterRange> joined;
  for (const RegisterRange& range : ranges) {
    if (range.count == 0) continue;
    if (!joined.empty() && joined.back().space == range.space &&
        range.address <= joined.back().address + joined.back().count) {
      RegisterRange& last = joined.back();
      last.count = std::max(last.count, range.address + range.count - last.address);
    } else {
      joined.push_back(range);
    }
  }
  std::vector<RegisterRange> requests;
  for (RegisterRange range : joined) {
    while (range.count > 0) {
      const std::uint32_t count = std::min<std::uint32_t>(range.count, max_count);
      requests.push_back({range.space, range.address, count});
      range.address += count;
      range.count -= count;
    }
  }
  return requests;
}

}  // namespace bendloop::drivers
