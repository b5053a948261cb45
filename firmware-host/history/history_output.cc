// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/history/history_output.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <optional>
#include <string_view>

#include "firmware-host/console/printable.h"
#include "firmware-host/result/json.h"
#include "firmware-host/text/table.h"

namespace bendloop::host {
namespace {

constexpr std::array<const char*, 3> kValues = {"length_mm", "rotation_deg", "angle_deg"};

Json ResultOf(const HistoryRow& row) {
  Json result = Json::parse(row.result, nullptr, false);
  return result.is_object() ? result : Json::object();  // a damaged row has no values
}

// "" where there is none.
std::string TextOf(const Json& object, const char* key) {
  const auto it = object.find(key);
  return it != object.end() && it->is_string() ? it->get<std::string>() : "";
}

// Of each judged number of the part; rows count from 1, as people do.
using Judged = std::function<void(std::size_t row, const char* value, const Json& judged)>;
void EachJudged(const Json& result, const Judged& judged) {
  const Json* rows = nullptr;
  if (const auto it = result.find("inspection"); it != result.end() && it->is_object()) {
    if (const auto found = it->find("rows"); found != it->end()) rows = &*found;
  }
  if (rows == nullptr || !rows->is_array()) return;
  for (std::size_t i = 0; i < rows->size(); ++i) {
    for (const char* value : kValues) {
      const Json& row = (*rows)[i];
      if (!row.is_object() || !row.contains(value) || !row[value].is_object()) continue;
      if (TextOf(row[value], "state") != "not_judged") judged(i + 1, value, row[value]);
    }
  }
}

double Number(const Json& object, const char* key) {
  const auto it = object.find(key);
  return it != object.end() && it->is_number() ? it->get<double>() : NAN;
}

// The worst deviation in percent of its tolerance; empty: nothing was judged.
std::optional<double> WorstPercent(const Json& result) {
  std::optional<double> worst;
  EachJudged(result, [&](std::size_t, const char*, const Json& judged) {
    const double tolerance = Number(judged, "tolerance");
    const double percent = 100 * std::abs(Number(judged, "deviation")) / tolerance;
    if (tolerance > 0 && std::isfinite(percent)) worst = std::max(worst.value_or(0), percent);
  });
  return worst;
}

std::string TextOr(const std::optional<std::int64_t>& number, const char* none) {
  return number ? std::to_string(*number) : none;
}

std::string Quoted(std::string_view text) {
  if (text.find_first_of(",\"\r\n") == std::string_view::npos) return std::string(text);
  std::string quoted = "\"";
  for (const char c : text) quoted += c == '"' ? "\"\"" : std::string(1, c);
  return quoted + "\"";
}

// Empty where it is not known.
std::string Written(double value) { return std::isfinite(value) ? Fixed(value, 6) : ""; }

Style StyleOf(const std::string& verdict) {
  if (verdict == "pass") return Style::kGood;
  return verdict == "fail" ? Style::kBad : Style::kPlain;
}

}  // namespace

std::string HistoryText(const std::vector<HistoryRow>& rows, bool colour) {
  Table table({{"session"},
               {"time (UTC)"},
               {"part"},
               {"lot", Align::kRight},
               {"verdict"},
               {"worst %", Align::kRight},
               {"correction"},
               {"program", Align::kRight}});
  for (const HistoryRow& row : rows) {
    const auto worst = WorstPercent(ResultOf(row));
    const std::string time = row.time.substr(0, std::min(row.time.find('.'), row.time.size()));
    table.Add({Printable(row.session), Printable(time), Printable(row.part), TextOr(row.lot, "-"),
               Cell(row.verdict.empty() ? "-" : Printable(row.verdict), StyleOf(row.verdict)),
               worst ? Fixed(*worst, 0) : "-",
               row.correction.empty() ? "-" : Printable(row.correction),
               TextOr(row.sequence, "-")});
  }
  return table.Render(colour);
}

std::string HistoryCsv(const std::vector<HistoryRow>& rows) {
  std::string csv = "session,time,part,lot,verdict,worst_percent,correction,sequence,identity\n";
  for (const HistoryRow& row : rows) {
    const Json result = ResultOf(row);
    const auto worst = WorstPercent(result);
    csv += Quoted(row.session) + "," + row.time + "," + Quoted(row.part) + "," +
           TextOr(row.lot, "") + "," + row.verdict + "," + (worst ? Fixed(*worst, 1) : "") + "," +
           row.correction + "," + TextOr(row.sequence, "") + "," +
           Quoted(TextOf(result, "identity")) + "\n";
  }
  return csv;
}

std::string HistoryValuesCsv(const std::vector<HistoryRow>& rows) {
  std::string csv =
      "session,time,part,lot,verdict,row,value,nominal,measured,deviation,sigma,tolerance,state\n";
  for (const HistoryRow& row : rows) {
    const std::string begin = Quoted(row.session) + "," + row.time + "," + Quoted(row.part) + "," +
                              TextOr(row.lot, "") + "," + row.verdict + ",";
    EachJudged(ResultOf(row), [&](std::size_t number, const char* value, const Json& judged) {
      csv += begin + std::to_string(number) + "," + value;
      for (const char* key : {"nominal", "measured", "deviation", "sigma", "tolerance"}) {
        csv += "," + Written(Number(judged, key));
      }
      csv += "," + TextOf(judged, "state") + "\n";
    });
  }
  return csv;
}

std::string HistoryJson(const std::vector<HistoryRow>& rows) {
  const auto number = [](const std::optional<std::int64_t>& value) {
    return value ? Json(*value) : Json();
  };
  const auto text = [](const std::string& value) { return value.empty() ? Json() : Json(value); };
  Json parts = Json::array();
  for (const HistoryRow& row : rows) {
    parts.push_back({{"id", row.id},
                     {"session", row.session},
                     {"time", row.time},
                     {"part", row.part},
                     {"lot", number(row.lot)},
                     {"verdict", text(row.verdict)},
                     {"correction", text(row.correction)},
                     {"sequence", number(row.sequence)},
                     {"result", ResultOf(row)}});
  }
  return Dump({{"schema", "bendloop.history/1"}, {"parts", std::move(parts)}}, 2) + "\n";
}

}  // namespace bendloop::host
