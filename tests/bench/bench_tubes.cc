// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/bench_tubes.h"

#include "pipeline/math/quantiles.h"
#include "pipeline/reconstruction.h"
#include "tests/bench/cramer_rao.h"
#include "tests/bench/stopwatch.h"

namespace bendloop::bench {

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

}  // namespace bendloop::bench
