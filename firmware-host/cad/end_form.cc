// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cad/end_form.h"

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

}  // namespace

double FormEndMm(const CadBody& body, const TubePiece& piece, const Vector3d& origin,
                 const Vector3d& outward, double at_mm) {
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
      if (reach.lowest < at_mm - tolerance || reach.widest > kWidestRadii * piece.radius_mm)
        continue;
      if (!seen.insert(face).second) continue;
      farthest = std::max(farthest, reach.highest);
      open.insert(edges_of_face[face].begin(), edges_of_face[face].end());
    }
  }
  return farthest;
}

}  // namespace bendloop::host
