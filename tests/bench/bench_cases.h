// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "hal/tube.h"
#include "pipeline/fit/surface_points.h"
#include "pipeline/points/sample_grid.h"

namespace bendloop::bench {

// A tube with a scan of it.
struct Case {
  std::string name;
  std::uint64_t seed = 0;
  hal::Tube truth;
  double noise_mm = 0;    // 1 sigma along the surface normal, as put in
  double fliers = 0;      // part of the points
  double spacing_mm = 0;  // between samples along the tube: of a scattered scan, the mean distance
  std::vector<Eigen::Vector3d> points_W;
};

pipeline::SampleGrid FilledGrid(const Case& scan);
// Its points, in the blocks of such a grid.
pipeline::OwnedBlocks Blocks(const Case& scan);

// The four-bend tube of the paper's figure 3, noise 0.05 mm, seen from one side.
Case PaperCase(std::size_t points, std::uint64_t seed);

constexpr int kTubes = 30;
// Tubes as section 8 of the paper lists them: pipe radii of 2 to 50 mm, 1 to 14 bends, very short
// straights, bends beyond 180 degrees, angles down to 2 degrees, one and two views and all round,
// stripes, noise up to 0.12 mm, fliers. `index` in [0, kTubes); `set` 0 is the published one,
// others are fresh tubes of the same kinds. `noise_mm`: instead of the kind's own, on the same
// tube.
Case SectionEightCase(int index, std::uint64_t set, std::optional<double> noise_mm = std::nullopt);

}  // namespace bendloop::bench
