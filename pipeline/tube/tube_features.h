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

// A bevel of an end's outside: a cone from the pipe's wall to where the tube ends.
struct BevelFound {
  double length_mm = 0, length_sigma_mm = 0;  // along the tube
  double depth_mm = 0, depth_sigma_mm = 0;    // how far the wall has come in at the end
  double angle_deg = 0, angle_sigma_deg = 0;  // of the cone, to the axis
};

// A burr: what stands out of the wall right before the end.
struct BurrFound {
  double height_mm = 0, sigma_mm = 0;  // where it is highest
  double around_deg = 0;               // and where that is
  double part = 0;                     // of the turn, that has one
};

// A place of a border that no plane is.
struct BorderPlace {
  double around_deg = 0;
  double beyond_mm = 0, sigma_mm = 0;  // the plane there, out of the tube
};

// The plane of an end that is not cut square, and what the end has beside it.
struct EndCutFound {
  hal::EndCut cut;
  double obliquity_sigma_deg = 0;
  double around_sigma_deg = 0;
  std::optional<BevelFound> bevel;
  std::optional<BurrFound> burr;
  std::vector<BorderPlace> border;  // all round; none: nothing says that it is no plane
};

// What is cut into the tube and drilled through its wall.
struct TubeFeaturesFound {
  bool is_known = false;  // false: nobody looked, as of canals
  // None: too few samples lie on that end to tell a plane.
  std::optional<EndCutFound> first_end, last_end;
  std::vector<OpeningFound> openings;  // in their order along the tube
};

}  // namespace bendloop::pipeline
