// SPDX-License-Identifier: Apache-2.0
// Times and errors of the reconstruction as a whole, beside their targets: a Markdown table.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <fstream>
#include <iostream>
#include <map>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include "pipeline/reconstruction.h"
#include "pipeline/statistics.h"
#include "tests/bench/bench_cases.h"
#include "tests/bench/bench_table.h"
#include "tests/bench/comparison.h"
#include "tests/bench/cramer_rao.h"
#include "tests/bench/rivals.h"
#include "tests/bench/stopwatch.h"

namespace bendloop::bench {
namespace {

struct Options {
  bool quick = false;
  bool only_tubes = false;
  bool only_times = false;
  bool no_rivals = false;
  std::uint64_t sets = 1;
  std::string json_path;
};

std::string FirstLine(const char* path) {
  std::ifstream file(path);
  std::string line;
  std::getline(file, line);
  return line.empty() ? "unknown" : line;
}

std::string Processor() {
  std::ifstream file("/proc/cpuinfo");
  for (std::string line; std::getline(file, line);) {
    if (line.rfind("model name", 0) == 0) return line.substr(line.find(':') + 2);
  }
  return "unknown";
}

struct Series {
  std::vector<double> wall_ms, cpu_ms;
  std::vector<std::string> stages;  // in their order
  std::map<std::string, std::vector<double>> stage_ms;
  std::size_t bends = 0;
};

// From points in memory to LRA, `runs` times, after one that warms up.
Series Time(const Case& scan, int runs) {
  Series series;
  const CpuClock clock;
  for (int i = -1; i < runs; ++i) {
    const Stopwatch watch;
    const auto measured = pipeline::Reconstruct(scan.points_W, {}, clock);
    const Elapsed elapsed = watch.Read();
    if (!measured) {
      std::cerr << "bendloop_bench: " << scan.name << ", " << scan.points_W.size()
                << " points: " << measured.error().message << '\n';
      continue;
    }
    if (i < 0) continue;
    series.bends = measured->tube.program.bend_count();
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

std::string Bends(const Series& series) { return std::to_string(series.bends) + " bends found"; }

std::vector<Rival> Rivals(const Case& scan, const Options& options) {
  if (options.no_rivals) return {};
  return RunRivals(scan.points_W, scan.truth.pipe_radius_mm, scan.noise_mm);
}

std::vector<Row> PaperRows(int runs, const Options& options) {
  using pipeline::Median, pipeline::Quantile;
  const Case scan = PaperCase(6005, 1);
  const Series series = Time(scan, runs);
  std::vector<Row> rows;
  rows.push_back({.what = "cloud to LRA, wall, median",
                  .value = Median(series.wall_ms),
                  .unit = "ms",
                  .first_bar = 50,
                  .goal = 10,
                  .note = std::to_string(runs) + " runs, " + Bends(series)});
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
  for (const std::string& stage : series.stages) {
    rows.push_back({.what = "- " + stage + ", processor",
                    .value = Median(series.stage_ms.at(stage)),
                    .unit = "ms"});
  }
  for (const Rival& rival : Rivals(scan, options)) {
    rows.push_back(
        {.what = rival.name + ": normals, processor", .value = rival.normals.cpu_ms, .unit = "ms"});
    rows.push_back({.what = rival.name + ": shapes, processor",
                    .value = rival.shapes.cpu_ms,
                    .unit = "ms",
                    .note = rival.found});
  }
  return rows;
}

std::vector<Row> GrowthRows(const std::vector<std::size_t>& sizes, int runs,
                            const Options& options) {
  using pipeline::Median;
  std::vector<Row> rows;
  double first_per_point = 0;
  for (const std::size_t size : sizes) {
    const Case scan = PaperCase(size, 2);
    const Series series = Time(scan, runs);
    const double wall = Median(series.wall_ms);
    const double cpu = Median(series.cpu_ms);
    const std::string points = std::to_string(size) + " points";
    Row total{.what = points + ", wall, median", .value = wall, .unit = "ms"};
    Row busy{.what = points + ", processor, median", .value = cpu, .unit = "ms"};
    if (size == 1'000'000) {
      total.first_bar = busy.first_bar = 400;
      total.goal = busy.goal = 100;
    }
    total.note = std::to_string(runs) + " runs, " + Bends(series);
    rows.push_back(total);
    rows.push_back(busy);
    const double per_point = 1e6 * cpu / static_cast<double>(size);
    if (first_per_point == 0) first_per_point = per_point;
    rows.push_back({.what = points + ", processor a point", .value = per_point, .unit = "ns"});
    if (size != sizes.back()) continue;
    for (const std::string& stage : series.stages) {
      rows.push_back({.what = "- " + stage + ", processor",
                      .value = Median(series.stage_ms.at(stage)),
                      .unit = "ms"});
    }
    rows.push_back({.what = "growth: time a point, last over first",
                    .value = per_point / first_per_point,
                    .first_bar = 1.0,
                    .goal = 1.0,
                    .note = "1: linear; less: the fixed part is spread over more points"});
    for (const Rival& rival : Rivals(scan, options)) {
      rows.push_back({.what = rival.name + ": normals, processor",
                      .value = rival.normals.cpu_ms,
                      .unit = "ms"});
      rows.push_back({.what = rival.name + ": shapes, processor",
                      .value = rival.shapes.cpu_ms,
                      .unit = "ms",
                      .note = rival.found});
    }
  }
  return rows;
}

struct TubeResults {
  int tubes = 0;
  int right = 0;
  LraRatios over_sigma, over_bound, plain;
  Ratio ends;
  std::vector<double> ends_over_spacing;
  std::vector<double> distance_over_noise;
  std::vector<double> cpu_ms;
  std::vector<std::string> wrong;
  nlohmann::json list = nlohmann::json::array();
};

void RunTube(const Case& scan, TubeResults& results) {
  const CpuClock clock;
  const Stopwatch watch;
  const auto measured = pipeline::Reconstruct(scan.points_W, {}, clock);
  const double cpu_ms = watch.Read().cpu_ms;
  results.cpu_ms.push_back(cpu_ms);
  ++results.tubes;
  const std::size_t truth = scan.truth.program.bend_count();
  nlohmann::json entry = {{"name", scan.name},
                          {"seed", scan.seed},
                          {"points", scan.points_W.size()},
                          {"bends", truth},
                          {"cpu_ms", cpu_ms}};
  std::string wrong;
  if (!measured) {
    entry["error"] = measured.error().message;
    wrong = measured.error().message;
  } else {
    const std::size_t found = measured->tube.program.bend_count();
    entry["found"] = found;
    const double ratio = measured->fit.median_abs_distance_mm / (0.67449 * scan.noise_mm);
    entry["distance_over_noise"] = ratio;
    results.distance_over_noise.push_back(ratio);
    const Comparison comparison =
        Compare(scan.truth, *measured, CramerRaoBound(scan.truth, scan.points_W, scan.noise_mm),
                scan.spacing_mm);
    if (comparison.bends_right) {
      ++results.right;
      results.over_sigma.Add(comparison.over_sigma);
      results.over_bound.Add(comparison.over_bound);
      results.plain.Add(comparison.plain);
      results.ends.Add(comparison.ends_over_spacing);
      results.ends_over_spacing.push_back(comparison.ends_over_spacing.Rms());
      entry["angle_over_bound"] = comparison.over_bound.angle.Rms();
      entry["angle_over_sigma"] = comparison.over_sigma.angle.Rms();
      entry["length_over_bound"] = comparison.over_bound.length.Rms();
      entry["rotation_over_bound"] = comparison.over_bound.rotation.Rms();
      entry["ends_over_spacing"] = comparison.ends_over_spacing.Rms();
    } else {
      wrong = "found " + std::to_string(found) + " of " + std::to_string(truth) + " bends";
    }
  }
  if (!wrong.empty()) {
    results.wrong.push_back("seed " + std::to_string(scan.seed) + ", " + scan.name + ": " + wrong);
  }
  results.list.push_back(std::move(entry));
}

std::vector<Row> TubeRows(const TubeResults& results) {
  const auto sigma_row = [](const char* what, const Ratio& ratio) {
    return Row{.what = what,
               .value = ratio.Rms(),
               .goal = 1.05,
               .goal_at_least = 0.95,
               .note = std::to_string(ratio.count) + " values"};
  };
  const auto bound_row = [](const char* what, const Ratio& ratio) {
    return Row{.what = what, .value = ratio.Rms(), .first_bar = 1.5, .goal = 1.05};
  };
  const auto plain_row = [](const char* what, const Ratio& ratio, const char* unit) {
    return Row{.what = what, .value = ratio.Rms(), .unit = unit};
  };
  const auto all = static_cast<double>(results.tubes);
  return {
      {.what = "tubes with the right number of bends",
       .value = static_cast<double>(results.right),
       .unit = "of " + std::to_string(results.tubes),
       .first_bar = all,
       .goal = all,
       .more_is_better = true},
      {.what = "median sample distance over noise put in",
       .value = pipeline::Median(results.distance_over_noise),
       .first_bar = 1.1,
       .goal = 1.02,
       .note = "median of all tubes"},
      {.what = "the same, worst tube",
       .value = pipeline::Quantile(results.distance_over_noise, 1.0),
       .first_bar = 1.1,
       .goal = 1.02},
      plain_row("error of L, rms", results.plain.length, "mm"),
      plain_row("error of R, rms", results.plain.rotation, "degree"),
      plain_row("error of A, rms", results.plain.angle, "degree"),
      bound_row("error of L over Cramer-Rao bound, rms", results.over_bound.length),
      bound_row("error of R over Cramer-Rao bound, rms", results.over_bound.rotation),
      bound_row("error of A over Cramer-Rao bound, rms", results.over_bound.angle),
      sigma_row("error of L over reported sigma, rms", results.over_sigma.length),
      sigma_row("error of R over reported sigma, rms", results.over_sigma.rotation),
      sigma_row("error of A over reported sigma, rms", results.over_sigma.angle),
      {.what = "first and last L over sample spacing, rms",
       .value = results.ends.Rms(),
       .first_bar = 0.3,
       .goal = 0.1},
      {.what = "the same, median of all tubes",
       .value = pipeline::Median(results.ends_over_spacing),
       .first_bar = 0.3,
       .goal = 0.1},
      {.what = "cloud to LRA, processor, median",
       .value = pipeline::Median(results.cpu_ms),
       .unit = "ms"},
      {.what = "cloud to LRA, processor, slowest",
       .value = pipeline::Quantile(results.cpu_ms, 1.0),
       .unit = "ms"},
  };
}

int Run(const Options& options) {
  const std::string load = FirstLine("/proc/loadavg");
  std::cout << "Processor: " << Processor() << ", " << std::thread::hardware_concurrency()
            << " cores; load when started: " << load << "\n\n";
  nlohmann::json json = {{"processor", Processor()},
                         {"cores", std::thread::hardware_concurrency()},
                         {"load", load},
                         {"quick", options.quick}};
  if (!options.only_tubes) {
    const auto paper = PaperRows(options.quick ? 3 : 25, options);
    PrintTable(std::cout, "Paper's case: 6005 points, one view, noise 0.05 mm", paper);
    json["paper"] = ToJson(paper);
    const std::vector<std::size_t> sizes =
        options.quick ? std::vector<std::size_t>{20'000, 50'000}
                      : std::vector<std::size_t>{100'000, 300'000, 1'000'000};
    const auto growth = GrowthRows(sizes, options.quick ? 1 : 5, options);
    PrintTable(std::cout, "The same tube, more points", growth);
    json["growth"] = ToJson(growth);
  }
  if (!options.only_times) {
    TubeResults results;
    for (std::uint64_t set = 0; set < options.sets; ++set) {
      for (int i = 0; i < kTubes; i += options.quick ? 5 : 1) {
        RunTube(SectionEightCase(i, set), results);
      }
    }
    const auto tubes = TubeRows(results);
    PrintTable(std::cout, std::to_string(results.tubes) + " tubes as in section 8 of the paper",
               tubes);
    for (const std::string& wrong : results.wrong) std::cout << "- " << wrong << '\n';
    json["tubes"] = ToJson(tubes);
    json["tube_list"] = results.list;
  }
  if (options.json_path.empty()) return 0;
  std::ofstream file(options.json_path);
  file << json.dump(2) << '\n';
  if (file.flush()) return 0;
  std::cerr << "bendloop_bench: cannot write " << options.json_path << '\n';
  return 1;
}

}  // namespace
}  // namespace bendloop::bench

int main(int argc, char** argv) {
  bendloop::bench::Options options;
  CLI::App app{"Times and errors of the reconstruction beside their targets, as a Markdown table."};
  app.footer("Example: bendloop_bench --json bench.json");
  app.add_flag("--quick", options.quick, "Few runs and tubes: shows that it works, not how fast");
  auto* tubes = app.add_flag("--only-tubes", options.only_tubes, "Leave out the times");
  app.add_flag("--only-times", options.only_times, "Leave out the tubes")->excludes(tubes);
  app.add_flag("--no-rivals", options.no_rivals, "Leave out the other library");
  app.add_option("--sets", options.sets, "Sets of 30 tubes; the first is the published one")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  app.add_option("--json", options.json_path, "Write everything to this file as well");
  CLI11_PARSE(app, argc, argv);
  return bendloop::bench::Run(options);
}
