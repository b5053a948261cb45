// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/bench_cases.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <random>

#include "hal/spine.h"
#include "pipeline/spine/mls_projection.h"
#include "tests/support/synthetic_cloud.h"

namespace bendloop::bench {
namespace {

constexpr double kPointsPerArea = 30;  // on an area of r_P^2; the paper's case has 28

enum class Views { kAllRound, kOne, kTwo };

struct Kind {
  const char* name;
  double pipe_radius_mm;
  int bends;
  std::array<double, 2> straight;  // of r_P
  std::array<double, 2> angle_deg;
  std::array<double, 2> bend_radius;  // of r_P
  bool one_bend_radius;
  Views views;
  double stripes;  // distance of the laser lines, of r_P; 0: scattered points
  double noise_mm;
  double fliers;
};

using enum Views;
// clang-format off
constexpr std::array<Kind, kTubes> kKinds = {{
    {"plain, one bend",        4,   1, {5, 20},  {30, 120},  {3, 3},     true,  kOne,      0,    0.05, 0},
    {"wire, two bends",        2,   2, {5, 20},  {30, 120},  {2.5, 4},   true,  kOne,      0,    0.05, 0},
    {"three bends",            6,   3, {4, 15},  {20, 110},  {2.5, 4},   true,  kOne,      0,    0.05, 0.01},
    {"paper's size",           4,   4, {4, 15},  {10, 120},  {3, 4},     true,  kOne,      0,    0.08, 0},
    {"two views",              4,   5, {4, 15},  {10, 120},  {2, 4},     true,  kTwo,      0,    0.05, 0.02},
    {"all round",              8,   4, {4, 15},  {10, 120},  {2, 4},     true,  kAllRound, 0,    0.05, 0},
    {"exhaust pipe",          25,   6, {3, 12},  {10, 100},  {2, 3},     true,  kTwo,      0,    0.10, 0.01},
    {"thick pipe",            50,   3, {3, 10},  {15, 100},  {2, 3},     true,  kOne,      0,    0.12, 0},
    {"thick, all round",      50,   5, {3, 10},  {10, 100},  {2, 3},     true,  kAllRound, 0,    0.10, 0.02},
    {"brake line, 14 bends",   2.4, 14, {3, 20}, {10, 100},  {2.5, 5},   true,  kAllRound, 0,    0.05, 0},
    {"brake line, two views",  2.4, 12, {3, 20}, {10, 100},  {2.5, 5},   true,  kTwo,      0,    0.04, 0.01},
    {"fuel line, 10 bends",    4,  10, {3, 15},  {10, 110},  {2, 4},     true,  kTwo,      0,    0.05, 0.01},
    {"short straights",        5,   3, {0.4, 1}, {30, 90},   {2.5, 4},   true,  kAllRound, 0,    0.05, 0},
    {"short straights",        4,   5, {0.4, 1}, {30, 80},   {2.5, 4},   true,  kAllRound, 0,    0.04, 0},
    {"short, own radii",       6,   4, {0.5, 1}, {30, 90},   {2, 5},     false, kTwo,      0,    0.05, 0},
    {"beyond 180",             5,   1, {8, 15},  {185, 260}, {4, 6},     true,  kAllRound, 0,    0.05, 0},
    {"beyond 180, three",      4,   3, {5, 15},  {120, 240}, {4, 6},     true,  kAllRound, 0,    0.05, 0.01},
    {"beyond 180, two views",  6,   2, {5, 15},  {150, 220}, {4, 6},     true,  kTwo,      0,    0.05, 0},
    {"angles of 2 to 5",       4,   3, {8, 20},  {2, 5},     {3, 5},     true,  kTwo,      0,    0.05, 0},
    {"angles of 2 to 5",      10,   2, {8, 20},  {2, 5},     {3, 5},     true,  kOne,      0,    0.05, 0},
    {"small among large",      6,   5, {6, 15},  {2, 90},    {3, 4},     true,  kTwo,      0,    0.05, 0.01},
    {"stripes",                6,   4, {4, 15},  {15, 110},  {2.5, 4},   true,  kOne,      0.10, 0.05, 0},
    {"wide stripes",           8,   3, {4, 15},  {15, 110},  {2.5, 4},   true,  kTwo,      0.25, 0.05, 0.01},
    {"stripes, all round",     4,   6, {4, 12},  {10, 110},  {2.5, 4},   true,  kAllRound, 0.15, 0.05, 0.02},
    {"noisy wire",             2,   3, {5, 20},  {30, 120},  {3, 4},     true,  kAllRound, 0,    0.12, 0},
    {"noisy, one view",        4,   4, {5, 15},  {20, 110},  {3, 4},     true,  kOne,      0,    0.12, 0.01},
    {"fliers 5 %",             5,   4, {4, 15},  {15, 110},  {2.5, 4},   true,  kOne,      0,    0.05, 0.05},
    {"fliers 5 %, two views",  8,   6, {4, 15},  {10, 110},  {2.5, 4},   true,  kTwo,      0,    0.10, 0.05},
    {"own radii",              8,   7, {3, 12},  {10, 110},  {2, 6},     false, kTwo,      0,    0.05, 0.02},
    {"large radii",           10,   3, {3, 10},  {20, 90},   {8, 14},    true,  kOne,      0,    0.05, 0.01},
}};
// clang-format on

Eigen::Vector3d RandomUnit(std::mt19937_64& random) {
  std::normal_distribution<double> normal;
  return Eigen::Vector3d(normal(random), normal(random), normal(random)).normalized();
}

// The direction from which the tube is seen best: across all its straights, as it would lie on a
// table.
Eigen::Vector3d BestView(const hal::Tube& tube, std::mt19937_64& random) {
  const auto segments = hal::SpineSegments(tube.program, tube.X_WT);
  Eigen::Vector3d best = Eigen::Vector3d::UnitZ();
  double best_sine = -1;
  for (int i = 0; i < 200; ++i) {
    const Eigen::Vector3d view = RandomUnit(random);
    double sine = 1;
    for (const auto& segment : segments) {
      for (const double part : {0.0, 0.5, 1.0}) {
        sine = std::min(sine, segment.TangentAt(part * segment.length_mm).cross(view).norm());
      }
    }
    if (sine > best_sine) {
      best_sine = sine;
      best = view;
    }
  }
  return best;
}

// Mean distance along the spine between points that are `per_mm2` dense on the surface.
double ScatteredSpacing(double per_mm2) { return 1.0 / std::sqrt(per_mm2); }

}  // namespace

pipeline::SampleGrid FilledGrid(const Case& scan) {
  pipeline::SampleGrid grid(pipeline::MlsProjection::BlockMm(scan.truth.pipe_radius_mm));
  std::int32_t block = 0;
  for (const Eigen::Vector3d& p : scan.points_W) grid.Insert(p, block);
  return grid;
}

pipeline::OwnedBlocks Blocks(const Case& scan) {
  const pipeline::SampleGrid grid = FilledGrid(scan);
  pipeline::OwnedBlocks blocks(grid.point_count());
  for (const auto& block : grid.blocks()) {
    blocks.Begin(grid.CenterOf(block), 0.5 * std::sqrt(3.0) * grid.block_mm());
    for (const Eigen::Vector3d& p : block.points) blocks.Add(p);
  }
  return blocks;
}

Case PaperCase(std::size_t points, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  Case result;
  result.name = "paper's case";
  result.seed = seed;
  result.truth = tests::PaperTube();
  result.noise_mm = 0.05;
  tests::CloudOptions options;
  options.points = points;
  options.noise_mm = result.noise_mm;
  options.view_W = BestView(result.truth, random);
  result.points_W = tests::SyntheticCloud(result.truth, options, random);
  const double area = hal::SpineLength(result.truth.program) * std::numbers::pi *
                      result.truth.pipe_radius_mm;  // half of the surface
  result.spacing_mm = ScatteredSpacing(static_cast<double>(points) / area);
  return result;
}

Case SectionEightCase(int index, std::uint64_t set, std::optional<double> noise_mm) {
  const Kind& kind = kKinds[static_cast<std::size_t>(index)];
  Case result;
  result.name = kind.name;
  result.seed = 1000 * set + static_cast<std::uint64_t>(index);
  std::mt19937_64 random(result.seed);
  tests::RandomTubeOptions tube;
  tube.pipe_radius_mm = kind.pipe_radius_mm;
  tube.bends = kind.bends;
  tube.min_bend_radius = kind.bend_radius[0];
  tube.max_bend_radius = kind.bend_radius[1];
  tube.min_straight = kind.straight[0];
  tube.max_straight = kind.straight[1];
  tube.min_angle_deg = kind.angle_deg[0];
  tube.max_angle_deg = kind.angle_deg[1];
  tube.one_bend_radius = kind.one_bend_radius;
  if (tube.max_straight < 3.0) {
    // The end straights, which are never shorter than 3 r_P, need a longer limit: by hand below.
    tube.max_straight = 3.0;
  }
  result.truth = tests::RandomTube(tube, random);
  if (kind.straight[1] < 3.0) {
    for (std::size_t i = 1; i + 1 < result.truth.program.rows.size(); ++i) {
      result.truth.program.rows[i].length_mm =
          kind.pipe_radius_mm *
          std::uniform_real_distribution<double>(kind.straight[0], kind.straight[1])(random);
    }
    result.truth.program.rows.front().length_mm = 6.0 * kind.pipe_radius_mm;
    result.truth.program.rows.back().length_mm = 6.0 * kind.pipe_radius_mm;
  }
  result.noise_mm = noise_mm.value_or(kind.noise_mm);
  result.fliers = kind.fliers;

  tests::CloudOptions options;
  options.noise_mm = result.noise_mm;
  options.fliers = kind.fliers;
  options.stripes_mm = kind.stripes * kind.pipe_radius_mm;
  const double around = 2.0 * std::numbers::pi * (kind.views == kAllRound ? 1.0 : 0.5);
  const double area = around * hal::SpineLength(result.truth.program) / kind.pipe_radius_mm;
  options.points = static_cast<std::size_t>(std::clamp(kPointsPerArea * area, 2000.0, 60000.0));
  result.spacing_mm = options.stripes_mm > 0
                          ? options.stripes_mm
                          : ScatteredSpacing(static_cast<double>(options.points) /
                                             (area * kind.pipe_radius_mm * kind.pipe_radius_mm));
  if (kind.views == kAllRound) {
    result.points_W = tests::SyntheticCloud(result.truth, options, random);
    return result;
  }
  const Eigen::Vector3d view = BestView(result.truth, random);
  options.view_W = view;
  result.points_W = tests::SyntheticCloud(result.truth, options, random);
  if (kind.views == kTwo) {
    // The second view a quarter turn aside: most of the way round in the end.
    options.view_W = -(view + RandomUnit(random) * 0.5).normalized();
    const auto more = tests::SyntheticCloud(result.truth, options, random);
    result.points_W.insert(result.points_W.end(), more.begin(), more.end());
  }
  return result;
}

}  // namespace bendloop::bench
