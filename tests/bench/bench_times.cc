// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/bench_times.h"

#include <algorithm>
#include <iostream>

#include "firmware-host/workers/thread_workers.h"
#include "pipeline/math/quantiles.h"
#include "pipeline/reconstruction.h"
#include "tests/bench/stopwatch.h"

namespace bendloop::bench {
namespace {

using pipeline::Median;
using pipeline::Quantile;

constexpr std::size_t kRivalRuns = 5;
constexpr double kRivalMs = 15'000;
constexpr std::size_t kGrowthFrom = 100'000;  // points: the fixed part of the time is small there

Series TimeOurs(const Case& scan, int runs, std::size_t threads) {
  Series series;
  pipeline::ReconstructionOptions options;
  host::ThreadWorkers workers(threads);
  const CpuClock clock;
  for (int i = -1; i < runs; ++i) {
    const Stopwatch watch;
    const auto measured = pipeline::Reconstruct(scan.points_W, options, clock, &workers);
    const Elapsed elapsed = watch.Read();
    if (!measured) {
      std::cerr << "bendloop_bench: " << scan.name << ", " << scan.points_W.size()
                << " points: " << measured.error().message << '\n';
      continue;
    }
    if (i < 0) continue;
    series.bends = measured->tube.program.bend_count();
    series.score = ScoreStraights(scan.truth, StraightsOf(measured->tube));
    series.wall_ms.push_back(elapsed.wall_ms);
    series.cpu_ms.push_back(elapsed.cpu_ms);
    for (const auto& stage : measured->timing) {
      auto& times = series.stage_ms[stage.stage];
      if (times.empty()) series.stages.push_back(stage.stage);
      times.push_back(stage.ms);
    }
  }
  return series;
}

RivalSeries TimeRival(const Rival& rival, const Case& scan) {
  RivalSeries series;
  series.name = rival.name;
  double spent_ms = 0;
  while (series.together_ms.size() < kRivalRuns) {
    series.last = rival.run(scan.points_W, scan.truth.pipe_radius_mm, scan.noise_mm);
    series.normals_ms.push_back(series.last.normals.cpu_ms);
    series.shapes_ms.push_back(series.last.shapes.cpu_ms);
    series.together_ms.push_back(series.normals_ms.back() + series.shapes_ms.back());
    spent_ms += series.together_ms.back();
    if (spent_ms + series.together_ms.back() > kRivalMs) break;
  }
  series.score = ScoreStraights(scan.truth, series.last.cylinders);
  return series;
}

std::string Runs(const Series& series) {
  return std::to_string(series.cpu_ms.size()) + " runs, " + std::to_string(series.bends) +
         " bends found";
}

void AddStages(std::vector<Row>& rows, const Series& series) {
  for (const std::string& stage : series.stages) {
    rows.push_back({.what = "- " + stage + ", processor",
                    .value = Median(series.stage_ms.at(stage)),
                    .unit = "ms"});
  }
}

std::string Rms(const Ratio& errors, const char* unit) {
  return errors.count == 0 ? "-" : Number(errors.Rms()) + " " + unit;
}

std::string Found(const StraightScore& score) {
  return std::to_string(score.found) + " of " + std::to_string(score.straights);
}

}  // namespace

SizedTimes TimeAll(const Case& scan, int runs, bool with_rivals, std::size_t threads) {
  SizedTimes times{scan.points_W.size(), TimeOurs(scan, runs, threads), {}};
  if (!with_rivals) return times;
  for (const Rival& rival : Rivals()) times.rivals.push_back(TimeRival(rival, scan));
  return times;
}

std::vector<Row> PaperRows(const SizedTimes& times) {
  const Series& series = times.ours;
  std::vector<Row> rows;
  rows.push_back({.what = "cloud to LRA, wall, median",
                  .value = Median(series.wall_ms),
                  .unit = "ms",
                  .first_bar = 50,
                  .goal = 10,
                  .note = Runs(series)});
  rows.push_back(
      {.what = "cloud to LRA, wall, p95", .value = Quantile(series.wall_ms, 0.95), .unit = "ms"});
  rows.push_back({.what = "cloud to LRA, processor, median",
                  .value = Median(series.cpu_ms),
                  .unit = "ms",
                  .first_bar = 50,
                  .goal = 10});
  rows.push_back({.what = "cloud to LRA, processor, p95",
                  .value = Quantile(series.cpu_ms, 0.95),
                  .unit = "ms"});
  AddStages(rows, series);
  return rows;
}

std::vector<Row> GrowthRows(const std::vector<SizedTimes>& sizes) {
  std::vector<Row> rows;
  double first_per_point = 0;
  std::string first;
  for (const SizedTimes& times : sizes) {
    const std::string points = std::to_string(times.points) + " points";
    Row total{.what = points + ", wall, median", .value = Median(times.ours.wall_ms), .unit = "ms"};
    Row busy{
        .what = points + ", processor, median", .value = Median(times.ours.cpu_ms), .unit = "ms"};
    if (times.points == 1'000'000) {
      total.first_bar = busy.first_bar = 400;
      total.goal = busy.goal = 100;
    }
    total.note = Runs(times.ours);
    rows.push_back(total);
    rows.push_back(busy);
    const double per_point = 1e6 * busy.value / static_cast<double>(times.points);
    rows.push_back({.what = points + ", processor a point", .value = per_point, .unit = "ns"});
    const bool is_last = &times == &sizes.back();
    if (first_per_point == 0 && (times.points >= kGrowthFrom || is_last)) {
      first_per_point = per_point;
      first = points;
    }
    if (!is_last) continue;
    AddStages(rows, times.ours);
    rows.push_back({.what = "growth: time a point over that of " + first,
                    .value = per_point / first_per_point,
                    .first_bar = 1.0,
                    .goal = 1.0,
                    .note = "1: linear; less: the fixed part is spread over more points"});
  }
  return rows;
}

void PrintSideBySide(std::ostream& out, const std::vector<SizedTimes>& sizes) {
  std::vector<std::vector<std::string>> lines = {{"points", "library", "normals", "shapes",
                                                  "together", "times ours", "straights", "found",
                                                  "pipe radius", "bend angle", "runs"}};
  for (const SizedTimes& times : sizes) {
    const std::string points = std::to_string(times.points);
    const double ours_ms = Median(times.ours.cpu_ms);
    lines.push_back({points, "bendloop", "-", "-", Number(ours_ms) + " ms", "1",
                     Found(times.ours.score), "LRA, " + std::to_string(times.ours.bends) + " bends",
                     Rms(times.ours.score.radius_mm, "mm"),
                     Rms(times.ours.score.angle_deg, "degree"),
                     std::to_string(times.ours.cpu_ms.size())});
    for (const RivalSeries& rival : times.rivals) {
      const double together_ms = Median(rival.together_ms);
      std::string found = std::to_string(rival.last.cylinders.size()) + " cylinders";
      if (rival.last.other_shapes > 0) {
        found += ", " + std::to_string(rival.last.other_shapes) + " tori";
      }
      lines.push_back({points, rival.name, Number(Median(rival.normals_ms)) + " ms",
                       Number(Median(rival.shapes_ms)) + " ms", Number(together_ms) + " ms",
                       Number(together_ms / ours_ms), Found(rival.score), found,
                       Rms(rival.score.radius_mm, "mm"), Rms(rival.score.angle_deg, "degree"),
                       std::to_string(rival.together_ms.size())});
    }
  }
  PrintMarkdown(out, "Beside other libraries, the same points, processor time", lines,
                {true, false, true, true, true, true, true, false, true, true, true});
  for (const RivalSeries& rival : sizes.front().rivals) {
    out << rival.name << ": " << rival.last.how << "; told the pipe radius and the noise\n\n";
  }
}

nlohmann::json ToJson(const std::vector<SizedTimes>& sizes) {
  nlohmann::json list = nlohmann::json::array();
  const auto score = [](const StraightScore& s) {
    return nlohmann::json{{"straights", s.straights},
                          {"found", s.found},
                          {"radius_error_mm", s.radius_mm.Rms()},
                          {"angle_error_deg", s.angle_deg.Rms()}};
  };
  for (const SizedTimes& times : sizes) {
    nlohmann::json rivals = nlohmann::json::array();
    for (const RivalSeries& rival : times.rivals) {
      rivals.push_back({{"name", rival.name},
                        {"how", rival.last.how},
                        {"normals_ms", rival.normals_ms},
                        {"shapes_ms", rival.shapes_ms},
                        {"cylinders", rival.last.cylinders.size()},
                        {"other_shapes", rival.last.other_shapes},
                        {"score", score(rival.score)}});
    }
    list.push_back({{"points", times.points},
                    {"wall_ms", times.ours.wall_ms},
                    {"cpu_ms", times.ours.cpu_ms},
                    {"stage_ms", times.ours.stage_ms},
                    {"score", score(times.ours.score)},
                    {"rivals", rivals}});
  }
  return list;
}

}  // namespace bendloop::bench
