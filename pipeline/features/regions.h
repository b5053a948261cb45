// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <span>
#include <vector>

#include "pipeline/features/point_characteristics.h"

namespace bendloop::pipeline {

struct RegionOptions {
  double reach_mm = 1;       // who is a neighbour
  double normal_turn = 0.5;  // [rad] normals vary rapidly from here; regions stop
  // Deeper below the convex hull is another region than what lies on it; infinite: the hull says
  // nothing.
  double concavity_mm = 0;
  std::size_t least_points = 30;  // fewer are no region
};

struct Regions {
  static constexpr int kNone = -1;
  std::vector<int> of_point;  // region, from 0, the largest first; kNone: of none
  std::vector<bool> concave;  // of each region: it lies below the hull
  std::size_t count = 0;
};

// Region growing: neighbours belong together where normals turn slowly and both lie on the hull or
// both below. Points of borders go to the region nearest by.
// Source: Stamati & Fudos 2008, section 2.
Regions GrowRegions(std::span<const Eigen::Vector3d> points_mm, const PointIndex& index,
                    std::span<const PointCharacteristics> characteristics,
                    const RegionOptions& options);

}  // namespace bendloop::pipeline
