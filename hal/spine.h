// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <vector>

#include "hal/bend_program.h"
#include "hal/pose.h"

namespace bendloop::hal {

// A line or circular arc of the spine, the tube's centre line (an arc-line spline is G1: each
// segment starts where and in the direction in which the one before it ends).
// Source: Bauer & Polthier 2009, section 5.3.
struct SpineSegment {
  Eigen::Vector3d start_mm = Eigen::Vector3d::Zero();
  Eigen::Vector3d tangent = Eigen::Vector3d::UnitX();  // unit, at the start
  Eigen::Vector3d normal = Eigen::Vector3d::UnitZ();   // unit, t_in x t_out of this or the next arc
  double length_mm = 0;
  double bend_radius_mm = 0;  // 0: a line
  double from_start_mm = 0;   // arc length of the spine up to here

  bool is_arc() const { return bend_radius_mm > 0; }
  double angle_rad() const { return is_arc() ? length_mm / bend_radius_mm : 0.0; }
  // Its frame at the start, as columns: tangent, normal x tangent, normal.
  Eigen::Matrix3d axes() const;
  Eigen::Vector3d center_mm() const { return start_mm + bend_radius_mm * normal.cross(tangent); }
  // `along_mm` in [0, length_mm]; beyond it the line or circle goes on.
  Eigen::Vector3d PointAt(double along_mm) const;
  Eigen::Vector3d TangentAt(double along_mm) const;
};

// line, arc, line, arc, ..., line: 2 n + 1 segments for n bends, in the frame that X_WT leads to.
// Bends without a radius or with angle 0 get an arc of length 0.
std::vector<SpineSegment> SpineSegments(const BendProgram& program, const Pose& X_WT);

// Length of the whole spine [mm].
double SpineLength(const BendProgram& program);

}  // namespace bendloop::hal
