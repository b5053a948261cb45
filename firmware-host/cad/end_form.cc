// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cad/end_form.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <set>
#include <utility>
#include <vector>

namespace bendloop::host {
namespace {

using Eigen::Vector3d;

// An end's form is no wider than so many pipe radii; what is wider is another part.
constexpr double kWidestRadii = 3;

// A free surface that goes on beyond an end by more pipe radii than this is a bend, else the end's
// form; or by more than the second, where it keeps as near to the axis as an end that is pressed
// flat, from the middle (pi / 2) or to one side (1.9).
constexpr double kEndFormRadii = 4, kFlatFormRadii = 20, kFlatAcrossRadii = 2;

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

// A face beyond an end.
struct BeyondFace {
  const FormFace* face;
  double highest_mm;
  bool is_narrow;  // no wider than the tube, and beside nothing that is
  bool is_over_axis;
};

// Whether faces go around the axis by half a turn and more, or lie over it.
bool GoAround(const std::vector<BeyondFace>& faces, const EndView& view) {
  Around around;
  for (const BeyondFace& of : faces) {
    if (of.is_over_axis) return true;
    for (const FaceEdge* edge : of.face->edges) {
      AddAround(edge->points, view.origin, view.outward, around);
    }
  }
  return 2 * around.count() >= around.size();
}

// How far the form goes on: to where what reaches as far is as narrow as the tube, as the tip of
// one that is milled, or goes around the axis; a plate beside it does neither.
double HighestOf(std::vector<BeyondFace> faces, const EndView& view, double at_mm,
                 double tolerance_mm) {
  std::sort(faces.begin(), faces.end(),
            [](const BeyondFace& a, const BeyondFace& b) { return a.highest_mm > b.highest_mm; });
  std::vector<BeyondFace> as_far;
  bool is_narrow = true;
  for (std::size_t i = 0; i < faces.size(); ++i) {
    as_far.push_back(faces[i]);
    is_narrow = is_narrow && faces[i].is_narrow;
    const bool is_last =
        i + 1 == faces.size() || faces[i + 1].highest_mm < faces[i].highest_mm - tolerance_mm;
    if (is_last && (is_narrow || GoAround(as_far, view))) return as_far.front().highest_mm;
    // What reaches less far is looked at by itself.
    if (is_last) {
      as_far.clear();
      is_narrow = true;
    }
  }
  return at_mm;
}

// What lies over the axis lower than `least_mm` is the bottom of something hollow.
EndCover CoverOf(const AxisHit& hit, double least_mm) {
  if (hit.is_plane || hit.along_mm < least_mm) return EndCover::kFlat;
  return hit.is_blunt ? EndCover::kDome : EndCover::kPoint;
}

}  // namespace

bool FreeForm::is_end_form(double pipe_radius_mm) const {
  if (name.empty() || leads_on) return false;
  return reach_mm <= kEndFormRadii * pipe_radius_mm ||
         (reach_mm <= kFlatFormRadii * pipe_radius_mm &&
          across_mm <= kFlatAcrossRadii * pipe_radius_mm);
}

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
  form.at = mouth.at;
  if (faces.empty()) return form;
  GrowFaces(body, free, faces);
  for (const SurfacePatch& patch : body.patches) {
    if (!IsFreeForm(patch) || !faces.contains(patch.face)) continue;
    form.name = patch.name;
    for (const OrientedPoint& s : patch.samples) {
      if (!s.in_face) continue;
      const Vector3d d = s.point - mouth.at;
      form.reach_mm = std::max(form.reach_mm, d.norm());
      form.along_mm = std::max(form.along_mm, d.dot(mouth.outward));
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

EndForm FormBeyond(const CadBody& body, const TubePiece& piece, const EndView& view, double at_mm,
                   const std::set<int>& tubes) {
  const double tolerance = MatchToleranceMm(piece.radius_mm);
  const std::map<int, FormFace> faces = FormFacesOf(body);
  std::map<int, std::vector<int>> faces_of_edge;
  std::set<int> open;  // edges from which the form goes on
  for (const FaceEdge& edge : body.edges) {
    faces_of_edge[edge.edge].push_back(edge.face);
    const Reach reach = ReachOf(edge, view);
    const bool at_end = reach.lowest > at_mm - tolerance && reach.highest < at_mm + tolerance;
    if (at_end && reach.widest < piece.radius_mm + tolerance) open.insert(edge.edge);
  }
  std::set<int> seen;
  EndForm form{at_mm, EndCover::kNone};
  std::optional<AxisHit> cover;
  std::vector<BeyondFace> beyond;
  const auto is_narrow = [&](const FormFace& face) {
    return std::all_of(face.edges.begin(), face.edges.end(), [&](const FaceEdge* of) {
      const auto& beside = faces_of_edge[of->edge];
      return std::all_of(beside.begin(), beside.end(), [&](int number) {
        return ReachOf(faces.at(number), view).widest < piece.radius_mm + tolerance;
      });
    });
  };
  while (!open.empty()) {
    const int edge = *open.begin();
    open.erase(open.begin());
    for (const int number : faces_of_edge[edge]) {
      if (tubes.contains(number) || !seen.insert(number).second) continue;
      const FormFace& face = faces.at(number);
      const Reach reach = ReachOf(face, view);
      if (reach.lowest < at_mm - tolerance || reach.widest > kWidestRadii * piece.radius_mm) {
        continue;
      }
      for (const FaceEdge* next : face.edges) open.insert(next->edge);
      const auto hit = OverAxis(face, view, tolerance / 4);
      if (hit && (!cover || hit->along_mm > cover->along_mm)) cover = hit;
      if (reach.highest > at_mm + tolerance) {
        beyond.push_back({&face, reach.highest, is_narrow(face), hit.has_value()});
      }
    }
  }
  form.end_mm = HighestOf(std::move(beyond), view, at_mm, tolerance);
  if (cover) form.cover = CoverOf(*cover, form.end_mm - 2 * tolerance);
  return form;
}

}  // namespace bendloop::host
