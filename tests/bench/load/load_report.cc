// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/load/load_report.h"

#include <algorithm>
#include <array>
#include <limits>
#include <optional>

#include "pipeline/math/quantiles.h"

namespace bendloop::bench {
namespace {

using pipeline::Quantile;

constexpr double kPointsOfProfile = 2000;
// Upper edges of the histograms; the last takes the rest.
constexpr std::array<double, 11> kEdges = {
    1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, std::numeric_limits<double>::infinity()};

struct Latency {
  const char* name;
  std::vector<double> LoadResult::*values;
  std::optional<double> first_bar{};  // at p99
  std::optional<double> goal{};
};
const std::array<Latency, 3> kLatencies = {{
    {"profile to live LRA", &LoadResult::live_ms},
    {"last profile to LRA", &LoadResult::lra_ms, 100, 20},
    {"last profile to committed", &LoadResult::committed_ms, 250, 50},
}};

std::vector<std::string> HistogramLine(const std::string& name, const std::vector<double>& values) {
  std::vector<std::string> line = {name};
  double below = -1;  // nothing is negative but by the clock's grain
  for (const double edge : kEdges) {
    const auto count = std::count_if(values.begin(), values.end(), [&](double value) {
      return value <= edge && (value > below || below < 0);
    });
    line.push_back(count == 0 ? "." : std::to_string(count));
    below = edge;
  }
  for (const double part : {0.5, 0.99, 1.0}) line.push_back(Number(Quantile(values, part)));
  return line;
}

std::string Target(const Row& row) {
  if (!row.first_bar) return "-";
  return Number(*row.first_bar) + " / " + (row.goal ? Number(*row.goal) : "-") +
         (row.unit.empty() ? "" : " " + row.unit);
}

std::string Value(const Row& row) {
  return Number(row.value) + (row.unit.empty() ? "" : " " + row.unit);
}

}  // namespace

std::vector<Row> LoadRows(const LoadCase& load, const LoadResult& r) {
  std::vector<Row> rows;
  const auto plain = [&rows](const std::string& what, double value, const std::string& unit) {
    rows.push_back({.what = what, .value = value, .unit = unit});
  };
  rows.push_back({.what = "points a second",
                  .value = load.profiles_per_second * kPointsOfProfile,
                  .first_bar = 1.2e6,
                  .goal = 2.4e6,
                  .more_is_better = true,
                  .note = std::to_string(r.profiles) + " profiles in " + std::to_string(r.parts) +
                          " parts of " + Number(load.seconds) + " s"});
  rows.push_back({.what = "profiles lost",
                  .value = static_cast<double>(r.dropped),
                  .first_bar = 0,
                  .goal = 0});
  rows.push_back({.what = "left out of the recording",
                  .value = static_cast<double>(r.recorder_dropped),
                  .first_bar = 0,
                  .goal = 0});
  rows.push_back({.what = "parts corrected",
                  .value = static_cast<double>(r.corrected),
                  .note = std::to_string(r.refused) + " not, " + std::to_string(r.failed) +
                          " not measured" + (r.first_reason.empty() ? "" : ": " + r.first_reason)});
  plain("queue, p50", Quantile(r.queue, 0.5), "profiles");
  plain("queue, p99", Quantile(r.queue, 0.99), "profiles");
  plain("queue, max", static_cast<double>(r.queue_peak), "profiles");
  rows.back().note = "of " + std::to_string(r.queue_capacity);
  plain("processor", r.cpu_percent, "% of one");
  rows.push_back({.what = "peak memory",
                  .value = r.peak_mb,
                  .unit = "MB",
                  .first_bar = 256,
                  .goal = 128,
                  .note = "resident, libraries and the scanner's " +
                          Number(kPointsOfProfile * 251 * 2 * 8 / 1e6) + " MB of lines included"});
  plain("lateness, p99", Quantile(r.lateness_ms, 0.99), "ms");
  plain("lateness, max", r.lateness_peak_ms, "ms");
  rows.back().note = r.realtime_note;
  for (const Latency& latency : kLatencies) {
    const auto& ms = r.*latency.values;
    if (ms.empty()) continue;  // no value is no good value
    const std::string name = latency.name;
    plain(name + ", p50", Quantile(ms, 0.5), "ms");
    plain(name + ", p99", Quantile(ms, 0.99), "ms");
    rows.back().first_bar = latency.first_bar;
    rows.back().goal = latency.goal;
    rows.back().note = std::to_string(ms.size()) + " values";
    plain(name + ", max", Quantile(ms, 1.0), "ms");
    if (latency.values != &LoadResult::lra_ms) continue;
    for (const auto& [stage, times] : r.stage_ms) {
      plain("- " + stage + ", p50", Quantile(times, 0.5), "ms");
    }
  }
  return rows;
}

void PrintHistograms(std::ostream& out, const LoadResult& result) {
  std::vector<std::vector<std::string>> lines = {{"how many are at most"}};
  for (const double edge : kEdges) {
    lines[0].push_back(edge < 1e9 ? Number(edge) : "more");
  }
  for (const char* name : {"p50", "p99", "max"}) lines[0].emplace_back(name);
  for (const Latency& latency : kLatencies) {
    const auto& values = result.*latency.values;
    if (!values.empty()) {
      lines.push_back(HistogramLine(std::string(latency.name) + ", ms", values));
    }
  }
  lines.push_back(HistogramLine("lateness, ms", result.lateness_ms));
  lines.push_back(HistogramLine("queue, profiles", result.queue));
  std::vector<bool> is_number(lines[0].size(), true);
  is_number[0] = false;
  PrintMarkdown(out, "", lines, is_number);
}

void PrintSideBySide(std::ostream& out, const std::vector<LoadReport>& reports) {
  std::vector<std::vector<std::string>> lines = {{"what", "required / goal"}};
  std::vector<std::vector<Row>> columns;
  for (const auto& [load, result] : reports) {
    lines[0].push_back(load.name);
    columns.push_back(LoadRows(load, result));
  }
  // Runs may lack a latency; the run with most rows leads.
  const auto longest =
      std::max_element(columns.begin(), columns.end(),
                       [](const auto& a, const auto& b) { return a.size() < b.size(); });
  if (longest == columns.end()) return;
  for (const Row& row : *longest) {
    if (row.what.starts_with("- ")) continue;  // stages
    auto& line = lines.emplace_back(std::vector<std::string>{row.what, Target(row)});
    for (const auto& column : columns) {
      const auto same = std::find_if(column.begin(), column.end(),
                                     [&](const Row& other) { return other.what == row.what; });
      line.push_back(same == column.end() ? "-" : Value(*same));
    }
  }
  std::vector<bool> is_number(lines[0].size(), true);
  is_number[0] = is_number[1] = false;
  PrintMarkdown(out, "Side by side", lines, is_number);
}

}  // namespace bendloop::bench
