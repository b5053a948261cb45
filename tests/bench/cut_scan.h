// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <random>
#include <string>

#include "drivers/simulated_scanner/virtual_scan.h"
#include "firmware-host/cell/part_plan.h"
#include "hal/clock.h"
#include "hal/tube.h"
#include "pipeline/reconstruction.h"
#include "tests/support/cut_walls.h"

namespace bendloop::bench {

constexpr double kCutPipeRadiusMm = 8;

// A tube with oblique ends, two holes, a slot and a dent, scanned by a laser line in four passes.
struct CutScan {
  hal::Tube tube;
  drivers::VirtualScanOptions options;
};

inline CutScan ACutTube(std::uint64_t seed, double spacing_mm) {
  std::mt19937_64 random(seed);
  CutScan scanned;
  scanned.tube = drivers::LayOnTable(
      {kCutPipeRadiusMm, {{{90, 0, 60, 25.0}, {70, 90, 45, 25.0}, {80, 0, 0, std::nullopt}}}, {}},
      seed);
  const double length_mm = hal::SpineLength(scanned.tube.program);
  const auto around = [&] { return tests::Uniform(random, -180, 180); };
  hal::TubeFeatures& features = scanned.options.features;
  features.first_end = {tests::Uniform(random, 2, 5), around()};
  features.last_end = {tests::Uniform(random, 2, 5), around()};
  features.openings = {
      {tests::Uniform(random, 28, 34), around(), 6, 6, 0},
      {tests::Uniform(random, 58, 64), around(), 12, 5, tests::Uniform(random, -80, 80)},
      {length_mm - tests::Uniform(random, 33, 40), around(), 5, 5, 0}};
  features.dents = {{tests::Uniform(random, 150, 160), around(), 0.6, 3}};
  scanned.options.seed = seed;
  scanned.options.rays = 320;
  scanned.options.path.profile_spacing_mm = spacing_mm;
  scanned.options.path.views_deg = drivers::SpreadViewsDeg(4, true);
  return scanned;
}

// With as many points kept as a cell keeps.
inline hal::Result<pipeline::Measurement> Measure(const CutScan& scanned) {
  const drivers::VirtualScan scan(scanned.tube, scanned.options);
  const hal::ManualClock clock;
  pipeline::ReconstructionOptions options;
  options.max_points = host::kMostPoints;
  options.max_line_points = host::kMostLinePoints;
  pipeline::Reconstruction reconstruction(options, clock);
  hal::LaserProfile profile(scan.max_points());
  for (std::size_t i = 0; i < scan.profile_count(); ++i) {
    scan.Make(i, profile);
    reconstruction.Add(profile);
  }
  return reconstruction.Finish();
}

// The borders found on a made handle and on the unrolled surface of such a tube, into an SVG.
void DrawBorders(const std::string& file);

}  // namespace bendloop::bench
