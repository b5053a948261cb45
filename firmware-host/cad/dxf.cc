// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cad/dxf.h"

#include <Eigen/Geometry>
#include <cmath>
#include <cstdio>
#include <numbers>

#include "pipeline/tube/representations.h"

namespace bendloop::host {
namespace {

using Eigen::Vector3d;

class Dxf {
 public:
  std::string text;

  void Word(int code, const std::string& value) {
    text += std::to_string(code) + "\n" + value + "\n";
  }
  void Value(int code, double value) {
    char digits[40];
    std::snprintf(digits, sizeof digits, "%.10f", value == 0 ? 0.0 : value);
    Word(code, digits);
  }
  // Coordinates have the codes `code`, `code` + 10 and `code` + 20.
  void Point(int code, const Vector3d& p) {
    for (int k = 0; k < 3; ++k) Value(code + 10 * k, p(k));
  }
  void Entity(const char* kind, const char* layer) {
    Word(0, kind);
    Word(8, layer);
  }
  void Line(const Vector3d& a, const Vector3d& b) {
    if ((b - a).norm() < 1e-9) return;
    Entity("LINE", "CENTRELINE");
    Point(10, a);
    Point(11, b);
  }

  // An arc lies in a frame that its normal alone says: the "arbitrary axis" of the DXF reference.
  void Arc(const SpineArc& arc) {
    const Vector3d n = arc.normal.normalized();
    const bool near_z = std::abs(n.x()) < 1.0 / 64 && std::abs(n.y()) < 1.0 / 64;
    const Vector3d x = (near_z ? Vector3d::UnitY() : Vector3d::UnitZ()).cross(n).normalized();
    const Vector3d y = n.cross(x);
    const Vector3d d = arc.from - arc.centre;
    const double start = std::atan2(d.dot(y), d.dot(x)) * 180 / std::numbers::pi;
    Entity("ARC", "CENTRELINE");
    Point(10, {arc.centre.dot(x), arc.centre.dot(y), arc.centre.dot(n)});
    Value(40, arc.bend_radius_mm);
    Value(50, start);
    Value(51, start + arc.angle_rad * 180 / std::numbers::pi);
    Point(210, n);
  }

  void Polyline(const std::vector<Vector3d>& points) {
    Entity("POLYLINE", "CORNERS");
    Word(66, "1");
    Point(10, Vector3d::Zero());
    Word(70, "8");
    for (const Vector3d& p : points) {
      Entity("VERTEX", "CORNERS");
      Point(10, p);
      Word(70, "32");
    }
    Entity("SEQEND", "CORNERS");
  }
};

}  // namespace

std::string DxfText(const Spine& spine, const hal::Tube& tube) {
  Dxf dxf;
  dxf.Word(0, "SECTION");
  dxf.Word(2, "HEADER");
  dxf.Word(9, "$ACADVER");
  dxf.Word(1, "AC1009");
  dxf.Word(0, "ENDSEC");
  dxf.Word(0, "SECTION");
  dxf.Word(2, "ENTITIES");
  Vector3d at = spine.start;
  for (const SpineArc& arc : spine.arcs) {
    dxf.Line(at, arc.from);
    dxf.Arc(arc);
    at = arc.to;
  }
  dxf.Line(at, spine.end);
  if (const auto polygon = pipeline::PolygonFromTube(tube)) dxf.Polyline(polygon->points_mm);
  dxf.Word(0, "ENDSEC");
  dxf.Word(0, "EOF");
  return dxf.text;
}

}  // namespace bendloop::host
