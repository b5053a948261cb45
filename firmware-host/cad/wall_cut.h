// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <vector>

#include "firmware-host/cad/cad_tube.h"
#include "firmware-host/cad/developed.h"

namespace bendloop::host {

// Faces that hang together between the tube's outer and inner surface and belong to neither: the
// sides of what was cut into its wall. What goes all around it (an end, a step) and what stands out
// of it (a branch with its bore) is none.
struct WallCut {
  std::vector<int> faces;
  bool is_through = false;              // from the outer surface to the inner one
  std::vector<Eigen::Vector3d> outer;   // its border on the outer surface
  std::vector<Eigen::Vector3d> inner;   // and on the inner one
  std::vector<Eigen::Vector3d> border;  // of all its faces
  // Of its border on the outer surface: the middle, and how far it reaches both ways.
  Place middle;
  double along_mm = 0, around_mm = 0;
};

std::vector<WallCut> WallCutsOf(const CadBody& body, const CadTube& tube,
                                const Developed& developed);

}  // namespace bendloop::host
