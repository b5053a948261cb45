// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <span>
#include <string>
#include <vector>

#include "tests/bench/stopwatch.h"

namespace bendloop::bench {

// What another library made of the same points, in the same run.
struct Rival {
  std::string name;
  Elapsed normals;  // its preparation
  Elapsed shapes;
  std::string found;  // what came out: unordered shapes are no LRA
};

// Empty when the benchmark was built without any.
std::vector<Rival> RunRivals(std::span<const Eigen::Vector3d> points_W, double pipe_radius_mm,
                             double noise_mm);

}  // namespace bendloop::bench
