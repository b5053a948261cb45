// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "tests/bench/stopwatch.h"

namespace bendloop::bench {

// A straight piece of tube, as a library sees it.
struct FoundCylinder {
  Eigen::Vector3d point_mm;  // on the axis
  Eigen::Vector3d axis;      // of unit length
  double radius_mm = 0;
  std::size_t points = 0;  // that it explains
};

// What another library made of the same points, in the same run.
struct RivalRun {
  std::string how;  // its settings in a few words
  Elapsed normals;  // its preparation
  Elapsed shapes;
  std::vector<FoundCylinder> cylinders;  // neither ordered nor joined: no LRA
  std::size_t other_shapes = 0;          // tori
};

using Points = std::span<const Eigen::Vector3d>;

struct Rival {
  const char* name;
  // The pipe radius and the noise are told, which bendloop finds by itself.
  RivalRun (*run)(Points points_W, double pipe_radius_mm, double noise_mm);
};

// Those that the benchmark was built with; none is needed.
std::vector<Rival> Rivals();

RivalRun RunCgal(Points points_W, double pipe_radius_mm, double noise_mm);
RivalRun RunPcl(Points points_W, double pipe_radius_mm, double noise_mm);

}  // namespace bendloop::bench
