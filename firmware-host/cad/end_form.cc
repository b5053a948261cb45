// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cad/end_form.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <vector>

namespace bendloop::host {
namespace {

using Eigen::Vector3d;

// An end's form is no wider than so many pipe radii; what is wider is another part.
constexpr double kWidestRadii = 3;

struct Reach {
  double lowest = INFINITY, highest = -INFINITY, widest = 0;
};

Reach ReachOf(const FaceEdge& edge, const Vector3d& origin, const Vector3d& outward) {
  Reach reach;
  for (const Vector3d& p : edge.points) {
    const double along = (p - origin).dot(outward);
    reach.lowest = std::min(reach.lowest, along);
    reach.highest = std::max(reach.highest, along);
    reach.widest = std::max(reach.widest, (p - origin - along * outward).norm());
  }
  return reach;
}

// Where a chain ends, and what it has about it there.
struct Mouth {
  Vector3d at, outward;
  double radius_mm = 0;
};

Mouth MouthOf(const std::vector<TubePiece>& pieces, const TubeChain& chain, const ChainEnd& end) {
  const TubePiece& piece = pieces[std::size_t(end.piece)];
  const double along = end.at_to ? piece.to : piece.from;
  return {piece.PointAt(along), (end.at_to ? 1 : -1) * piece.TangentAt(along), chain.radius_mm};
}

bool Touches(const SurfacePatch& patch, const Mouth& mouth) {
  const double tolerance = 2 * MatchToleranceMm(mouth.radius_mm);
  return std::any_of(patch.samples.begin(), patch.samples.end(), [&](const OrientedPoint& s) {
    const Vector3d d = s.point - mouth.at;
    const double axial = d.dot(mouth.outward);
    return std::abs(axial) < tolerance &&
           std::abs((d - axial * mouth.outward).norm() - mouth.radius_mm) < tolerance;
  });
}

// `faces`, and those of `among` that share edges with them, and so on.
void GrowFaces(const CadBody& body, const std::set<int>& among, std::set<int>& faces) {
  std::map<int, std::vector<int>> faces_of_edge;
  for (const FaceEdge& edge : body.edges) {
    if (among.contains(edge.face)) faces_of_edge[edge.edge].push_back(edge.face);
  }
  for (bool grew = true; grew;) {
    grew = false;
    for (const auto& [edge, of] : faces_of_edge) {
      const auto known = [&](int face) { return faces.contains(face); };
      if (std::none_of(of.begin(), of.end(), known)) continue;
      for (const int face : of) grew |= faces.insert(face).second;
    }
  }
}

}  // namespace

bool IsFreeForm(const SurfacePatch& patch) {
  return patch.kind == PatchKind::kFree && patch.name != "cone" && patch.name != "sphere";
}

FreeForm FreeFormBeyond(const CadBody& body, const std::vector<TubePiece>& pieces,
                        const std::vector<TubeChain>& chains, const TubeChain& chain,
                        const ChainEnd& end) {
  const Mouth mouth = MouthOf(pieces, chain, end);
  std::set<int> free, faces;
  for (const SurfacePatch& patch : body.patches) {
    if (!IsFreeForm(patch)) continue;
    free.insert(patch.face);
    if (Touches(patch, mouth)) faces.insert(patch.face);
  }
  FreeForm form;
  if (faces.empty()) return form;
  GrowFaces(body, free, faces);
  for (const SurfacePatch& patch : body.patches) {
    if (!IsFreeForm(patch) || !faces.contains(patch.face)) continue;
    form.name = patch.name;
    for (const OrientedPoint& s : patch.samples) {
      const Vector3d d = s.point - mouth.at;
      form.reach_mm = std::max(form.reach_mm, d.norm());
      form.across_mm = std::max(form.across_mm, d.cross(mouth.outward).norm());
    }
    for (const TubeChain& other : chains) {
      if (std::abs(other.radius_mm - chain.radius_mm) > MatchToleranceMm(chain.radius_mm)) continue;
      for (const ChainEnd* at : {&other.first, &other.last}) {
        const bool same = at->piece == end.piece && at->at_to == end.at_to;
        form.leads_on |= !same && Touches(patch, MouthOf(pieces, other, *at));
      }
    }
  }
  return form;
}

double FormEndMm(const CadBody& body, const TubePiece& piece, const Vector3d& origin,
                 const Vector3d& outward, double at_mm, const std::set<int>& others) {
  const double tolerance = MatchToleranceMm(piece.radius_mm);
  std::map<int, Reach> faces;
  std::map<int, std::vector<int>> faces_of_edge, edges_of_face;
  std::set<int> open;  // edges from which the form goes on
  for (const FaceEdge& edge : body.edges) {
    const Reach reach = ReachOf(edge, origin, outward);
    Reach& face = faces[edge.face];
    face.lowest = std::min(face.lowest, reach.lowest);
    face.highest = std::max(face.highest, reach.highest);
    face.widest = std::max(face.widest, reach.widest);
    faces_of_edge[edge.edge].push_back(edge.face);
    edges_of_face[edge.face].push_back(edge.edge);
    const bool at_end = reach.lowest > at_mm - tolerance && reach.highest < at_mm + tolerance;
    if (at_end && reach.widest < piece.radius_mm + tolerance) open.insert(edge.edge);
  }
  std::set<int> seen;
  double farthest = at_mm;
  while (!open.empty()) {
    const int edge = *open.begin();
    open.erase(open.begin());
    for (const int face : faces_of_edge[edge]) {
      const Reach& reach = faces[face];
      if (reach.lowest < at_mm - tolerance || reach.widest > kWidestRadii * piece.radius_mm ||
          others.contains(face)) {
        continue;
      }
      if (!seen.insert(face).second) continue;
      farthest = std::max(farthest, reach.highest);
      open.insert(edges_of_face[face].begin(), edges_of_face[face].end());
    }
  }
  return farthest;
}

}  // namespace bendloop::host
