// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/load/load_plot.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>

#include "pipeline/math/quantiles.h"
#include "tests/bench/bench_table.h"
#include "tests/bench/load/load_soak.h"
#include "tests/bench/plot.h"

namespace bendloop::bench {
namespace {

using Values = std::vector<double>;

constexpr double kWidth = 960;
constexpr double kLeft = 62;
constexpr double kPanelWidth = 246;
constexpr double kStep = 312;  // from panel to panel
constexpr double kPanelHeight = 105;
constexpr std::size_t kMostPoints = 400;  // of one curve
constexpr int kBins = 60;

// A curve of at most kMostPoints, each the largest of its stretch: peaks are what matters.
std::vector<PlotPoint> Curve(const Values& values, double step, double offset = 0) {
  std::vector<PlotPoint> curve;
  const std::size_t stretch = values.size() / kMostPoints + 1;
  for (std::size_t i = 0; i < values.size(); i += stretch) {
    const auto end =
        values.begin() + static_cast<std::ptrdiff_t>(std::min(values.size(), i + stretch));
    const auto most = std::max_element(values.begin() + static_cast<std::ptrdiff_t>(i), end);
    curve.push_back({offset + step * static_cast<double>(i), *most});
  }
  return curve;
}

// Parts whose errors are drawn as one: scatter is of each part, drift is not.
std::size_t BlockSize(std::size_t parts) { return std::max<std::size_t>(2, 2 * (parts / 80)); }

std::vector<PlotPoint> Means(const Values& values) {
  std::vector<PlotPoint> means;
  const std::size_t block = BlockSize(values.size());
  for (std::size_t i = 0; i + block <= values.size(); i += block) {
    const auto begin = values.begin() + static_cast<std::ptrdiff_t>(i);
    const double sum = std::accumulate(begin, begin + static_cast<std::ptrdiff_t>(block), 0.0);
    means.push_back({static_cast<double>(i) + 0.5 * static_cast<double>(block),
                     sum / static_cast<double>(block)});
  }
  return means;
}

double Most(const Values& values) {
  return values.empty() ? 0.0 : *std::max_element(values.begin(), values.end());
}

double MostOfAll(const std::vector<LoadReport>& reports, Values LoadResult::*values) {
  double most = 0;
  for (const LoadReport& report : reports) most = std::max(most, Most(report.result.*values));
  return most;
}

struct LatencyColumn {
  const char* title;
  Values LoadResult::*values;
  double first_bar;  // 0: none
  double goal;
};
constexpr std::array<LatencyColumn, 3> kColumns = {{
    {"profile to live LRA", &LoadResult::live_ms, 0, 0},
    {"last profile to LRA", &LoadResult::lra_ms, 100, 20},
    {"last profile to committed", &LoadResult::committed_ms, 250, 50},
}};

void DrawLatencies(Picture& picture, double y, const std::vector<LoadReport>& reports,
                   const LoadReport& report) {
  picture.Text(kLeft, y - 27, report.load.name, "start", colour::kInk, true);
  for (std::size_t c = 0; c < kColumns.size(); ++c) {
    const LatencyColumn& column = kColumns[c];
    const Values& values = report.result.*column.values;
    std::string unit = values.empty() ? "ms; no values" : "ms";
    if (!values.empty()) {
      unit += "; p50 " + Number(std::round(pipeline::Quantile(values, 0.5))) + ", p99 " +
              Number(std::round(pipeline::Quantile(values, 0.99))) + ", max " +
              Number(std::round(Most(values)));
    }
    const Axis across =
        LinearAxis(unit, std::max(column.first_bar, MostOfAll(reports, column.values)));
    // From a half on, so that a single value among thousands has a height.
    const Axis up = {c == 0 ? "profiles" : "parts", 0.5,
                     std::max(10.0, 2.0 * static_cast<double>(values.size())), true};
    Panel panel(picture, {kLeft + kStep * static_cast<double>(c), y, kPanelWidth, kPanelHeight},
                column.title, across, up);
    panel.Histogram(values, kBins, colour::OfSeries(0));
    if (column.first_bar > 0) {
      panel.AtX(column.first_bar, colour::kBar, LineStyle::kDashed);
      panel.AtX(column.goal, colour::kGoal, LineStyle::kDashed);
    }
  }
}

void DrawOverTime(Picture& picture, double y, const std::vector<LoadReport>& reports) {
  double seconds = 0;
  for (const auto& [load, result] : reports) {
    seconds = std::max(seconds, result.sample_seconds * static_cast<double>(result.queue.size()));
  }
  struct Column {
    const char* title;
    Values LoadResult::*values;
    double first_bar, goal;
  };
  const std::array<Column, 3> columns = {{
      {"queue [profiles]", &LoadResult::queue, 0, 0},
      {"lateness of profiles [ms]", &LoadResult::lateness_ms, 0, 0},
      {"resident memory [MB]", &LoadResult::memory_mb, 256, 128},
  }};
  for (std::size_t c = 0; c < columns.size(); ++c) {
    const Column& column = columns[c];
    Panel panel(picture,
                {kLeft + kStep * static_cast<double>(c), y, kPanelWidth, 1.5 * kPanelHeight},
                column.title, LinearAxis("s of scanning", seconds / 1.08),
                LinearAxis("", std::max(column.first_bar, MostOfAll(reports, column.values))));
    for (std::size_t i = 0; i < reports.size(); ++i) {
      const LoadResult& result = reports[i].result;
      panel.Line(Curve(result.*column.values, result.sample_seconds), colour::OfSeries(i));
    }
    if (column.first_bar > 0) panel.AtY(column.first_bar, colour::kBar, LineStyle::kDashed);
    if (column.goal > 0) panel.AtY(column.goal, colour::kGoal, LineStyle::kDashed);
  }
}

const std::array<LegendEntry, 2> kTargets = {
    {{"required", colour::kBar, LineStyle::kDashed}, {"goal", colour::kGoal, LineStyle::kDashed}}};

}  // namespace

std::string LoadSvg(const std::vector<LoadReport>& reports) {
  constexpr double kRow = kPanelHeight + 85;
  const double rows = kRow * static_cast<double>(reports.size());
  const double legend = 22 * std::ceil(static_cast<double>(reports.size()) / 3);
  Picture picture(kWidth, 90 + rows + legend + 1.5 * kPanelHeight + 70);
  picture.Text(kLeft, 24, "Latencies, counted; the targets are for p99", "start", colour::kInk,
               true);
  DrawLegend(picture, kLeft + 600, 24, kTargets);
  for (std::size_t i = 0; i < reports.size(); ++i) {
    DrawLatencies(picture, 80 + kRow * static_cast<double>(i), reports, reports[i]);
  }
  double y = 60 + rows;
  for (std::size_t i = 0; i < reports.size(); ++i) {
    const std::array<LegendEntry, 1> entry = {{{reports[i].load.name, colour::OfSeries(i)}}};
    DrawLegend(picture, kLeft + kStep * static_cast<double>(i % 3),
               y + 22 * static_cast<double>(i / 3), entry);
  }
  DrawOverTime(picture, y + legend + 20, reports);
  return picture.Svg();
}

std::string SoakSvg(const LoadReport& report) {
  const LoadResult& r = report.result;
  constexpr double kHeight = 1.6 * kPanelHeight;
  constexpr double kSecondRow = 70 + kHeight + 90;
  Picture picture(kWidth, kSecondRow + kHeight + 50);
  picture.Text(kLeft, 24, report.load.name + ", " + std::to_string(r.parts) + " parts", "start",
               colour::kInk, true);
  DrawLegend(picture, kLeft + 600, 24, kTargets);
  const Axis parts = LinearAxis("parts", static_cast<double>(r.parts) / 1.08);
  const auto box = [&](int column, double y) {
    return Panel::Box{kLeft + kStep * column, y, kPanelWidth, kHeight};
  };
  const auto over_parts = [&](int column, const char* title, const Values& values, double first_bar,
                              double goal) {
    Panel panel(picture, box(column, 70), title, parts,
                LinearAxis("", std::max(first_bar, Most(values))));
    panel.Line(Curve(values, 1, 1), colour::OfSeries(0));
    panel.AtY(first_bar, colour::kBar, LineStyle::kDashed);
    panel.AtY(goal, colour::kGoal, LineStyle::kDashed);
  };
  over_parts(0, "memory after the part [MB]", r.part_memory_mb, 256, 128);
  over_parts(1, "last profile to LRA [ms]", r.lra_ms, 100, 20);
  over_parts(2, "last profile to committed [ms]", r.committed_ms, 250, 50);

  // The ends, known to the distance of the laser lines only, stand in the table.
  std::vector<Values> interior = r.length_error_mm;
  if (!interior.empty()) {
    interior.front().clear();
    interior.back().clear();
  }
  const auto errors = [&](int column, const char* title, const std::vector<Values>& of_rows) {
    std::vector<std::vector<PlotPoint>> curves;
    double most = 0;
    for (const Values& values : of_rows) {
      curves.push_back(Means(values));
      for (const PlotPoint& p : curves.back()) most = std::max(most, std::abs(p.y));
    }
    const double reach = most > 0 ? 1.3 * most : 1;
    Panel panel(picture, box(column, kSecondRow), title, parts, {"", -reach, reach, false});
    panel.AtY(0, "#999");
    for (std::size_t row = 0; row < curves.size(); ++row) {
      panel.Line(curves[row], colour::OfSeries(row));
    }
  };
  errors(0, "error of L between bends [mm]", interior);
  errors(1, "error of R [degree]", r.rotation_error_deg);
  errors(2, "error of A [degree]", r.angle_error_deg);
  std::vector<LegendEntry> rows;
  for (std::size_t i = 0; i + 1 < r.length_error_mm.size(); ++i) {
    rows.push_back({"row " + std::to_string(i + 1), colour::OfSeries(i)});
  }
  const double x = DrawLegend(picture, kLeft, kSecondRow - 32, rows);
  picture.Text(x, kSecondRow - 32,
               "measured less true, means of " + std::to_string(BlockSize(r.parts)) + " parts");
  return picture.Svg();
}

}  // namespace bendloop::bench
