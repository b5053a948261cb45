// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/bench_noise.h"

#include <algorithm>
#include <array>
#include <string>

#include "pipeline/reconstruction.h"
#include "tests/bench/bench_cases.h"
#include "tests/bench/bench_table.h"
#include "tests/bench/cramer_rao.h"
#include "tests/bench/stopwatch.h"

namespace bendloop::bench {
namespace {

constexpr std::array<double, 5> kNoiseMm = {0.01, 0.02, 0.04, 0.08, 0.12};

struct Column {
  const char* name;
  const char* unit;
  Ratio LraRatios::*kind;
};
constexpr std::array<Column, 5> kColumns = {{{"L", "mm", &LraRatios::length},
                                             {"R", "degree", &LraRatios::rotation},
                                             {"A", "degree", &LraRatios::angle},
                                             {"CLR", "mm", &LraRatios::bend_radius},
                                             {"r", "mm", &LraRatios::pipe_radius}}};

Comparison Measure(const Case& scan) {
  const CpuClock clock;
  const auto measured = pipeline::Reconstruct(scan.points_W, {}, clock);
  if (!measured || measured->tube.program.bend_count() != scan.truth.program.bend_count())
    return {};
  return Compare(scan.truth, *measured, CramerRaoBound(scan.truth, scan.points_W, scan.noise_mm),
                 scan.spacing_mm);
}

void AddTube(const std::array<Comparison, kNoiseMm.size()>& tube, NoiseSweep& sweep) {
  ++sweep.tubes;
  bool all_right = true;
  for (std::size_t l = 0; l < tube.size(); ++l) {
    sweep.levels[l].right += tube[l].bends_right ? 1 : 0;
    all_right = all_right && tube[l].bends_right;
  }
  if (!all_right) return;
  ++sweep.compared;
  for (std::size_t v = 0; v < tube[0].values.size(); ++v) {
    if (std::any_of(tube.begin(), tube.end(),
                    [v](const Comparison& c) { return c.values[v].vague; }))
      continue;
    for (std::size_t l = 0; l < tube.size(); ++l) {
      const Comparison::Value& value = tube[l].values[v];
      (sweep.levels[l].error.*value.kind).Add(value.error);
      (sweep.levels[l].bound.*value.kind).Add(value.bound);
    }
  }
}

}  // namespace

NoiseSweep SweepNoise(int stride, std::uint64_t sets) {
  NoiseSweep sweep;
  for (const double noise_mm : kNoiseMm) {
    sweep.levels.emplace_back().noise_mm = noise_mm;
  }
  for (std::uint64_t set = 0; set < sets; ++set) {
    for (int i = 0; i < kTubes; i += stride) {
      std::array<Comparison, kNoiseMm.size()> tube;
      for (std::size_t l = 0; l < tube.size(); ++l) {
        tube[l] = Measure(SectionEightCase(i, set, kNoiseMm[l]));
      }
      AddTube(tube, sweep);
    }
  }
  return sweep;
}

void PrintNoise(std::ostream& out, const NoiseSweep& sweep) {
  std::vector<std::vector<std::string>> lines = {{"noise, mm", "right"}};
  for (const Column& column : kColumns) {
    lines[0].push_back(std::string(column.name) + ", " + column.unit);
    lines[0].emplace_back("over bound");
  }
  for (const NoiseSweep::Level& level : sweep.levels) {
    auto& line = lines.emplace_back();
    line.push_back(Number(level.noise_mm));
    line.push_back(std::to_string(level.right) + " of " + std::to_string(sweep.tubes));
    for (const Column& column : kColumns) {
      const double error = (level.error.*column.kind).Rms();
      const double bound = (level.bound.*column.kind).Rms();
      line.push_back(Number(error));
      line.push_back(bound > 0 ? Number(error / bound) : "-");
    }
  }
  PrintMarkdown(out,
                "Error over noise, rms over the " + std::to_string(sweep.compared) +
                    " tubes that are right at each",
                lines, std::vector<bool>(lines[0].size(), true));
}

nlohmann::json ToJson(const NoiseSweep& sweep) {
  nlohmann::json levels = nlohmann::json::array();
  for (const NoiseSweep::Level& level : sweep.levels) {
    nlohmann::json entry = {{"noise_mm", level.noise_mm}, {"right", level.right}};
    for (const Column& column : kColumns) {
      entry["values"][column.name] = {{"unit", column.unit},
                                      {"count", (level.error.*column.kind).count},
                                      {"error_rms", (level.error.*column.kind).Rms()},
                                      {"bound_rms", (level.bound.*column.kind).Rms()}};
    }
    levels.push_back(std::move(entry));
  }
  return {{"tubes", sweep.tubes}, {"compared", sweep.compared}, {"levels", levels}};
}

}  // namespace bendloop::bench
