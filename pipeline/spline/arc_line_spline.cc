// SPDX-License-Identifier: Apache-2.0
#include "pipeline/spline/arc_line_spline.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "hal/angles.h"

namespace bendloop::pipeline {

hal::Tube TubeFromSpline(const ArcLineSpline& spline, double pipe_radius_mm) {
  hal::Tube tube;
  tube.pipe_radius_mm = pipe_radius_mm;
  Eigen::Vector3d tangent = spline.tangent;
  Eigen::Vector3d normal =
      spline.arcs.empty() ? tangent.unitOrthogonal() : spline.arcs.front().normal;
  normal = (normal - normal.dot(tangent) * tangent).normalized();
  Eigen::Matrix3d axes;
  axes.col(0) = tangent;
  axes.col(1) = normal.cross(tangent);
  axes.col(2) = normal;
  tube.X_WT = {spline.start_mm, Eigen::Quaterniond(axes).normalized()};

  Eigen::Vector3d from = spline.start_mm;
  for (const SplineArc& arc : spline.arcs) {
    hal::BendRow row;
    row.length_mm = std::max(0.0, (arc.begin_mm - from).dot(arc.tangent_in));
    if (!tube.program.rows.empty()) {
      // Signed triple product over dot product: keeps the sign that acos would lose.
      row.rotation_deg =
          hal::kDegreesPerRadian *
          std::atan2(normal.cross(arc.normal).dot(arc.tangent_in), normal.dot(arc.normal));
    }
    row.angle_deg = hal::kDegreesPerRadian * arc.angle_rad;
    row.bend_radius_mm = arc.radius_mm;
    tube.program.rows.push_back(row);
    from = arc.end_mm;
    tangent = arc.tangent_out;
    normal = arc.normal;
  }
  tube.program.rows.push_back(
      {std::max(0.0, (spline.end_mm - from).dot(tangent)), 0.0, 0.0, std::nullopt});
  return tube;
}

}  // namespace bendloop::pipeline
