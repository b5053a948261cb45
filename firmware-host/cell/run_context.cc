// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cell/run_context.h"

#include <algorithm>
#include <cmath>

#include "firmware-host/ledger/moment.h"
#include "firmware-host/result/json.h"
#include "firmware-host/result/json_reader.h"
#include "firmware-host/result/sections.h"

namespace bendloop::host {
namespace {

constexpr const char* kContextSchema = "bendloop.context/1";
constexpr const char* kLotSchema = "bendloop.lot/2";
// Until 2026-11: one estimate for each value, which says nothing of drift; a new lot begins.
constexpr const char* kOldLotSchema = "bendloop.lot/1";
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

// A replay needs every member: whoever adds one adds it here, to both functions of its kind.
Json AxesJson(const pipeline::PerAxis& axes) {
  return {{"length_mm", axes.length_mm},
          {"rotation_deg", axes.rotation_deg},
          {"angle_deg", axes.angle_deg}};
}

pipeline::PerAxis ReadAxes(const JsonReader& json) {
  return {json.At("length_mm").Number(), json.At("rotation_deg").Number(),
          json.At("angle_deg").Number()};
}

std::vector<double> ReadNumbers(const JsonReader& json) {
  // Of the belief in a tube of 200 bends.
  constexpr std::size_t kMostNumbers = 1'000'000;
  std::vector<double> numbers;
  for (std::size_t i = 0, n = json.Size(kMostNumbers); i < n; ++i) {
    numbers.push_back(json.Item(i).Number());
  }
  return numbers;
}

Json HypothesisJson(const pipeline::LotHypothesis& hypothesis) {
  return {{"temperament", static_cast<unsigned>(hypothesis.temperament)},
          {"log_weight", hypothesis.log_weight},
          {"behind", hypothesis.behind},
          {"event", static_cast<unsigned>(hypothesis.event)},
          {"parts_since", hypothesis.parts_since},
          {"values", hypothesis.values},
          {"scatter", AxesJson(hypothesis.scatter)},
          {"scatter_weight", AxesJson(hypothesis.scatter_weight)},
          {"mean", hypothesis.mean},
          {"covariance", hypothesis.covariance}};
}

pipeline::LotHypothesis ReadHypothesis(const JsonReader& json, std::size_t values) {
  pipeline::LotHypothesis hypothesis;
  const auto temperament = json.At("temperament").Count();
  if (temperament >= pipeline::kTemperaments) json.At("temperament").Wrong("a number from 0 to 4");
  hypothesis.temperament =
      static_cast<pipeline::Temperament>(std::min<std::uint64_t>(temperament, 4));
  hypothesis.log_weight = json.At("log_weight").Number();
  hypothesis.behind = json.At("behind").Number();
  const auto event = json.At("event").Count();
  if (event > 3) json.At("event").Wrong("a number from 0 to 3");
  hypothesis.event = static_cast<pipeline::LotEvent>(std::min<std::uint64_t>(event, 3));
  hypothesis.parts_since = static_cast<std::uint32_t>(json.At("parts_since").Count());
  const JsonReader touched = json.At("values");
  for (std::size_t i = 0, n = touched.Size(kMostRows); i < n; ++i) {
    const auto value = touched.Item(i).Count();
    if (value >= values) touched.Item(i).Wrong("the number of a value of the tube");
    hypothesis.values.push_back(static_cast<std::uint32_t>(value));
  }
  hypothesis.scatter = ReadAxes(json.At("scatter"));
  hypothesis.scatter_weight = ReadAxes(json.At("scatter_weight"));
  hypothesis.mean = ReadNumbers(json.At("mean"));
  hypothesis.covariance = ReadNumbers(json.At("covariance"));
  return hypothesis;
}

Json LotJson(const pipeline::LotState& lot) {
  Json hypotheses = Json::array();
  for (const pipeline::LotHypothesis& one : lot.hypotheses) {
    hypotheses.push_back(HypothesisJson(one));
  }
  return {{"number", lot.number},
          {"parts", lot.parts},
          {"held", lot.held},
          {"slips", lot.slips},
          {"jumps", lot.jumps},
          {"parts_of_all_lots", lot.parts_of_all_lots},
          {"base", ExactRows(lot.base)},
          {"hypotheses", hypotheses}};
}

pipeline::LotState ReadLotState(const JsonReader& json) {
  pipeline::LotState lot;
  const auto count = [&](const char* key) {
    return static_cast<std::uint32_t>(json.At(key).Count());
  };
  lot.number = count("number");
  lot.parts = count("parts");
  lot.held = json.At("held").Bool();
  lot.slips = count("slips");
  lot.jumps = count("jumps");
  lot.parts_of_all_lots = count("parts_of_all_lots");
  lot.base = ReadExactRows(json.At("base"));
  const JsonReader hypotheses = json.At("hypotheses");
  for (std::size_t i = 0, n = hypotheses.Size(kMostRows); i < n; ++i) {
    lot.hypotheses.push_back(ReadHypothesis(hypotheses.Item(i), 3 * lot.base.rows.size()));
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
  // Sessions of before 2026-11-22 have an older kind of lot: their part begins one.
  if (reader.Has("lot") && reader.At("lot").Has("hypotheses")) {
    context.lot = ReadLotState(reader.At("lot"));
  }
  context.last_sequence = static_cast<std::uint32_t>(reader.At("last_sequence").Count());
  // Sessions of before 2026-11 say nothing of tubes.
  if (reader.Has("expected")) context.expected = ReadBlock(reader.At("expected"));
  if (reader.Has("tube")) context.tube = static_cast<std::int64_t>(reader.At("tube").Count());
  if (reader.Has("tube_checks")) context.tube_checks = ReadChecks(reader.At("tube_checks"));
  context.repeat_of = reader.TextOr("repeat_of");
  if (error) return hal::Fail(*error);
  return context;
}

hal::Result<void> CheckRecordedTimes(const std::map<std::string, std::string>& meta,
                                     std::string_view name) {
  for (const char* key : {kStartKey, kEndKey}) {
    const auto found = meta.find(key);
    if (found == meta.end() || found->second.empty() || ParseUtc(found->second)) continue;
    return hal::Fail(hal::ErrorKind::kBadInput,
                     std::string(name) + ": meta '" + key + "': found \"" +
                         found->second.substr(0, 40) +
                         "\", expected a time like 2026-11-21T07:32:27Z");
  }
  return {};
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
  if (reader.At("schema").Text() == kOldLotSchema) return std::optional<pipeline::LotState>();
  ExpectSchema(reader, kLotSchema);
  const bool same_key = reader.At("key").Text() == key;
  std::optional<pipeline::LotState> lot = ReadLotState(reader.At("lot"));
  if (error) return hal::Fail(*error);
  if (!same_key) lot.reset();
  return lot;
}

}  // namespace bendloop::host
