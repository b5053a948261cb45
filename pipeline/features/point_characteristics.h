// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

#include "hal/result.h"
#include "pipeline/math/workers.h"
#include "pipeline/points/point_index.h"

namespace bendloop::pipeline {

// What one point says about the surface around it.
struct PointCharacteristics {
  Eigen::Vector3d normal = Eigen::Vector3d::Zero();  // unit, sign arbitrary; zero: too few around
  // [rad] The most that normals of neighbours differ from it: rapid variation of the normal.
  double normal_turn = 0;
  // [rad] The widest sector of the tangent plane without neighbours: above pi at an edge of the
  // cloud, where the surface was cut, drilled or not seen.
  double gap = 0;
  double off_plane_mm = 0;  // rms of the neighbours off their plane
  double concavity_mm = 0;  // smallest distance to the convex hull: the paper's concavity intensity
};

// Normals by principal components of the neighbours within `reach_mm`; then what is read off them.
// Concavity is left 0. The index is of the same points.
std::vector<PointCharacteristics> CharacteriseSurface(std::span<const Eigen::Vector3d> points_mm,
                                                      const PointIndex& index, double reach_mm,
                                                      Workers* workers);

// The smallest distance of each point to the convex hull of all. kBadInput when they span no body
// (all in a plane, a line or a place).
// Source: Stamati & Fudos 2008, section 2. The hull is Qhull's (README.md says why).
hal::Result<std::vector<double>> ConcavityMm(std::span<const Eigen::Vector3d> points_mm,
                                             Workers* workers);

}  // namespace bendloop::pipeline
