// SPDX-License-Identifier: Apache-2.0
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "firmware-host/cad/tube_chain.h"

namespace bendloop::host {
namespace {

using Eigen::Vector3d;

double Deg(double rad) { return rad * 180 / std::numbers::pi; }

double RotationDeg(const SpineArc& before, const SpineArc& arc) {
  const Vector3d& t = arc.tangent_in;
  const double angle =
      std::atan2(before.normal.cross(arc.normal).dot(t), before.normal.dot(arc.normal));
  return hal::WrapRotationDeg(Deg(angle));
}

}  // namespace

double Spine::length_mm() const {
  double length = 0;
  Vector3d at = start;
  for (const SpineArc& arc : arcs) {
    length += (arc.from - at).norm() + arc.bend_radius_mm * arc.angle_rad;
    at = arc.to;
  }
  return length + (end - at).norm();
}

Vector3d Spine::OutwardAt(bool is_first) const {
  const Vector3d& own = is_first ? start_outward : end_outward;
  if (!own.isZero(0.0)) return own;
  return is_first ? Vector3d(-direction) : end_direction();
}

Spine Spine::Reversed() const {
  Spine other;
  other.start = end;
  other.end = start;
  other.direction = -end_direction();
  other.start_outward = end_outward;
  other.end_outward = start_outward;
  for (auto arc = arcs.rbegin(); arc != arcs.rend(); ++arc) {
    SpineArc turned = *arc;
    std::swap(turned.from, turned.to);
    turned.tangent_in = -arc->tangent_out;
    turned.tangent_out = -arc->tangent_in;
    turned.normal = -arc->normal;
    other.arcs.push_back(turned);
  }
  return other;
}

hal::Tube TubeFromSpine(const Spine& spine, double pipe_radius_mm) {
  constexpr double kRoundingMm = 0.01;
  const auto straight = [](double length_mm) {
    return length_mm < 0 && length_mm > -kRoundingMm ? 0 : length_mm;
  };
  hal::Tube tube;
  tube.pipe_radius_mm = pipe_radius_mm;
  Vector3d at = spine.start, along = spine.direction;
  for (std::size_t i = 0; i < spine.arcs.size(); ++i) {
    const SpineArc& arc = spine.arcs[i];
    hal::BendRow row;
    row.length_mm = straight((arc.from - at).dot(along));
    row.rotation_deg = i == 0 ? 0 : RotationDeg(spine.arcs[i - 1], arc);
    row.angle_deg = Deg(arc.angle_rad);
    row.bend_radius_mm = arc.bend_radius_mm;
    tube.program.rows.push_back(row);
    at = arc.to;
    along = arc.tangent_out;
  }
  hal::BendRow last;
  last.length_mm = straight((spine.end - at).dot(along));
  tube.program.rows.push_back(last);
  const Vector3d x = spine.direction.normalized();
  Vector3d z = spine.arcs.empty() ? Vector3d(x.unitOrthogonal()) : spine.arcs.front().normal;
  z = (z - z.dot(x) * x).normalized();
  Eigen::Matrix3d frame;
  frame << x, z.cross(x), z;
  tube.X_WT = {spine.start, Eigen::Quaterniond(frame)};
  return tube;
}

Spine SpineOf(const hal::Tube& tube) {
  Spine spine;
  Vector3d at = tube.X_WT.position_mm;
  Eigen::Matrix3d frame = tube.X_WT.orientation.toRotationMatrix();  // tangent, across, normal
  spine.start = at;
  spine.direction = frame.col(0);
  for (const hal::BendRow& row : tube.program.rows) {
    at += row.length_mm * frame.col(0);
    if (!row.bend_radius_mm || row.angle_deg == 0) continue;
    frame = frame * Eigen::AngleAxisd(row.rotation_deg * std::numbers::pi / 180, Vector3d::UnitX());
    SpineArc arc;
    arc.bend_radius_mm = *row.bend_radius_mm;
    arc.angle_rad = row.angle_deg * std::numbers::pi / 180;
    arc.normal = frame.col(2);
    arc.centre = at + arc.bend_radius_mm * frame.col(1);
    arc.from = at;
    arc.tangent_in = frame.col(0);
    const Eigen::AngleAxisd turn(arc.angle_rad, arc.normal);
    at = arc.centre + turn * (at - arc.centre);
    frame = turn * frame;
    arc.to = at;
    arc.tangent_out = frame.col(0);
    spine.arcs.push_back(arc);
  }
  spine.end = at;
  return spine;
}

}  // namespace bendloop::host
