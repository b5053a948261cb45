// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/commit/journal_json.h"

#include <nlohmann/json.hpp>

namespace bendloop::host {

using nlohmann::json;

std::string ProgramToJson(const hal::ProgramBlock& block) {
  json rows = json::array();
  for (const hal::BendRow& row : block.program.rows) {
    rows.push_back({row.length_mm, row.rotation_deg, row.angle_deg,
                    row.bend_radius_mm ? json(*row.bend_radius_mm) : json(nullptr)});
  }
  return json{{"part_number", block.part_number},
              {"sequence", block.sequence},
              {"crc", block.crc},
              {"rows_lrar", std::move(rows)}}
      .dump();
}

hal::Result<hal::ProgramBlock> ProgramFromJson(std::string_view text) {
  constexpr std::size_t kColumns = 4;
  const auto bad = [](const std::string& what) {
    return hal::Fail(hal::ErrorKind::kBadInput, "program in the journal: " + what);
  };
  try {
    const json parsed = json::parse(text);
    hal::ProgramBlock block;
    block.part_number = parsed.at("part_number").get<std::uint32_t>();
    block.sequence = parsed.at("sequence").get<std::uint32_t>();
    block.crc = parsed.at("crc").get<std::uint32_t>();
    for (const json& row : parsed.at("rows_lrar")) {
      if (row.size() != kColumns) return bad("a row without four values");
      hal::BendRow& out = block.program.rows.emplace_back();
      out.length_mm = row.at(0).get<double>();
      out.rotation_deg = row.at(1).get<double>();
      out.angle_deg = row.at(2).get<double>();
      if (!row.at(3).is_null()) out.bend_radius_mm = row.at(3).get<double>();
    }
    return block;
  } catch (const json::exception& e) {
    return bad(e.what());
  }
}

}  // namespace bendloop::host
