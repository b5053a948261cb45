// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cad/body_join.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <iterator>
#include <numbers>
#include <numeric>
#include <utility>

#include "firmware-host/cad/near_surface.h"
#include "firmware-host/cad/tube_piece.h"

namespace bendloop::host {
namespace {

using Eigen::Vector3d;

// Curves of one centre line meet to this [mm], which a file in metres with 5 decimals holds.
constexpr double kCurvesMeetMm = 0.01;

// An end of a body's straight, bend or curve.
struct LooseEnd {
  std::size_t body = 0;
  bool is_wire = false, is_arc = false, concave = false;
  double radius_mm = 0;
  Vector3d point, outward;
};

void AddSurfaceEnds(CadBody& body, std::size_t index, std::vector<LooseEnd>& ends) {
  RecogniseFreeSurfaces(body);
  for (const TubePiece& piece : PiecesOf(body)) {
    if (piece.is_ring() || piece.around_deg() < kFewestAroundDeg) continue;
    for (const double along : {piece.from, piece.to}) {
      const Vector3d t = piece.TangentAt(along);
      ends.push_back({index, false, piece.is_arc, piece.concave, piece.radius_mm,
                      piece.PointAt(along), along == piece.to ? t : Vector3d(-t)});
    }
  }
}

void AddCurveEnds(const CadBody& body, std::size_t index, std::vector<LooseEnd>& ends) {
  for (const auto& curve : body.curves) {
    if (curve.size() < 2) continue;
    if ((curve.front() - curve.back()).norm() < kCurvesMeetMm) {
      // A pipe's profile, whose middle lies where its centre line ends.
      const Vector3d sum = std::accumulate(curve.begin() + 1, curve.end(), Vector3d(0, 0, 0));
      ends.push_back(
          {index, true, false, false, 0, sum / double(curve.size() - 1), Vector3d::Zero()});
      continue;
    }
    for (const Vector3d& p : {curve.front(), curve.back()}) {
      ends.push_back({index, true, false, false, 0, p, Vector3d::Zero()});
    }
  }
}

bool Meet(const LooseEnd& a, const LooseEnd& b) {
  if (a.is_wire != b.is_wire) return false;
  if (a.is_wire) return (a.point - b.point).norm() < kCurvesMeetMm;
  const double tolerance = MatchToleranceMm(a.radius_mm);
  return (a.is_arc || b.is_arc) && a.concave == b.concave &&
         (a.point - b.point).norm() < tolerance &&
         std::abs(a.radius_mm - b.radius_mm) < tolerance / 4 && a.outward.dot(b.outward) < 0 &&
         a.outward.cross(b.outward).norm() < std::sin(kKinkDeg * std::numbers::pi / 180);
}

// Of each body the first one that it is joined to, itself if to none before it.
std::vector<std::size_t> Groups(const std::vector<LooseEnd>& ends, std::size_t bodies) {
  std::vector<std::size_t> of(bodies);
  std::iota(of.begin(), of.end(), 0);
  // Sorted along x, only neighbours need to be compared.
  std::vector<const LooseEnd*> sorted;
  double widest = kCurvesMeetMm;
  for (const LooseEnd& end : ends) {
    sorted.push_back(&end);
    widest = std::max(widest, MatchToleranceMm(end.radius_mm));
  }
  std::stable_sort(sorted.begin(), sorted.end(), [](const LooseEnd* a, const LooseEnd* b) {
    return a->point.x() < b->point.x();
  });
  for (std::size_t i = 0; i < sorted.size(); ++i) {
    for (std::size_t j = i + 1;
         j < sorted.size() && sorted[j]->point.x() - sorted[i]->point.x() <= widest; ++j) {
      const std::size_t a = of[sorted[i]->body], b = of[sorted[j]->body];
      if (a != b && Meet(*sorted[i], *sorted[j])) {
        std::replace(of.begin(), of.end(), std::max(a, b), std::min(a, b));
      }
    }
  }
  return of;
}

// Circles alone have none: a pipe's profile.
bool HasEnds(const CadBody& body) {
  return body.kind != BodyKind::kWire ||
         std::any_of(body.curves.begin(), body.curves.end(), [](const auto& curve) {
           return curve.size() > 1 && (curve.front() - curve.back()).norm() >= kCurvesMeetMm;
         });
}

void Append(CadBody& to, CadBody&& from) {
  int edges = 0;
  for (const FaceEdge& edge : to.edges) edges = std::max(edges, edge.edge);
  for (SurfacePatch& patch : from.patches) {
    patch.face += to.faces;
    to.patches.push_back(std::move(patch));
  }
  for (FaceEdge& edge : from.edges) {
    edge.face += to.faces;
    edge.edge += edges;
    to.edges.push_back(std::move(edge));
  }
  to.faces += from.faces;
  to.recognised = to.recognised && from.recognised;
  std::move(from.curves.begin(), from.curves.end(), std::back_inserter(to.curves));
  if (to.kind != from.kind) to.kind = BodyKind::kSurface;
}

}  // namespace

void JoinBodies(CadShape& shape) {
  if (shape.bodies.size() < 2) return;
  std::vector<LooseEnd> ends;
  for (std::size_t i = 0; i < shape.bodies.size(); ++i) {
    CadBody& body = shape.bodies[i];
    if (body.kind == BodyKind::kWire) {
      AddCurveEnds(body, i, ends);
    } else {
      AddSurfaceEnds(body, i, ends);
    }
  }
  const std::vector<std::size_t> of = Groups(ends, shape.bodies.size());
  std::vector<CadBody> joined;
  std::vector<std::size_t> place(of.size());
  for (std::size_t i = 0; i < of.size(); ++i) {
    if (of[i] == i) {
      place[i] = joined.size();
      joined.push_back(std::move(shape.bodies[i]));
    } else {
      CadBody& whole = joined[place[of[i]]];
      if (HasEnds(shape.bodies[i])) ++whole.joined;
      Append(whole, std::move(shape.bodies[i]));
    }
  }
  shape.bodies = std::move(joined);
}

}  // namespace bendloop::host
