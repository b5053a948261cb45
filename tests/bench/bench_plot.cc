// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/bench_plot.h"

#include <algorithm>
#include <array>

#include "pipeline/math/quantiles.h"
#include "tests/bench/plot.h"

namespace bendloop::bench {
namespace {

using Curve = std::vector<PlotPoint>;

constexpr double kWidth = 960;
constexpr double kLeft = 70;

}  // namespace

std::string TimeSvg(const std::vector<SizedTimes>& sizes) {
  Curve ours;
  std::vector<Curve> rivals(sizes.front().rivals.size());
  double least = 10, most = 400;  // targets
  const auto add = [&](Curve& curve, std::size_t points, double ms) {
    if (ms <= 0) return;  // failed, as the table says
    curve.push_back({static_cast<double>(points), ms});
    least = std::min(least, ms);
    most = std::max(most, ms);
  };
  std::vector<LegendEntry> legend = {{"bendloop: points to LRA", colour::OfSeries(0)}};
  for (const SizedTimes& times : sizes) {
    add(ours, times.points, pipeline::Median(times.ours.cpu_ms));
    for (std::size_t i = 0; i < rivals.size(); ++i) {
      add(rivals[i], times.points, pipeline::Median(times.rivals[i].together_ms));
    }
  }
  for (std::size_t i = 0; i < rivals.size(); ++i) {
    legend.push_back(
        {sizes.front().rivals[i].name + ": normals and loose shapes", colour::OfSeries(i + 1)});
  }
  Picture picture(kWidth, 490);
  if (ours.empty()) return picture.Svg();
  const double last = ours.back().x;
  const Axis across = {"points", 4000, 1.4 * std::max(last, 1e6), true};
  const Axis up = LogAxis("processor time [ms]", 0.9 * least, 1.05 * most);
  Panel panel(picture, {kLeft, 84, kWidth - kLeft - 30, 350}, "One thread, median of the runs",
              across, up);
  for (std::size_t i = 0; i < rivals.size(); ++i) {
    panel.Line(rivals[i], colour::OfSeries(i + 1));
    panel.Dots(rivals[i], colour::OfSeries(i + 1));
  }
  // Through our last time; before it our curve lies above by the part that does not grow.
  const double per_point = ours.back().y / last;
  const double from = std::max(across.low, up.low / per_point);
  const double to = std::min(across.high, up.high / per_point);
  panel.Line(Curve{{from, from * per_point}, {to, to * per_point}}, "#888", LineStyle::kDotted);
  panel.Line(ours, colour::OfSeries(0));
  panel.Dots(ours, colour::OfSeries(0));
  for (const auto& [points, first_bar, goal] :
       {std::array{6005.0, 50.0, 10.0}, std::array{1e6, 400.0, 100.0}}) {
    panel.Target({points, first_bar}, colour::kBar);
    panel.Target({points, goal}, colour::kGoal);
  }
  double x = DrawLegend(picture, kLeft, 24, legend);
  const std::array<LegendEntry, 3> guides = {{{"linear growth", "#888", LineStyle::kDotted},
                                              {"required", colour::kBar},
                                              {"goal", colour::kGoal}}};
  const bool fits = x + 330 < kWidth;
  DrawLegend(picture, fits ? x : kLeft, fits ? 24 : 44, guides);
  return picture.Svg();
}

std::string NoiseSvg(const NoiseSweep& sweep) {
  struct Column {
    const char* title;
    Ratio LraRatios::*kind;
  };
  const std::array<Column, 3> columns = {{{"L between bends [mm]", &LraRatios::length},
                                          {"R [degree]", &LraRatios::rotation},
                                          {"A [degree]", &LraRatios::angle}}};
  Picture picture(kWidth, 360);
  for (std::size_t c = 0; c < columns.size(); ++c) {
    Curve error, bound;
    for (const NoiseSweep::Level& level : sweep.levels) {
      error.push_back({level.noise_mm, (level.error.*columns[c].kind).Rms()});
      bound.push_back({level.noise_mm, (level.bound.*columns[c].kind).Rms()});
    }
    double least = 1e9, most = 1e-9;
    for (const Curve& curve : {error, bound}) {
      for (const PlotPoint& p : curve) {
        if (p.y > 0) least = std::min(least, p.y);
        most = std::max(most, p.y);
      }
    }
    if (most < least) continue;  // no tube was right
    Panel panel(picture, {kLeft + 305 * static_cast<double>(c), 74, 240, 230}, columns[c].title,
                {"noise of the samples [mm]", 0.008, 0.15, true},
                LogAxis("", 0.8 * least, 1.25 * most));
    panel.Line(bound, colour::kInk, LineStyle::kDashed);
    panel.Line(error, colour::OfSeries(0));
    panel.Dots(error, colour::OfSeries(0));
  }
  picture.Text(kLeft, 24,
               "Rms error of " + std::to_string(sweep.compared) +
                   " tubes as in section 8 of the paper, the same at each noise",
               "start", colour::kInk, true);
  const std::array<LegendEntry, 2> legend = {
      {{"bendloop", colour::OfSeries(0)},
       {"least possible (Cramer-Rao bound)", colour::kInk, LineStyle::kDashed}}};
  DrawLegend(picture, kLeft, 46, legend);
  return picture.Svg();
}

}  // namespace bendloop::bench
