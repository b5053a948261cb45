// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <utility>

#include "firmware-host/acceptance/certificate.h"
#include "firmware-host/console/printable.h"
#include "firmware-host/console/wrap.h"
#include "firmware-host/text/table.h"

namespace bendloop::host {
namespace {

Style StyleOf(Outcome outcome) {
  switch (outcome) {
    case Outcome::kPassed:
      return Style::kGood;
    case Outcome::kFailed:
      return Style::kBad;
    case Outcome::kNotTried:
      break;
  }
  return Style::kWarning;
}

std::string RulesTable(const Acceptance& result, bool colour, std::size_t columns) {
  // Indent, "R18", "not tried", "checks" and the gaps between them.
  constexpr std::size_t kTaken = 2 + 4 + 2 + 9 + 2 + 6 + 2;
  constexpr std::size_t kFewest = 20;
  const std::size_t room = columns > kTaken + kFewest ? columns - kTaken : kFewest;
  Table table({{"rule", Align::kLeft},
               {"outcome", Align::kLeft},
               {"checks", Align::kRight},
               {"the PLC", Align::kLeft}});
  for (std::size_t i = 0; i < kRuleCount; ++i) {
    const auto rule = static_cast<Rule>(i + 1);
    const RuleResult& of = result.rules[i];
    Cell name = RuleName(rule);
    Cell outcome(Name(of.outcome), StyleOf(of.outcome));
    Cell checks = of.tried == 0 ? "" : std::to_string(of.tried);
    for (const std::string& line : WrapWords(RuleText(rule), room)) {
      table.Add({std::exchange(name, ""), std::exchange(outcome, ""), std::exchange(checks, ""),
                 Cell(line, Style::kFaint)});
    }
    if (of.outcome == Outcome::kPassed || of.detail.empty()) continue;
    std::string why = of.detail;
    if (of.failed > 0) why += " (" + std::to_string(of.failed) + " times)";
    if (of.failed > 0 && of.shown_by > 0) why += ", exchange " + std::to_string(of.shown_by);
    for (const std::string& line : WrapWords(Printable(why), room)) {
      table.Add({"", "", "", Cell(line, StyleOf(of.outcome))});
    }
  }
  return table.Render(colour);
}

std::string TimingTable(const Acceptance& result, bool colour) {
  Table table({{"ms", Align::kLeft},
               {"count", Align::kRight},
               {"p50", Align::kDecimal},
               {"p90", Align::kDecimal},
               {"p99", Align::kDecimal},
               {"max", Align::kDecimal}});
  for (const TimingSummary& kind : result.timing) {
    table.Add({kind.kind, std::to_string(kind.count), Fixed(kind.p50_ms, 2), Fixed(kind.p90_ms, 2),
               Fixed(kind.p99_ms, 2), Fixed(kind.max_ms, 2)});
  }
  return table.Render(colour);
}

std::string Lines(const std::string& name, const std::string& text, std::size_t columns) {
  constexpr std::size_t kNames = 12;
  std::string lines;
  std::string first = "  " + name + std::string(kNames - std::min(kNames, name.size()), ' ');
  for (const std::string& line : WrapWords(Printable(text), columns - 2 - kNames)) {
    lines += std::exchange(first, std::string(2 + kNames, ' ')) + line + "\n";
  }
  return lines;
}

}  // namespace

std::string CertificateText(const CertificateHead& head, const Acceptance& result, bool colour,
                            std::size_t columns) {
  const auto tried = static_cast<std::size_t>(
      std::count_if(result.exchanges.begin(), result.exchanges.end(),
                    [](const Exchange& e) { return e.outcome != Outcome::kNotTried; }));
  std::string text =
      "\n" + Lines("bender", result.bender, columns) +
      Lines("map", result.register_map + ", digest " + head.map_digest, columns) +
      Lines("software", head.software, columns) + Lines("date", head.date, columns) +
      Lines("exchanges",
            std::to_string(tried) + " of " + std::to_string(result.exchanges.size()) +
                " played in " + Fixed(std::chrono::duration<double>(result.took).count(), 1) + " s",
            columns) +
      Lines("program", result.restored ? "the one that was found is active again" : "NOT RESTORED",
            columns);
  if (!result.trouble.empty()) text += Lines("trouble", result.trouble, columns);
  const Style style = result.passed() ? Style::kGood : Style::kBad;
  return text + "\n" + RulesTable(result, colour, columns) + "\n" + TimingTable(result, colour) +
         "\n  " + Paint(VerdictText(result), style, colour) + "\n";
}

}  // namespace bendloop::host
