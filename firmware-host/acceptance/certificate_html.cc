// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/acceptance/certificate.h"
#include "firmware-host/report/html.h"
#include "firmware-host/text/table.h"

namespace bendloop::host {
namespace {

constexpr const char* kStyle = R"(
body { font: 15px/1.45 system-ui, "DejaVu Sans", sans-serif; color: #17202a; margin: 24px auto;
  max-width: 1000px; padding: 0 20px; }
h1 { font-size: 26px; margin: 0 0 4px; } h2 { font-size: 19px; margin: 26px 0 8px; }
table { border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums; }
th, td { text-align: left; padding: 4px 10px 4px 0; border-bottom: 1px solid #d5dce3;
  vertical-align: top; }
th { color: #5b6875; font-weight: 600; } td.n, th.n { text-align: right; }
.pass { color: #0b6b3a; font-weight: 700; } .fail { color: #b3261e; font-weight: 700; }
.none { color: #8a5a00; } .why { color: #b3261e; } small { color: #5b6875; }
.verdict { font-size: 22px; padding: 4px 0 10px; }
pre { font: 12px/1.4 "DejaVu Sans Mono", monospace; white-space: pre-wrap; margin: 4px 0; }
dl { display: grid; grid-template-columns: 130px 1fr; gap: 2px 12px; margin: 0; }
dt { color: #5b6875; } dd { margin: 0; overflow-wrap: anywhere; }
.sign { display: flex; gap: 40px; margin-top: 40px; } .sign p { border-top: 1px solid #17202a;
  flex: 1; padding-top: 4px; }
@media print { details { break-inside: avoid; } body { margin: 0; font-size: 12px; } }
)";

std::string OutcomeHtml(Outcome outcome) {
  switch (outcome) {
    case Outcome::kPassed:
      return "<span class=pass>&#10003; pass</span>";
    case Outcome::kFailed:
      return "<span class=fail>&#10007; FAIL</span>";
    case Outcome::kNotTried:
      break;
  }
  return "<span class=none>&ndash; not tried</span>";
}

std::string FramesHtml(const Acceptance& result, const RuleResult& rule) {
  if (rule.shown_by == 0) return "";
  const Exchange& exchange = result.exchanges[rule.shown_by - 1];
  std::string text = "<details><summary><small>exchange " + std::to_string(exchange.number) + ", " +
                     Escape(exchange.name) + "</small></summary><pre>";
  for (const Frame& frame : exchange.frames) {
    const double ms =
        std::chrono::duration<double, std::milli>(frame.at - exchange.frames.front().at).count();
    text += Fixed(ms, 1) + " ms  " + Escape(frame.text) + "\n";
  }
  return text + "</pre></details>";
}

std::string RulesHtml(const Acceptance& result) {
  std::string text =
      "<table><tr><th>rule<th>the PLC<th>outcome<th class=n>checks<th class=n>failed</tr>\n";
  for (std::size_t i = 0; i < kRuleCount; ++i) {
    const auto rule = static_cast<Rule>(i + 1);
    const RuleResult& of = result.rules[i];
    text += "<tr><td>" + RuleName(rule) + "<td>" + Escape(RuleText(rule));
    if (of.outcome != Outcome::kPassed && !of.detail.empty()) {
      const char* css = of.outcome == Outcome::kFailed ? "why" : "none";
      text += std::string("<br><span class=") + css + ">" + Escape(of.detail) + "</span>";
    }
    text += FramesHtml(result, of) + "<td>" + OutcomeHtml(of.outcome) + "<td class=n>" +
            std::to_string(of.tried) + "<td class=n>" + std::to_string(of.failed) + "</tr>\n";
  }
  return text + "</table>\n";
}

std::string TimingHtml(const Acceptance& result) {
  std::string text =
      "<table><tr><th>exchange<th class=n>count<th class=n>p50 ms<th class=n>p90 ms<th class=n>p99 "
      "ms<th class=n>max ms</tr>\n";
  for (const TimingSummary& kind : result.timing) {
    text += "<tr><td>" + Escape(kind.kind) + "<td class=n>" + std::to_string(kind.count);
    for (const double ms : {kind.p50_ms, kind.p90_ms, kind.p99_ms, kind.max_ms}) {
      text += "<td class=n>" + Fixed(ms, 2);
    }
    text += "</tr>\n";
  }
  return text + "</table>\n";
}

std::string ExchangesHtml(const Acceptance& result) {
  std::string text =
      "<details><summary>All " + std::to_string(result.exchanges.size()) +
      " exchanges</summary>\n<table><tr><th class=n>no.<th>exchange<th>outcome<th>rules</tr>\n";
  for (const Exchange& exchange : result.exchanges) {
    text += "<tr><td class=n>" + std::to_string(exchange.number) + "<td>" + Escape(exchange.name);
    if (!exchange.detail.empty()) text += "<br><small>" + Escape(exchange.detail) + "</small>";
    text += "<td>" + OutcomeHtml(exchange.outcome) + "<td>";
    for (const Rule rule : exchange.rules) text += RuleName(rule) + " ";
    text += "</tr>\n";
  }
  return text + "</table></details>\n";
}

std::string Term(const char* name, const std::string& text) {
  return std::string("<dt>") + name + "<dd>" + Escape(text) + "\n";
}

}  // namespace

std::string CertificateHtml(const CertificateHead& head, const Acceptance& result) {
  const std::string verdict = VerdictText(result);
  std::string page =
      "<!DOCTYPE html>\n<html lang=en><head><meta charset=utf-8>\n"
      "<meta name=viewport content=\"width=device-width\">\n<title>Acceptance " +
      Escape(head.cell) + "</title>\n<style>" + kStyle +
      "</style></head><body>\n<h1>Acceptance of the bender's PLC</h1>\n<div class=\"verdict " +
      (result.passed() ? "pass" : "fail") + "\">" + Escape(verdict) + "</div>\n<dl>\n";
  page += Term("cell", head.cell) + Term("bender", result.bender) + Term("link", head.link) +
          Term("register map", result.register_map + " (" + head.map_file + ")") +
          Term("map digest", head.map_digest) + Term("software", head.software) +
          Term("date", head.date) +
          Term("program", "part " + std::to_string(result.found.part_number) + ", sequence " +
                              std::to_string(result.found.sequence) + ", " +
                              std::to_string(result.found.program.rows.size()) + " rows" +
                              (result.restored ? "; found before and active again"
                                               : "; found before and NOT RESTORED"));
  if (!result.trouble.empty()) page += Term("trouble", result.trouble);
  page +=
      "</dl>\n<h2>Rules</h2>\n<p><small>What the PLC must do, drivers/README.md. Registers as "
      "16-bit words in hexadecimal, behind the first one's address.</small></p>\n" +
      RulesHtml(result) + "<h2>Timing</h2>\n" + TimingHtml(result) + "<h2>Exchanges</h2>\n" +
      ExchangesHtml(result) +
      "<div class=sign><p>Integrator<p>Machine's owner<p>Date</div>\n</body></html>\n";
  return page;
}

}  // namespace bendloop::host
