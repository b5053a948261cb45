// SPDX-License-Identifier: Apache-2.0
// Virtual scans of random tubes, once with the poses of their profiles and once as clouds: what
// weights by incidence gain, for noise that grows more or less at grazing incidence.
#include <CLI/CLI.hpp>
#include <iostream>
#include <numeric>
#include <optional>
#include <string>
#include <vector>

#include "drivers/simulated_scanner/virtual_scan.h"
#include "hal/clock.h"
#include "pipeline/reconstruction.h"
#include "tests/bench/bench_table.h"
#include "tests/bench/comparison.h"
#include "tests/bench/stopwatch.h"
#include "tests/bench/tube_runs.h"
#include "tests/support/synthetic_cloud.h"
#include "tests/support/uniform.h"

namespace bendloop::bench {
namespace {

struct Options {
  TubeRuns runs{.tubes = 100};
  std::vector<double> growths = {0, 1, 2, 3};
  double pose_noise_mm = 0;
};

// One tube both ways.
struct Both {
  std::size_t points = 0;
  Comparison posed, plain;
  double posed_ms = 0, plain_ms = 0;
};

std::optional<Both> RunTube(std::uint64_t seed, double growth, double pose_noise_mm) {
  std::mt19937_64 random(seed);
  const hal::Tube tube = drivers::LayOnTable(
      tests::RandomTube({.pipe_radius_mm = tests::Uniform(random, 3, 12),
                         .bends = std::uniform_int_distribution<int>(1, 4)(random),
                         .min_angle_deg = 20},
                        random),
      seed);
  drivers::VirtualScanOptions options;
  options.seed = seed;
  options.noise_mm = tests::Uniform(random, 0.02, 0.05);
  options.noise_growth = growth;
  options.pose_noise_mm = pose_noise_mm;
  options.fan_half_angle_deg = 10;
  options.rays = 200;
  options.path.profile_spacing_mm = tests::Uniform(random, 0.5, 2);
  options.path.views_deg =
      drivers::SpreadViewsDeg(std::uniform_int_distribution<int>(1, 3)(random));
  const drivers::VirtualScan scan(tube, options);

  const hal::SteadyClock clock;
  pipeline::Reconstruction posed({}, clock), plain({}, clock);
  std::vector<Eigen::Vector3d> all, of_profile;
  hal::LaserProfile profile(scan.max_points());
  for (std::size_t i = 0; i < scan.profile_count(); ++i) {
    scan.Make(i, profile);
    of_profile.clear();
    for (const hal::ProfilePoint& p : profile.points) {
      of_profile.push_back(profile.X_WS * Eigen::Vector3d(p.x_mm, 0, p.z_mm));
    }
    posed.Add(profile);
    plain.Add(of_profile);
    all.insert(all.end(), of_profile.begin(), of_profile.end());
  }
  Both both;
  both.points = all.size();
  const auto finish = [](pipeline::Reconstruction& reconstruction, double& ms) {
    const Stopwatch watch;
    auto measured = reconstruction.Finish();
    ms = watch.Read().wall_ms;
    return measured;
  };
  const auto with = finish(posed, both.posed_ms);
  const auto without = finish(plain, both.plain_ms);
  if (!with || !without) return std::nullopt;
  const Bound bound = CramerRaoBound(tube, all, options.noise_mm, 3 * options.noise_mm);
  both.posed = Compare(tube, *with, bound, options.path.profile_spacing_mm);
  both.plain = Compare(tube, *without, bound, options.path.profile_spacing_mm);
  if (!both.posed.bends_right || !both.plain.bends_right) return std::nullopt;
  return both;
}

void AddTo(std::vector<std::vector<std::string>>& lines, const Options& options, double growth) {
  std::vector<std::uint64_t> seeds(options.runs.tubes);
  std::iota(seeds.begin(), seeds.end(), options.runs.first_seed());
  const auto results = RunSeeds<std::optional<Both>>(
      seeds, options.runs.threads,
      [&](std::uint64_t seed) { return RunTube(seed, growth, options.pose_noise_mm); });

  LraRatios posed, plain, posed_sigma, plain_sigma;
  double points = 0, posed_ms = 0, plain_ms = 0;
  int tubes = 0;
  for (const auto& both : results) {
    if (!both) continue;
    ++tubes;
    points += static_cast<double>(both->points);
    posed_ms += both->posed_ms;
    plain_ms += both->plain_ms;
    posed.Add(both->posed.over_bound);
    plain.Add(both->plain.over_bound);
    posed_sigma.Add(both->posed.over_sigma);
    plain_sigma.Add(both->plain.over_sigma);
  }
  auto& line = lines.emplace_back();
  line = {Number(growth), Number(tubes), Number(points / std::max(1, tubes))};
  const auto kinds = {&LraRatios::length, &LraRatios::rotation, &LraRatios::angle,
                      &LraRatios::bend_radius, &LraRatios::pipe_radius};
  for (const auto kind : kinds) line.push_back(Number((posed.*kind).Rms() / (plain.*kind).Rms()));
  for (const auto kind : kinds) line.push_back(Number((posed_sigma.*kind).Rms()));
  for (const auto kind : kinds) line.push_back(Number((plain_sigma.*kind).Rms()));
  line.push_back(Number(posed_ms / plain_ms));
}

int Run(const Options& options) {
  std::vector<std::vector<std::string>> lines = {
      {"growth", "tubes", "points", "L", "R", "A", "CLR", "r", "L/s", "R/s", "A/s", "CLR/s", "r/s",
       "L/s without", "R/s", "A/s", "CLR/s", "r/s", "time"}};
  for (const double growth : options.growths) AddTo(lines, options, growth);
  PrintMarkdown(std::cout, "Virtual scans with the poses of their profiles and without", lines,
                std::vector<bool>(lines[0].size(), true));
  std::cout
      << "growth n: noise along the ray is 1 / cos(incidence)^n; L to r: rms error with poses "
         "over without; /s: rms error over reported sigma, with and without; time: with over "
         "without, from the last profile on\n";
  return 0;
}

}  // namespace
}  // namespace bendloop::bench

int main(int argc, char** argv) {
  bendloop::bench::Options options;
  CLI::App app{"What weights by incidence gain, as Markdown."};
  app.footer(
      "Examples:\n"
      "  bendloop_incidence --tubes 400\n"
      "  bendloop_incidence --growth 0,2 --pose-noise 0.03");
  options.runs.AddOptions(app);
  app.add_option("--growth", options.growths, "n of noise / cos(incidence)^n, one row each")
      ->delimiter(',')
      ->check(CLI::Range(0.0, 4.0).description("0 to 4"))
      ->capture_default_str();
  app.add_option("--pose-noise", options.pose_noise_mm, "1 sigma of the sensor's position [mm]")
      ->check(CLI::Range(0.0, 1.0).description("0 to 1"))
      ->capture_default_str();
  CLI11_PARSE(app, argc, argv);
  return bendloop::bench::Run(options);
}
