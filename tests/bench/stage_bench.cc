// SPDX-License-Identifier: Apache-2.0
// The stages of the reconstruction one by one, and the scanner's wire, for those who change one of
// them.
#include <benchmark/benchmark.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <random>
#include <span>
#include <vector>

#include "drivers/scanner_wire/wire_decoder.h"
#include "drivers/scanner_wire/wire_encoder.h"
#include "hal/spine.h"
#include "pipeline/fit/surface_fit.h"
#include "pipeline/points/sample_grid.h"
#include "pipeline/spine/cylinder_fit.h"
#include "pipeline/spine/local_paraboloid.h"
#include "pipeline/spine/mls_projection.h"
#include "pipeline/spine/nn_crust.h"
#include "pipeline/spine/pipe_radius.h"
#include "pipeline/spline/shortcut_graph.h"
#include "pipeline/spline/simplify.h"
#include "tests/bench/bench_cases.h"

namespace bendloop::bench {
namespace {

const Case& Paper() {
  static const Case scan = PaperCase(6005, 1);
  return scan;
}

// Points of the true spine with noise, in their order.
std::vector<Eigen::Vector3d> Chain(double step_mm, double noise_mm) {
  const hal::Tube& tube = Paper().truth;
  std::mt19937_64 random(3);
  std::normal_distribution<double> noise(0.0, noise_mm);
  std::vector<Eigen::Vector3d> chain;
  for (const auto& segment : hal::SpineSegments(tube.program, tube.X_WT)) {
    for (double along = 0; along < segment.length_mm; along += step_mm) {
      chain.push_back(segment.PointAt(along) +
                      Eigen::Vector3d(noise(random), noise(random), noise(random)));
    }
  }
  return chain;
}

void EstimatePipeRadius(benchmark::State& state) {
  for (auto _ : state) benchmark::DoNotOptimize(pipeline::EstimatePipeRadius(Paper().points_W));
}
BENCHMARK(EstimatePipeRadius)->Unit(benchmark::kMillisecond);

void GridInsert(benchmark::State& state) {
  const Case scan = PaperCase(static_cast<std::size_t>(state.range(0)), 2);
  for (auto _ : state) {
    const auto grid = FilledGrid(scan);
    benchmark::DoNotOptimize(grid.sample_count());
  }
  state.SetItemsProcessed(state.iterations() * state.range(0));
}
BENCHMARK(GridInsert)->Arg(6005)->Arg(300'000)->Unit(benchmark::kMillisecond);

void LocalParaboloid(benchmark::State& state) {
  const auto grid = FilledGrid(Paper());
  const double radius_mm = 2.0 / 3.0 * Paper().truth.pipe_radius_mm;
  std::vector<Eigen::Vector3d> around;
  std::size_t at = 0;
  for (auto _ : state) {
    const auto& block = grid.blocks()[at++ % grid.blocks().size()];
    grid.GatherNeighbourhood(block.neighbours[13], around);
    benchmark::DoNotOptimize(
        pipeline::FitLocalParaboloid(block.samples().front(), around, radius_mm));
  }
}
BENCHMARK(LocalParaboloid)->Unit(benchmark::kMicrosecond);

void CylinderFit(benchmark::State& state) {
  const Case& scan = Paper();
  const auto grid = FilledGrid(scan);
  const auto segments = hal::SpineSegments(scan.truth.program, scan.truth.X_WT);
  const double r = scan.truth.pipe_radius_mm;
  std::vector<Eigen::Vector3d> ball;
  std::size_t at = 0;
  for (auto _ : state) {
    const auto& segment = segments[at++ % segments.size()];
    const Eigen::Vector3d guess = segment.PointAt(0.5 * segment.length_mm) + 0.1 * segment.normal;
    grid.GatherBall(guess, 1.4 * r, ball);
    benchmark::DoNotOptimize(
        pipeline::FitCylinder(guess, segment.TangentAt(0.45 * segment.length_mm), ball,
                              {.radius_mm = r, .support_mm = 1.2 * r, .inlier_mm = 0.25 * r}));
  }
}
BENCHMARK(CylinderFit)->Unit(benchmark::kMicrosecond);

void NnCrust(benchmark::State& state) {
  const auto chain = Chain(1.2, 0.01);
  for (auto _ : state) benchmark::DoNotOptimize(pipeline::NnCrust(chain, 6.0));
}
BENCHMARK(NnCrust)->Unit(benchmark::kMicrosecond);

void Simplify(benchmark::State& state) {
  const auto chain = Chain(268.0 / static_cast<double>(state.range(0)), 0.01);
  for (auto _ : state) benchmark::DoNotOptimize(pipeline::Simplify(chain, 0.16));
}
BENCHMARK(Simplify)->Arg(200)->Arg(800)->Unit(benchmark::kMicrosecond);

void ShortcutGraph(benchmark::State& state) {
  const auto chain = Chain(1.2, 0.01);
  std::vector<Eigen::Vector3d> vertices;
  for (const std::size_t k : pipeline::Simplify(chain, 0.16)) vertices.push_back(chain[k]);
  std::vector<pipeline::TangentLine> lines;
  for (std::size_t i = 0; i + 1 < vertices.size(); ++i) {
    lines.push_back({vertices[i], (vertices[i + 1] - vertices[i]).normalized()});
  }
  for (auto _ : state) {
    benchmark::DoNotOptimize(pipeline::ApproximateByArcLineSpline(vertices, lines, 0.32));
  }
}
BENCHMARK(ShortcutGraph)->Unit(benchmark::kMicrosecond);

// One round of one iteration: assignment, sums, one step, standard errors.
void SurfaceFitRound(benchmark::State& state) {
  const Case scan = PaperCase(static_cast<std::size_t>(state.range(0)), 2);
  const auto blocks = Blocks(scan);
  const double reach_mm = 0.2 * scan.truth.pipe_radius_mm;
  for (auto _ : state) {
    benchmark::DoNotOptimize(
        pipeline::FitSurface(scan.truth, blocks, {.reach_mm = reach_mm, .max_steps = 1}));
  }
  state.SetItemsProcessed(state.iterations() * state.range(0));
}
BENCHMARK(SurfaceFitRound)->Arg(6005)->Arg(300'000)->Unit(benchmark::kMillisecond);

void SurfaceFitWhole(benchmark::State& state) {
  const auto blocks = Blocks(Paper());
  const double reach_mm = 0.2 * Paper().truth.pipe_radius_mm;
  for (auto _ : state) {
    benchmark::DoNotOptimize(pipeline::FitSurface(Paper().truth, blocks, {.reach_mm = reach_mm}));
  }
}
BENCHMARK(SurfaceFitWhole)->Unit(benchmark::kMillisecond);

// A scanner's bytes to profiles, in USB transfers of 16 KiB, read where they are. The fastest
// scanner sends 12 MB/s.
void DecodeWire(benchmark::State& state) {
  hal::LaserProfile profile(640);
  profile.X_WS.orientation = Eigen::Quaterniond::Identity();
  for (int i = 0; i < 640; ++i) {
    profile.points.push_back({static_cast<float>(i) * 0.1F, 150.0F});
    profile.intensity.push_back(static_cast<std::uint8_t>(i));
  }
  drivers::WireEncoder encoder;
  std::vector<std::uint8_t> bytes;
  for (profile.sequence = 0; profile.sequence < 1000; ++profile.sequence) {
    if (!encoder.Append(profile, bytes)) state.SkipWithError("profile not encoded");
  }
  drivers::WireDecoder decoder;
  std::size_t profiles = 0;
  for (auto _ : state) {
    for (std::size_t at = 0; at < bytes.size(); at += 16384) {
      decoder.Feed(std::span(bytes).subspan(at, std::min<std::size_t>(16384, bytes.size() - at)));
      while (const auto message = decoder.Next()) {
        profiles += drivers::DecodeProfile(message->payload, profile) ? 1 : 0;
      }
    }
  }
  if (profiles != 1000 * static_cast<std::size_t>(state.iterations()))
    state.SkipWithError("profiles lost");
  state.SetBytesProcessed(static_cast<std::int64_t>(bytes.size()) * state.iterations());
}
BENCHMARK(DecodeWire);

}  // namespace
}  // namespace bendloop::bench
