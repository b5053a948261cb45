// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cad/form_face.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <numbers>

#include "firmware-host/cad/free_surface.h"

namespace bendloop::host {
namespace {

using Eigen::Vector3d;

// Where a surface is this near to square to the axis [cosine], it is no cone's point.
constexpr double kBluntCosine = 0.98;

// Whether the face's border goes around `p`, seen along the axis, or through it.
bool BorderIsAround(const FormFace& face, const Vector3d& p, const EndView& view,
                    double tolerance_mm) {
  const Vector3d x = view.outward.unitOrthogonal(), y = view.outward.cross(x);
  bool inside = false;
  for (const FaceEdge* edge : face.edges) {
    for (std::size_t i = 0; i < edge->points.size(); ++i) {
      const Vector3d from = edge->points[i > 0 ? i - 1 : 0] - p, to = edge->points[i] - p;
      const Eigen::Vector2d a(from.dot(x), from.dot(y)), b(to.dot(x), to.dot(y)), d = b - a;
      const double length_2 = d.squaredNorm();
      const double nearest = length_2 > 0 ? std::clamp(-a.dot(d) / length_2, 0.0, 1.0) : 0;
      if ((a + nearest * d).norm() < tolerance_mm) return true;
      if ((a.y() > 0) != (b.y() > 0) && a.x() - a.y() * d.x() / d.y() > 0) inside = !inside;
    }
  }
  return inside;
}

// Of a patch that is a sphere, by this name or another: all of its normals meet in the centre. Of a
// hollow that opens outwards it is the bottom: the pole on the side where the face lies.
std::optional<Vector3d> SphereTip(const SurfacePatch& patch, const EndView& view) {
  if (patch.kind != PatchKind::kFree || patch.samples.empty()) return std::nullopt;
  Vector3d point = Vector3d::Zero(), normal = Vector3d::Zero();
  const double count = double(patch.samples.size());
  for (const OrientedPoint& s : patch.samples) {
    point += s.point / count;
    normal += s.normal / count;
  }
  double together = 0, spread = 0;
  for (const OrientedPoint& s : patch.samples) {
    together += (s.point - point).dot(s.normal - normal);
    spread += (s.normal - normal).squaredNorm();
  }
  if (!(spread > 0)) return std::nullopt;
  const double radius = together / spread;  // negative where the material is outside
  const Vector3d centre = point - radius * normal;
  for (const OrientedPoint& s : patch.samples) {
    if (std::abs((s.point - centre).norm() - std::abs(radius)) > kExactSurfaceMm) {
      return std::nullopt;
    }
  }
  double side = 0;
  for (const OrientedPoint& s : patch.samples) {
    if (s.in_face) side += (s.point - centre).dot(view.outward);
  }
  return centre + std::copysign(radius, side) * view.outward;
}

// The circle on which a torus about the axis, as of a rounded edge, lies farthest out.
void AddTopOfTorus(const SurfacePatch& patch, const EndView& view, Reach& reach) {
  if (patch.kind != PatchKind::kTorus) return;
  constexpr double kParallel = 1e-4;
  if (patch.axis.cross(view.outward).norm() > kParallel ||
      view.Across(patch.origin) > kParallel * patch.bend_radius_mm + kExactSurfaceMm) {
    return;
  }
  const double top =
      patch.axis.dot(view.outward) > 0 ? std::numbers::pi / 2 : -std::numbers::pi / 2;
  const double turn = 2 * std::numbers::pi;
  const double beyond_v0 = top - patch.v0 - std::floor((top - patch.v0) / turn) * turn;
  if (beyond_v0 > patch.v1 - patch.v0) return;
  reach.Add(view.Along(patch.origin) + patch.radius_mm, patch.bend_radius_mm);
}

}  // namespace

void Reach::Add(double along, double across) {
  lowest = std::min(lowest, along);
  highest = std::max(highest, along);
  widest = std::max(widest, across);
}

void Reach::Add(const Reach& other) {
  lowest = std::min(lowest, other.lowest);
  highest = std::max(highest, other.highest);
  widest = std::max(widest, other.widest);
}

Reach ReachOf(const FaceEdge& edge, const EndView& view) {
  Reach reach;
  for (const Vector3d& p : edge.points) reach.Add(view.Along(p), view.Across(p));
  return reach;
}

std::map<int, FormFace> FormFacesOf(const CadBody& body) {
  std::map<int, FormFace> faces;
  for (const FaceEdge& edge : body.edges) faces[edge.face].edges.push_back(&edge);
  for (const SurfacePatch& patch : body.patches) faces[patch.face].patches.push_back(&patch);
  return faces;
}

Reach ReachOf(const FormFace& face, const EndView& view) {
  Reach reach;
  for (const FaceEdge* edge : face.edges) reach.Add(ReachOf(*edge, view));
  for (const SurfacePatch* patch : face.patches) {
    for (const OrientedPoint& s : patch->samples) {
      if (s.in_face) reach.Add(view.Along(s.point), view.Across(s.point));
    }
    AddTopOfTorus(*patch, view, reach);
    const auto tip = SphereTip(*patch, view);
    if (tip && BorderIsAround(face, *tip, view, kExactSurfaceMm)) {
      reach.Add(view.Along(*tip), view.Across(*tip));
    }
  }
  return reach;
}

std::optional<AxisHit> OverAxis(const FormFace& face, const EndView& view, double tolerance_mm) {
  if (!BorderIsAround(face, view.origin, view, tolerance_mm)) return std::nullopt;
  AxisHit hit;
  hit.is_plane = face.patches.empty();
  double nearest = INFINITY;
  const auto take = [&](const Vector3d& p) {
    const double across = view.Across(p);
    if (across >= nearest) return false;
    nearest = across;
    hit.along_mm = view.Along(p);
    return true;
  };
  for (const SurfacePatch* patch : face.patches) {
    for (const OrientedPoint& s : patch->samples) {
      if (s.in_face && take(s.point)) {
        hit.is_blunt = patch->name != "cone" && std::abs(s.normal.dot(view.outward)) > kBluntCosine;
      }
    }
  }
  for (const SurfacePatch* patch : face.patches) {
    if (const auto tip = SphereTip(*patch, view)) take(*tip);
  }
  for (const FaceEdge* edge : face.edges) {
    for (const Vector3d& p : edge->points) take(p);
  }
  return hit;
}

}  // namespace bendloop::host
