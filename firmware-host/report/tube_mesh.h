// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <vector>

#include "hal/spine.h"
#include "hal/tube.h"

namespace bendloop::host {

// A tube as rings of `kSides` vertices. Two tubes with the same number of bends sampled with the
// same `counts` correspond vertex by vertex.
struct TubeMesh {
  static constexpr int kSides = 24;
  std::vector<Eigen::Vector3d> centers;   // of the rings
  std::vector<std::size_t> segments;      // of the rings: 2 i is straight i, 2 i + 1 is bend i
  std::vector<Eigen::Vector3d> vertices;  // ring by ring
};

// Rings for each segment: enough for a smooth picture of every one of `spines` (of the same size).
std::vector<int> RingCounts(const std::vector<std::vector<hal::SpineSegment>>& spines);

TubeMesh MakeTubeMesh(const std::vector<hal::SpineSegment>& spine, double pipe_radius_mm,
                      const std::vector<int>& counts);

// Distance of a point from a spine; the end straights go on for ever.
double DistanceFromSpine(const std::vector<hal::SpineSegment>& spine, const Eigen::Vector3d& p);

}  // namespace bendloop::host
