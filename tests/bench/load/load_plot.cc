// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/load/load_plot.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <utility>

#include "tests/bench/bench_table.h"

namespace bendloop::bench {
namespace {

constexpr double kWidth = 230;  // of a panel
constexpr double kHeight = 90;
constexpr double kGap = 30;
constexpr double kTitle = 30;
constexpr std::size_t kBars = 40;

std::string Text(double x, double y, const std::string& text, const char* anchor = "start") {
  char line[512];
  std::snprintf(line, sizeof line, "<text x='%.1f' y='%.1f' text-anchor='%s'>%s</text>\n", x, y,
                anchor, text.c_str());
  return line;
}

std::string Rect(double x, double y, double w, double h, const char* style) {
  char line[256];
  std::snprintf(line, sizeof line, "<rect x='%.1f' y='%.1f' width='%.1f' height='%.1f' %s/>\n", x,
                y, w, h, style);
  return line;
}

// Values over a linear axis from 0, the mark at `bar`.
std::string Histogram(double x, double y, const std::string& title,
                      const std::vector<double>& values, double bar) {
  std::string svg = Rect(x, y, kWidth, kHeight, "fill='none' stroke='#bbb'");
  svg += Text(x, y - 5, title);
  if (values.empty()) return svg + Text(x + 10, y + kHeight / 2, "no values");
  const double top = std::max(1.05 * bar, 1.02 * *std::max_element(values.begin(), values.end()));
  std::vector<double> count(kBars, 0);
  for (const double v : values) {
    const double place = std::max(0.0, v / top) * kBars;
    ++count[std::min(kBars - 1, static_cast<std::size_t>(place))];
  }
  const double most = *std::max_element(count.begin(), count.end());
  for (std::size_t i = 0; i < kBars; ++i) {
    // Roots: a single late one among thousands is what matters.
    const double h = kHeight * 0.95 * std::sqrt(count[i] / most);
    if (h > 0) {
      svg += Rect(x + kWidth * static_cast<double>(i) / kBars, y + kHeight - h, kWidth / kBars, h,
                  "fill='#3b6ea5'");
    }
  }
  if (bar > 0) svg += Rect(x + kWidth * bar / top, y, 1, kHeight, "fill='#c0392b'");
  svg += Text(x, y + kHeight + 12, "0");
  svg += Text(x + kWidth, y + kHeight + 12, Number(std::round(top)) + " ms", "end");
  return svg;
}

std::string Curve(double x, double y, const std::string& title, const std::vector<double>& values,
                  double bar, const std::string& unit) {
  std::string svg = Rect(x, y, kWidth, kHeight, "fill='none' stroke='#bbb'");
  svg += Text(x, y - 5, title);
  if (values.empty()) return svg;
  const double top = std::max(1.05 * bar, 1.05 * *std::max_element(values.begin(), values.end()));
  svg += "<polyline fill='none' stroke='#3b6ea5' points='";
  const std::size_t step = values.size() / 500 + 1;
  for (std::size_t i = 0; i < values.size(); i += step) {
    char point[64];
    std::snprintf(
        point, sizeof point, "%.1f,%.1f ",
        x + kWidth * static_cast<double>(i) / std::max(1.0, static_cast<double>(values.size() - 1)),
        y + kHeight - kHeight * values[i] / top);
    svg += point;
  }
  svg += "'/>\n";
  if (bar > 0) svg += Rect(x, y + kHeight - kHeight * bar / top, kWidth, 1, "fill='#c0392b'");
  svg += Text(x + kWidth, y + 12, Number(std::round(top)) + " " + unit, "end");
  return svg;
}

}  // namespace

std::string PlotSvg(const std::vector<PlotSeries>& series) {
  const double row = kTitle + kHeight + kGap;
  const double width = 5 * (kWidth + kGap) + kGap;
  const double height = row * static_cast<double>(series.size()) + kGap;
  std::string svg =
      "<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 " +
      std::to_string(static_cast<int>(width)) + " " + std::to_string(static_cast<int>(height)) +
      "' font-family='sans-serif' font-size='11'>\n" + Rect(0, 0, width, height, "fill='white'");
  double y = kGap + 12;
  for (const auto& [name, r] : series) {
    double x = kGap;
    svg += Text(x, y - 20, name);
    const auto next = [&x] { return std::exchange(x, x + kWidth + kGap); };
    svg += Histogram(next(), y, "profile to live LRA", r.live_ms, 0);
    svg += Histogram(next(), y, "last profile to LRA", r.lra_ms, 100);
    svg += Histogram(next(), y, "last profile to committed", r.committed_ms, 250);
    svg += Curve(next(), y, "queue over time", r.queue, 0, "profiles");
    svg += Curve(next(), y, "memory after each part", r.memory_mb, 256, "MB");
    y += row;
  }
  return svg + "</svg>\n";
}

}  // namespace bendloop::bench
