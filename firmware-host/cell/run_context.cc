// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cell/run_context.h"

#include <cmath>

#include "firmware-host/result/json.h"
#include "firmware-host/result/json_reader.h"
#include "firmware-host/result/sections.h"

namespace bendloop::host {
namespace {

constexpr const char* kContextSchema = "bendloop.context/1";
constexpr const char* kLotSchema = "bendloop.lot/1";
constexpr std::size_t kMostRows = 10'000;

// Unlike the result's numbers these are not rounded: a replay computes with the same bits.
Json ExactRows(const hal::BendProgram& program) {
  Json rows = Json::array();
  for (const hal::BendRow& row : program.rows) {
    rows.push_back({{"length_mm", row.length_mm},
                    {"rotation_deg", row.rotation_deg},
                    {"angle_deg", row.angle_deg},
                    {"bend_radius_mm", row.bend_radius_mm ? Json(*row.bend_radius_mm) : Json()}});
  }
  return rows;
}

hal::BendProgram ReadExactRows(const JsonReader& json) {
  hal::BendProgram program;
  for (std::size_t i = 0, n = json.Size(kMostRows); i < n; ++i) {
    const JsonReader row = json.Item(i);
    program.rows.push_back({row.At("length_mm").Number(), row.At("rotation_deg").Number(),
                            row.At("angle_deg").Number(), row.At("bend_radius_mm").NumberOrNull()});
  }
  return program;
}

// A replay needs every member: whoever adds one adds it here, to both functions below.
static_assert(sizeof(pipeline::OffsetEstimate) == 3 * sizeof(double));

Json EstimateJson(const pipeline::OffsetEstimate& estimate) {
  return {{"offset", estimate.offset},
          {"variance", estimate.variance},
          {"noise_variance", estimate.noise_variance}};
}

pipeline::OffsetEstimate ReadEstimate(const JsonReader& json) {
  return {json.At("offset").Number(), json.At("variance").Number(),
          json.At("noise_variance").Number()};
}

Json LotJson(const pipeline::LotState& lot) {
  Json rows = Json::array();
  for (const pipeline::LotRow& row : lot.rows) {
    rows.push_back({{"length_mm", EstimateJson(row.length_mm)},
                    {"rotation_deg", EstimateJson(row.rotation_deg)},
                    {"angle_deg", EstimateJson(row.angle_deg)}});
  }
  return {{"parts", lot.parts}, {"base", ExactRows(lot.base)}, {"rows", rows}};
}

pipeline::LotState ReadLotState(const JsonReader& json) {
  pipeline::LotState lot;
  lot.parts = static_cast<std::uint32_t>(json.At("parts").Count());
  lot.base = ReadExactRows(json.At("base"));
  const JsonReader rows = json.At("rows");
  for (std::size_t i = 0, n = rows.Size(kMostRows); i < n; ++i) {
    const JsonReader row = rows.Item(i);
    lot.rows.push_back({ReadEstimate(row.At("length_mm")), ReadEstimate(row.At("rotation_deg")),
                        ReadEstimate(row.At("angle_deg"))});
  }
  return lot;
}

Json BlockJson(const hal::ProgramBlock& block) {
  return {{"part_number", block.part_number},
          {"sequence", block.sequence},
          {"crc", block.crc},
          {"rows", ExactRows(block.program)}};
}

hal::ProgramBlock ReadBlock(const JsonReader& json) {
  hal::ProgramBlock block;
  block.part_number = static_cast<std::uint32_t>(json.At("part_number").Count());
  block.sequence = static_cast<std::uint32_t>(json.At("sequence").Count());
  block.crc = static_cast<std::uint32_t>(json.At("crc").Count());
  block.program = ReadExactRows(json.At("rows"));
  return block;
}

Json ChecksJson(const std::vector<pipeline::TubeCheck>& checks) {
  Json list = Json::array();
  for (const pipeline::TubeCheck& check : checks) {
    list.push_back({{"name", Word(check.kind)},
                    {"passed", check.passed},
                    {"found", check.found},
                    {"mend", check.mend}});
  }
  return list;
}

std::vector<pipeline::TubeCheck> ReadChecks(const JsonReader& json) {
  constexpr std::size_t kMostChecks = 32;
  std::vector<pipeline::TubeCheck> checks;
  for (std::size_t i = 0, n = json.Size(kMostChecks); i < n; ++i) {
    const JsonReader check = json.Item(i);
    checks.push_back({ReadWord<pipeline::InterlockKind>(check.At("name")),
                      check.At("passed").Bool(), check.At("found").Text(),
                      check.At("mend").Text()});
  }
  return checks;
}

hal::Result<Json> Parse(std::string_view text, std::string_view name) {
  Json json = Json::parse(text, nullptr, false);
  if (json.is_discarded()) {
    return hal::Fail(hal::ErrorKind::kBadInput,
                     std::string(name) + ": found text that is not JSON, expected an object");
  }
  return json;
}

void ExpectSchema(const JsonReader& json, const char* schema) {
  const JsonReader found = json.At("schema");
  if (found.Text() != schema) found.Wrong(std::string("\"") + schema + "\"");
}

}  // namespace

std::string WriteRunContext(const RunContext& context) {
  return Dump({{"schema", kContextSchema},
               {"bent_with", context.bent_with ? BlockJson(*context.bent_with) : Json()},
               {"lot", context.lot ? LotJson(*context.lot) : Json()},
               {"last_sequence", context.last_sequence},
               {"expected", context.expected ? BlockJson(*context.expected) : Json()},
               {"tube", context.tube ? Json(*context.tube) : Json()},
               {"tube_checks", ChecksJson(context.tube_checks)},
               {"repeat_of", context.repeat_of}});
}

hal::Result<RunContext> ReadRunContext(std::string_view text, std::string_view name) {
  const auto json = Parse(text, name);
  if (!json) return hal::Fail(json.error());
  std::optional<hal::Error> error;
  const JsonReader reader(*json, name, error);
  RunContext context;
  ExpectSchema(reader, kContextSchema);
  if (reader.Has("bent_with")) context.bent_with = ReadBlock(reader.At("bent_with"));
  if (reader.Has("lot")) context.lot = ReadLotState(reader.At("lot"));
  context.last_sequence = static_cast<std::uint32_t>(reader.At("last_sequence").Count());
  // Sessions of before 2026-11 say nothing of tubes.
  if (reader.Has("expected")) context.expected = ReadBlock(reader.At("expected"));
  if (reader.Has("tube")) context.tube = static_cast<std::int64_t>(reader.At("tube").Count());
  if (reader.Has("tube_checks")) context.tube_checks = ReadChecks(reader.At("tube_checks"));
  context.repeat_of = reader.TextOr("repeat_of");
  if (error) return hal::Fail(*error);
  return context;
}

std::string WriteLot(const pipeline::LotState& lot, std::string_view key) {
  return Dump({{"schema", kLotSchema}, {"key", std::string(key)}, {"lot", LotJson(lot)}}, 2) + "\n";
}

hal::Result<std::optional<pipeline::LotState>> ReadLot(std::string_view text, std::string_view name,
                                                       std::string_view key) {
  const auto json = Parse(text, name);
  if (!json) return hal::Fail(json.error());
  std::optional<hal::Error> error;
  const JsonReader reader(*json, name, error);
  ExpectSchema(reader, kLotSchema);
  const bool same_key = reader.At("key").Text() == key;
  std::optional<pipeline::LotState> lot = ReadLotState(reader.At("lot"));
  if (error) return hal::Fail(*error);
  if (!same_key) lot.reset();
  return lot;
}

}  // namespace bendloop::host
