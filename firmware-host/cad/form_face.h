// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <map>
#include <optional>
#include <vector>

#include "firmware-host/cad/cad_shape.h"

namespace bendloop::host {

// Where an end points: lengths along `outward` (unit) count from `origin`, on the end's axis.
struct EndView {
  Eigen::Vector3d origin, outward;

  double Along(const Eigen::Vector3d& p) const { return (p - origin).dot(outward); }
  double Across(const Eigen::Vector3d& p) const { return (p - origin - Along(p) * outward).norm(); }
};

// How far something goes along and across an end's axis.
struct Reach {
  double lowest = INFINITY, highest = -INFINITY, widest = 0;

  void Add(double along, double across);
  void Add(const Reach& other);
};

Reach ReachOf(const FaceEdge& edge, const EndView& view);

// A face beyond an end.
struct FormFace {
  std::vector<const FaceEdge*> edges;
  std::vector<const SurfacePatch*> patches;  // none: a plane
};

// The faces of a body by their numbers.
std::map<int, FormFace> FormFacesOf(const CadBody& body);

// How far the face reaches: its edges, and what its surface has between them, as a dome's tip.
Reach ReachOf(const FormFace& face, const EndView& view);

// Where a face lies over an end's axis.
struct AxisHit {
  double along_mm = 0;
  bool is_plane = false;
  bool is_blunt = false;  // no plane, and square to the axis there, as a dome and unlike a cone
};

// Nothing where the face does not lie over the axis, as an annulus.
std::optional<AxisHit> OverAxis(const FormFace& face, const EndView& view, double tolerance_mm);

}  // namespace bendloop::host
