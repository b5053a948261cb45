// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/acceptance/register_program.h"

#include <algorithm>
#include <cstdio>
#include <utility>

#include "drivers/register_bender/field_codec.h"
#include "drivers/register_bender/program_codec.h"

namespace bendloop::host {
namespace {

std::vector<ProgramForm::NamedField> FieldsOf(const hal::RegisterMap& map) {
  std::vector<ProgramForm::NamedField> fields{{map.row_length_mm, "length_mm"},
                                              {map.row_rotation_deg, "rotation_deg"},
                                              {map.row_angle_deg, "angle_deg"}};
  if (map.row_bend_radius_mm) fields.push_back({*map.row_bend_radius_mm, "bend_radius_mm"});
  return fields;
}

std::string Hex(std::uint32_t value) {
  char text[16];
  std::snprintf(text, sizeof text, "0x%x", value);
  return text;
}

}  // namespace

bool SameHead(const RegisterProgram& a, const RegisterProgram& b) {
  return a.part_number == b.part_number && a.sequence == b.sequence && a.row_count == b.row_count &&
         a.crc == b.crc;
}

std::string Difference(const hal::RegisterMap& map, const RegisterProgram& found,
                       const RegisterProgram& expected) {
  const std::pair<const char*, std::pair<std::uint32_t, std::uint32_t>> heads[] = {
      {"part_number", {found.part_number, expected.part_number}},
      {"sequence", {found.sequence, expected.sequence}},
      {"row_count", {found.row_count, expected.row_count}},
      {"crc", {found.crc, expected.crc}}};
  for (const auto& [name, values] : heads) {
    if (values.first == values.second) continue;
    return std::string(name) + ": holds " + Hex(values.first) + ", expected " + Hex(values.second);
  }
  if (found.words.size() != expected.words.size()) return "another number of rows";
  for (std::size_t i = 0; i < found.words.size(); ++i) {
    if (found.words[i] == expected.words[i]) continue;
    const std::size_t row = i / map.row_stride;
    const std::size_t at = i % map.row_stride;
    std::string name = "register " + std::to_string(at);
    for (const auto& field : FieldsOf(map)) {
      const std::size_t first = field.field.address;
      if (at >= first && at < first + RegisterCount(field.field.type)) name = field.name;
    }
    return "row " + std::to_string(row + 1) + " " + name + ": holds " + Hex(found.words[i]) +
           ", expected " + Hex(expected.words[i]);
  }
  return "";
}

ProgramForm::ProgramForm(const hal::RegisterMap& map) : map_(map), fields_(FieldsOf(map)) {
  used_.assign(map.row_stride, false);
  for (const NamedField& named : fields_) {
    for (int i = 0; i < RegisterCount(named.field.type); ++i) used_[named.field.address + i] = true;
  }
}

hal::Result<RegisterProgram> ProgramForm::FromBlock(const hal::ProgramBlock& block) {
  if (auto ok = drivers::EncodeProgram(map_, map_.staging, block, scratch_); !ok) {
    return hal::Fail(ok.error());
  }
  return Take(map_.staging, block.program.rows.size(), scratch_);
}

hal::Result<hal::ProgramBlock> ProgramForm::ToBlock(const RegisterProgram& program) {
  if (auto ok = Put(program, map_.staging, scratch_); !ok) return hal::Fail(ok.error());
  return drivers::DecodeProgram(map_, map_.staging, scratch_);
}

std::uint32_t ProgramForm::Crc(const RegisterProgram& program) {
  auto* to = scratch_.At(map_.staging.rows_space, map_.staging.rows_address);
  std::fill_n(to, std::size_t{map_.max_rows} * stride(), std::uint16_t{0});
  std::copy(program.words.begin(), program.words.end(), to);
  return drivers::ProgramCrc(map_, map_.staging, program.part_number, program.sequence,
                             program.row_count, scratch_);
}

hal::Result<void> ProgramForm::Put(const RegisterProgram& program, const hal::ProgramArea& area,
                                   drivers::RegisterImage& image) const {
  std::copy(program.words.begin(), program.words.end(),
            image.At(area.rows_space, area.rows_address));
  const std::pair<const hal::RegisterField*, std::pair<std::uint32_t, const char*>> heads[] = {
      {&area.part_number, {program.part_number, "part_number"}},
      {&area.sequence, {program.sequence, "sequence"}},
      {&area.row_count, {program.row_count, "row_count"}},
      {&area.crc, {program.crc, "crc"}}};
  for (const auto& [field, value] : heads) {
    if (auto ok = drivers::PutField(map_, *field, value.first, value.second, image); !ok) return ok;
  }
  return {};
}

hal::Result<RegisterProgram> ProgramForm::Take(const hal::ProgramArea& area, std::size_t rows,
                                               const drivers::RegisterImage& image) const {
  RegisterProgram program;
  const std::pair<const hal::RegisterField*, std::pair<std::uint32_t*, const char*>> heads[] = {
      {&area.part_number, {&program.part_number, "part_number"}},
      {&area.sequence, {&program.sequence, "sequence"}},
      {&area.row_count, {&program.row_count, "row_count"}},
      {&area.crc, {&program.crc, "crc"}}};
  for (const auto& [field, value] : heads) {
    const auto read = drivers::GetInteger(map_, *field, value.second, image);
    if (!read) return hal::Fail(read.error());
    *value.first = *read;
  }
  const auto* from = image.At(area.rows_space, area.rows_address);
  program.words.assign(from, from + rows * stride());
  for (std::size_t i = 0; i < program.words.size(); ++i) {
    if (!used_[i % stride()]) program.words[i] = 0;
  }
  return program;
}

void ProgramForm::SetBits(RegisterProgram& program, std::size_t row,
                          const hal::RegisterField& field, std::uint32_t bits) const {
  std::uint16_t* word = program.words.data() + row * stride() + field.address;
  const std::uint16_t low = OnWire(static_cast<std::uint16_t>(bits));
  const std::uint16_t high = OnWire(static_cast<std::uint16_t>(bits >> 16));
  if (RegisterCount(field.type) == 1) {
    word[0] = low;
    return;
  }
  word[0] = map_.high_word_first ? high : low;
  word[1] = map_.high_word_first ? low : high;
}

std::uint32_t ProgramForm::Bits(const RegisterProgram& program, std::size_t row,
                                const hal::RegisterField& field) const {
  const std::uint16_t* word = program.words.data() + row * stride() + field.address;
  if (RegisterCount(field.type) == 1) return OnWire(word[0]);
  const std::uint32_t first = OnWire(word[0]), second = OnWire(word[1]);
  return map_.high_word_first ? first << 16 | second : second << 16 | first;
}

std::uint16_t ProgramForm::OnWire(std::uint16_t word) const {
  return map_.high_byte_first ? word : static_cast<std::uint16_t>(word << 8 | word >> 8);
}

}  // namespace bendloop::host
