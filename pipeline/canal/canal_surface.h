// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

namespace bendloop::pipeline {

// Where a point belongs on a canal surface.
struct CanalFoot {
  double t = 0;            // parameter of the sphere that is nearest
  double distance_mm = 0;  // from the surface, outside positive
  bool beyond = false;     // the nearest sphere would lie beyond an end
};

// The envelope of spheres whose centres and radii are a uniform cubic B-spline of one parameter,
// t in [0, spans()]. Control points are (x, y, z, radius) [mm].
// Source: Lee & Kim 2004, section 3.
class CanalSurface {
 public:
  CanalSurface() : control_(4, Eigen::Vector4d::Zero()) {}
  // At least 4 control points.
  explicit CanalSurface(std::vector<Eigen::Vector4d> control) : control_(std::move(control)) {}

  // The spline of `spans` spans next to the points, which follow each other along the spine.
  static CanalSurface Through(std::span<const Eigen::Vector4d> points, int spans);

  int spans() const { return static_cast<int>(control_.size()) - 3; }
  const std::vector<Eigen::Vector4d>& control() const { return control_; }
  std::vector<Eigen::Vector4d>& control() { return control_; }

  // First control point of the span that holds t, and the weights of it and the next three.
  static int Span(double t, int spans, Eigen::Vector4d& weights);
  Eigen::Vector4d At(double t) const { return Blend(t, 0); }
  Eigen::Vector4d DerivativeAt(double t) const { return Blend(t, 1); }
  Eigen::Vector4d SecondAt(double t) const { return Blend(t, 2); }

  // The foot near `guess`, by Newton's method on |P - C(t)| - r(t).
  CanalFoot FootNear(const Eigen::Vector3d& point, double guess) const;
  // Arc length of the spine at `steps` + 1 evenly spaced parameters.
  std::vector<double> ArcLengths(int steps) const;
  // Largest curvature of the spine [1/mm] between the parameters.
  double MaxCurvature(double from, double to) const;

 private:
  Eigen::Vector4d Blend(double t, int derivative) const;

  std::vector<Eigen::Vector4d> control_;
};

}  // namespace bendloop::pipeline
