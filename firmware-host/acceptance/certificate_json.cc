// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/acceptance/certificate.h"
#include "firmware-host/result/program_json.h"

namespace bendloop::host {
namespace {

const char* Word(Outcome outcome) {
  switch (outcome) {
    case Outcome::kPassed:
      return "pass";
    case Outcome::kFailed:
      return "fail";
    case Outcome::kNotTried:
      break;
  }
  return "not tried";
}

double Ms(std::chrono::nanoseconds time) {
  return std::chrono::duration<double, std::milli>(time).count();
}

Json Names(const std::vector<Rule>& rules) {
  Json names = Json::array();
  for (const Rule rule : rules) names.push_back(RuleName(rule));
  return names;
}

Json RulesJson(const Acceptance& result) {
  Json rules = Json::array();
  for (std::size_t i = 0; i < kRuleCount; ++i) {
    const auto rule = static_cast<Rule>(i + 1);
    const RuleResult& of = result.rules[i];
    rules.push_back({{"rule", RuleName(rule)},
                     {"text", RuleText(rule)},
                     {"outcome", Word(of.outcome)},
                     {"checks", of.tried},
                     {"failed", of.failed},
                     {"detail", of.outcome == Outcome::kPassed ? "" : of.detail},
                     {"exchange", of.shown_by == 0 ? Json() : Json(of.shown_by)}});
  }
  return rules;
}

Json ExchangesJson(const Acceptance& result) {
  Json exchanges = Json::array();
  for (const Exchange& exchange : result.exchanges) {
    Json json = {{"number", exchange.number},         {"name", exchange.name},
                 {"outcome", Word(exchange.outcome)}, {"rules", Names(exchange.rules)},
                 {"broken", Names(exchange.broken)},  {"detail", exchange.detail}};
    for (const Frame& frame : exchange.frames) {
      json["frames"].push_back(
          {{"ms", Number(Ms(frame.at - exchange.frames.front().at), 3)}, {"frame", frame.text}});
    }
    exchanges.push_back(std::move(json));
  }
  return exchanges;
}

}  // namespace

std::string VerdictText(const Acceptance& result) {
  if (result.Count(Outcome::kFailed) > 0) {
    std::string text;
    for (std::size_t i = 0; i < kRuleCount; ++i) {
      if (result.rules[i].outcome != Outcome::kFailed) continue;
      text += (text.empty() ? "FAILED: " : ", ") + RuleName(static_cast<Rule>(i + 1));
    }
    return text;
  }
  if (!result.passed()) return "NOT FINISHED";
  const std::size_t untried = result.Count(Outcome::kNotTried);
  return untried == 0 ? "PASSED" : "PASSED, " + std::to_string(untried) + " rules not tried";
}

Json CertificateJson(const CertificateHead& head, const Acceptance& result) {
  Json timing = Json::array();
  for (const TimingSummary& kind : result.timing) {
    timing.push_back({{"kind", kind.kind},
                      {"count", kind.count},
                      {"p50_ms", Number(kind.p50_ms, 3)},
                      {"p90_ms", Number(kind.p90_ms, 3)},
                      {"p99_ms", Number(kind.p99_ms, 3)},
                      {"max_ms", Number(kind.max_ms, 3)}});
  }
  return {{"schema", "bendloop.acceptance/1"},
          {"verdict", result.Count(Outcome::kFailed) > 0 ? "fail"
                      : result.passed()                  ? "pass"
                                                         : "not finished"},
          {"date", head.date},
          {"software", head.software},
          {"cell", head.cell},
          {"bender", result.bender},
          {"link", head.link},
          {"register_map",
           {{"name", result.register_map}, {"file", head.map_file}, {"digest", head.map_digest}}},
          {"found",
           {{"part_number", result.found.part_number},
            {"sequence", result.found.sequence},
            {"crc", result.found.crc},
            {"rows", RowsJson(result.found.program)}}},
          {"restored", result.restored},
          {"trouble", result.trouble},
          {"took_s", Number(Ms(result.took) / 1000, 3)},
          {"rules", RulesJson(result)},
          {"timing", timing},
          {"exchanges", ExchangesJson(result)}};
}

}  // namespace bendloop::host
