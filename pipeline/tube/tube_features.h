// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <vector>

#include "hal/tube_features.h"

namespace bendloop::pipeline {

// A hole or slot that the scan shows; hal/tube_features.h says how its place is counted.
struct OpeningFound {
  hal::WallOpening opening;
  hal::WallOpening sigma;  // 1 sigma of each value; of a hole the axis has none
  Eigen::Vector3d position_mm = Eigen::Vector3d::Zero();  // of its middle on the surface, in W
  Eigen::Vector3d direction = Eigen::Vector3d::UnitX();   // of its length, in W
};

// The plane of an end that is not cut square.
struct EndCutFound {
  hal::EndCut cut;
  double obliquity_sigma_deg = 0;
  double around_sigma_deg = 0;
};

// What is cut into the tube and drilled through its wall.
struct TubeFeaturesFound {
  bool is_known = false;  // false: nobody looked, as of canals
  // None: too few samples lie on that end to tell a plane.
  std::optional<EndCutFound> first_end, last_end;
  std::vector<OpeningFound> openings;  // in their order along the tube
};

}  // namespace bendloop::pipeline
