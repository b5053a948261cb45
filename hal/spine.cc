// SPDX-License-Identifier: Apache-2.0
#include "hal/spine.h"

#include <cmath>

#include "hal/angles.h"

namespace bendloop::hal {

Eigen::Matrix3d SpineSegment::axes() const {
  Eigen::Matrix3d columns;
  columns << tangent, normal.cross(tangent), normal;
  return columns;
}

Eigen::Vector3d SpineSegment::PointAt(double along_mm) const {
  if (!is_arc()) return start_mm + along_mm * tangent;
  const double phi = along_mm / bend_radius_mm;
  return start_mm +
         bend_radius_mm * (std::sin(phi) * tangent + (1.0 - std::cos(phi)) * normal.cross(tangent));
}

Eigen::Vector3d SpineSegment::TangentAt(double along_mm) const {
  if (!is_arc()) return tangent;
  const double phi = along_mm / bend_radius_mm;
  return std::cos(phi) * tangent + std::sin(phi) * normal.cross(tangent);
}

std::vector<SpineSegment> SpineSegments(const BendProgram& program, const Pose& X_WT) {
  std::vector<SpineSegment> segments;
  if (program.rows.empty()) return segments;
  segments.reserve(2 * program.rows.size() - 1);
  Eigen::Vector3d point = X_WT.position_mm;
  Eigen::Vector3d tangent = X_WT.orientation * Eigen::Vector3d::UnitX();
  Eigen::Vector3d normal = X_WT.orientation * Eigen::Vector3d::UnitZ();
  double from_start_mm = 0;
  for (std::size_t i = 0; i < program.rows.size(); ++i) {
    const BendRow& row = program.rows[i];
    const Eigen::AngleAxisd turn(row.rotation_deg * kRadiansPerDegree, tangent);
    normal = (turn * normal).normalized();
    segments.push_back({point, tangent, normal, row.length_mm, 0.0, from_start_mm});
    point = segments.back().PointAt(row.length_mm);
    from_start_mm += row.length_mm;
    if (i + 1 == program.rows.size()) break;
    const double radius_mm = row.bend_radius_mm.value_or(0.0);
    const double arc_mm = radius_mm * row.angle_deg * kRadiansPerDegree;
    segments.push_back({point, tangent, normal, arc_mm, radius_mm, from_start_mm});
    point = segments.back().PointAt(arc_mm);
    tangent = segments.back().TangentAt(arc_mm).normalized();
    from_start_mm += arc_mm;
  }
  return segments;
}

double SpineLength(const BendProgram& program) {
  double length_mm = 0;
  for (const BendRow& row : program.rows) {
    length_mm +=
        row.length_mm + row.bend_radius_mm.value_or(0.0) * row.angle_deg * kRadiansPerDegree;
  }
  return length_mm;
}

}  // namespace bendloop::hal
