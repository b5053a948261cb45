// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/commit/journal_json.h"

#include <cstdint>
#include <limits>
#include <nlohmann/json.hpp>
#include <utility>

namespace bendloop::host {

using nlohmann::json;

namespace {

constexpr std::size_t kColumns = 4;

// Takes a program piece by piece, for the reason of ProgramToJson. False ends the reading.
class ProgramReader final : public nlohmann::json_sax<json> {
 public:
  hal::ProgramBlock block;
  std::string problem = "a part of it is missing, or not what it should be";
  bool is_whole() const { return seen_ == kAll; }

  bool null() override { return depth_ == 3 && column_++ == kColumns - 1; }
  bool boolean(bool) override { return false; }
  bool number_integer(std::int64_t value) override { return Take(static_cast<double>(value)); }
  bool number_unsigned(std::uint64_t value) override { return Take(static_cast<double>(value)); }
  bool number_float(double value, const std::string&) override { return Take(value); }
  bool string(std::string&) override { return depth_ == 1 && !Known(); }
  bool binary(json::binary_t&) override { return false; }
  bool start_object(std::size_t) override { return ++depth_ == 1; }
  bool end_object() override { return --depth_ == 0; }
  bool key(std::string& name) override {
    key_ = name;
    return true;
  }
  bool start_array(std::size_t) override {
    if (++depth_ == 2) {
      if (key_ != "rows_lrar") return false;
      seen_ |= kRows;
      return true;
    }
    block.program.rows.emplace_back();
    column_ = 0;
    return depth_ == 3;
  }
  bool end_array() override {
    if (depth_-- == 2 || column_ == kColumns) return true;
    problem = "a row without four values";
    return false;
  }
  bool parse_error(std::size_t, const std::string&, const json::exception& error) override {
    problem = error.what();
    return false;
  }

 private:
  enum Seen : unsigned { kPart = 1, kSequence = 2, kCrc = 4, kRows = 8, kAll = 15 };

  bool Known() const {
    return key_ == "part_number" || key_ == "sequence" || key_ == "crc" || key_ == "rows_lrar";
  }
  bool Take(double value) {
    if (depth_ == 3) return TakeColumn(value);
    if (depth_ != 1 || key_ == "rows_lrar") return false;
    if (!Known()) return true;
    if (!(value >= 0 && value <= std::numeric_limits<std::uint32_t>::max())) return false;
    const auto number = static_cast<std::uint32_t>(value);
    if (key_ == "part_number") {
      block.part_number = number;
      seen_ |= kPart;
    } else if (key_ == "sequence") {
      block.sequence = number;
      seen_ |= kSequence;
    } else {
      block.crc = number;
      seen_ |= kCrc;
    }
    return true;
  }
  bool TakeColumn(double value) {
    hal::BendRow& row = block.program.rows.back();
    if (column_ == 0) row.length_mm = value;
    if (column_ == 1) row.rotation_deg = value;
    if (column_ == 2) row.angle_deg = value;
    if (column_ == kColumns - 1) row.bend_radius_mm = value;
    return ++column_ <= kColumns;
  }

  std::string key_;
  int depth_ = 0;  // 1: the program, 2: its rows, 3: a row
  std::size_t column_ = 0;
  unsigned seen_ = 0;
};

}  // namespace

// In the order of the keys' names, as the library has it. Written piece by piece: a whole value of
// the library wants memory where it is destroyed, and the process ends where there is none.
std::string ProgramToJson(const hal::ProgramBlock& block) {
  const auto number = [](auto value) { return json(value).dump(); };
  std::string rows;
  for (const hal::BendRow& row : block.program.rows) {
    rows += (rows.empty() ? "[" : ",[") + number(row.length_mm) + "," + number(row.rotation_deg) +
            "," + number(row.angle_deg) + "," +
            (row.bend_radius_mm ? number(*row.bend_radius_mm) : "null") + "]";
  }
  return "{\"crc\":" + number(block.crc) + ",\"part_number\":" + number(block.part_number) +
         ",\"rows_lrar\":[" + rows + "],\"sequence\":" + number(block.sequence) + "}";
}

hal::Result<hal::ProgramBlock> ProgramFromJson(std::string_view text) {
  ProgramReader reader;
  if (!json::sax_parse(text, &reader) || !reader.is_whole()) {
    return hal::Fail(hal::ErrorKind::kBadInput, "program in the journal: " + reader.problem);
  }
  return reader.block;
}

}  // namespace bendloop::host
