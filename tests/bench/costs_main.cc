// SPDX-License-Identifier: Apache-2.0
// One reconstruction, of a cloud or of a scan as it arrives: what callgrind is put on, and whose
// result is the same bytes as long as nothing but speed has changed.
#include <CLI/CLI.hpp>
#include <iostream>
#include <string>

#include "firmware-host/cell/part_plan.h"
#include "firmware-host/result/result_json.h"
#include "pipeline/reconstruction.h"
#include "tests/bench/bench_cases.h"
#include "tests/bench/load/load_source.h"
#include "tests/bench/stopwatch.h"

namespace bendloop::bench {
namespace {

constexpr std::int64_t kBetweenProfilesNs = 1'666'667;  // 600 a second

struct Options {
  std::size_t points = 6005;
  std::uint64_t seed = 2;
  std::size_t profiles = 0;
  int runs = 1;
  bool json = false;
};

// Outside the unnamed namespace it would be the same: callgrind finds it by its name.
[[gnu::noinline]] hal::Result<pipeline::Measurement> LastProfileToResult(
    pipeline::Reconstruction& reconstruction, const hal::LaserProfile& last) {
  reconstruction.Add(last);
  return reconstruction.Finish();
}

hal::Result<pipeline::Measurement> RunLive(const LoadScan& scan, std::size_t profiles,
                                           Elapsed& elapsed) {
  const hal::Tube nominal = LoadTube(0);
  const CpuClock clock;
  pipeline::ReconstructionOptions options;
  options.pipe_radius_mm = nominal.pipe_radius_mm;
  options.nominal = nominal.program;
  options.max_points = host::kMostPoints;
  options.max_line_points = host::kMostLinePoints;
  options.pass_drift = {0.05, 0.02};  // of a cell's file
  pipeline::Reconstruction reconstruction(options, clock);
  hal::LaserProfile profile;
  for (std::size_t i = 0;; ++i) {
    const auto& line = scan.lines[i % scan.lines.size()];
    profile.sequence = i;
    profile.t_ns = kBetweenProfilesNs * static_cast<std::int64_t>(i);
    profile.X_WS = scan.X_WS[i % scan.X_WS.size()];
    profile.points.assign(line.begin(), line.end());
    if (i + 1 == profiles) break;
    reconstruction.Add(profile);
  }
  const Stopwatch watch;
  auto measured = LastProfileToResult(reconstruction, profile);
  elapsed = watch.Read();
  return measured;
}

int Run(const Options& options) {
  const CpuClock clock;
  LoadScan scan;
  Case cloud;
  if (options.profiles > 0) {
    scan = MakeLoadScan(LoadTube(kBentOffDeg), options.seed);
  } else {
    cloud = PaperCase(options.points, options.seed);
  }
  for (int i = 0; i < options.runs; ++i) {
    Elapsed elapsed;
    const Stopwatch watch;
    auto measured = options.profiles > 0 ? RunLive(scan, options.profiles, elapsed)
                                         : pipeline::Reconstruct(cloud.points_W, {}, clock);
    if (options.profiles == 0) elapsed = watch.Read();
    if (!measured) {
      std::cerr << "bendloop_costs: " << measured.error().message << '\n';
      return 4;
    }
    if (!options.json) std::cout << elapsed.cpu_ms << " ms\n";
    if (!options.json || i + 1 < options.runs) continue;
    host::RunResult result;
    result.measurement = std::move(*measured);
    std::cout << host::WriteResultJson(result, {.timing = false});
  }
  return 0;
}

}  // namespace
}  // namespace bendloop::bench

int main(int argc, char** argv) {
  bendloop::bench::Options options;
  CLI::App app{"bendloop_costs: one reconstruction and nothing else, for callgrind"};
  app.footer(R"(
Examples:
  valgrind --tool=callgrind --toggle-collect='bendloop::pipeline::Reconstruct(*' \
    bendloop_costs --points 100000
  valgrind --tool=callgrind --toggle-collect='*LastProfileToResult*' bendloop_costs --profiles 1800
  bendloop_costs --points 6005 --seed 1 --json    the result, to compare its bytes
  bendloop_costs --profiles 1800 --runs 9         processor time of each run
Exit codes: 0 done; 2 wrong usage; 4 no tube was found)");
  app.add_option("--points", options.points, "Of the paper's case")->capture_default_str();
  app.add_option("--seed", options.seed, "Of the noise")->capture_default_str();
  app.add_option("--profiles", options.profiles,
                 "Instead: a scan of so many, one by one; what follows the last counts");
  app.add_option("--runs", options.runs, "Each from the beginning")->capture_default_str();
  app.add_flag("--json", options.json, "Print the last result instead of times");
  CLI11_PARSE(app, argc, argv);
  return bendloop::bench::Run(options);
}
