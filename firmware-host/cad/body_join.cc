// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cad/body_join.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <iterator>
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
  bool is_single = false;  // its body is this one straight or bend, and what is about its axis
};

// Whether all of them have one centre line.
bool IsSingle(const std::vector<TubePiece>& pieces) {
  return std::all_of(pieces.begin(), pieces.end(), [&](const TubePiece& piece) {
    const TubePiece& first = pieces.front();
    const double tolerance = MatchToleranceMm(first.radius_mm);
    if (piece.is_arc != first.is_arc) return false;
    if (piece.is_arc) return (piece.origin - first.origin).norm() < tolerance;
    const auto beside = [&](double at) {
      return (piece.PointAt(at) - first.origin).cross(first.axis).norm();
    };
    return beside(piece.from) < tolerance && beside(piece.to) < tolerance;
  });
}

void AddSurfaceEnds(CadBody& body, std::size_t index, std::vector<LooseEnd>& ends) {
  RecogniseFreeSurfaces(body);
  std::vector<TubePiece> pieces = PiecesOf(body);
  std::erase_if(pieces, [](const TubePiece& piece) {
    return piece.is_ring() || piece.around_deg() < kFewestAroundDeg;
  });
  const bool is_single = IsSingle(pieces);
  for (const TubePiece& piece : pieces) {
    for (const double along : {piece.from, piece.to}) {
      const Vector3d t = piece.TangentAt(along);
      ends.push_back({index, false, piece.is_arc, piece.concave, piece.radius_mm,
                      piece.PointAt(along), along == piece.to ? t : Vector3d(-t), is_single});
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
          {index, true, false, false, 0, sum / double(curve.size() - 1), Vector3d::Zero(), false});
      continue;
    }
    for (const Vector3d& p : {curve.front(), curve.back()}) {
      ends.push_back({index, true, false, false, 0, p, Vector3d::Zero(), false});
    }
  }
}

bool Meet(const LooseEnd& a, const LooseEnd& b) {
  if (a.is_wire != b.is_wire) return false;
  if (a.is_wire) return (a.point - b.point).norm() < kCurvesMeetMm;
  const double tolerance = MatchToleranceMm(a.radius_mm);
  const bool with_bend = a.is_arc || b.is_arc, singles = a.is_single && b.is_single;
  // Two straights in line may be two parts; those of which each is a body of its own are not.
  if ((!with_bend && !singles) || a.concave != b.concave ||
      std::abs(a.radius_mm - b.radius_mm) >= tolerance / 4 ||
      !PointAtEachOther(a.outward, b.outward)) {
    return false;
  }
  const Vector3d gap = b.point - a.point;
  if (gap.norm() < tolerance) return true;
  const double apart = gap.dot(a.outward);
  return with_bend && singles && std::abs(apart) < kApartRadii * a.radius_mm &&
         (gap - apart * a.outward).norm() < std::max(tolerance, kBesideRadii * a.radius_mm);
}

// Bodies of straights alone stay what they are.
void KeepThoseWithoutBend(const std::vector<LooseEnd>& ends, std::vector<std::size_t>& of) {
  std::vector<bool> bent(of.size(), false);
  for (const LooseEnd& end : ends) {
    if (end.is_arc || end.is_wire) bent[of[end.body]] = true;
  }
  for (std::size_t i = 0; i < of.size(); ++i) {
    if (!bent[of[i]]) of[i] = i;
  }
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
    if (end.is_single) widest = std::max(widest, (kApartRadii + kBesideRadii) * end.radius_mm);
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
  KeepThoseWithoutBend(ends, of);
  return of;
}

// Whether all ends of `body` are ends of `first`, too: the same once more, or its outer surface.
bool IsSameAgain(const std::vector<LooseEnd>& ends, std::size_t first, std::size_t body) {
  const auto is_same = [](const LooseEnd& one, const LooseEnd& other) {
    const double tolerance = MatchToleranceMm(one.radius_mm);
    return !one.is_wire && !other.is_wire && (one.point - other.point).norm() < tolerance &&
           one.outward.dot(other.outward) > 0 &&
           std::abs(one.radius_mm - other.radius_mm) < tolerance / 4;
  };
  return std::all_of(ends.begin(), ends.end(), [&](const LooseEnd& one) {
    return one.body != body || std::any_of(ends.begin(), ends.end(), [&](const LooseEnd& other) {
             return other.body == first && is_same(one, other);
           });
  });
}

// Circles alone have none: a pipe's profile.
bool HasEnds(const CadBody& body) {
  return body.kind != BodyKind::kWire ||
         std::any_of(body.curves.begin(), body.curves.end(), [](const auto& curve) {
           return curve.size() > 1 && (curve.front() - curve.back()).norm() >= kCurvesMeetMm;
         });
}

void Append(CadBody& to, CadBody&& from) {
  // Pieces of one assembly with names of their own are what the assembly is called.
  if (to.name != from.name && to.assembly == from.assembly && !to.assembly.empty()) {
    to.name = to.assembly;
    to.occurrence.clear();
  }
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
      if (HasEnds(shape.bodies[i])) {
        ++(IsSameAgain(ends, of[i], i) ? whole.repeated : whole.joined);
      }
      Append(whole, std::move(shape.bodies[i]));
    }
  }
  shape.bodies = std::move(joined);
}

}  // namespace bendloop::host
