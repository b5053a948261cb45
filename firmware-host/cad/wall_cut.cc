// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cad/wall_cut.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numbers>
#include <numeric>
#include <utility>

namespace bendloop::host {
namespace {

using Eigen::Vector3d;
// What leaves less than this of the turn free goes all around: an edge has a point each 22.5
// degrees of an arc.
constexpr double kLeastGapDeg = 45;
// Of more loose edges none are looked for that lie on each other: that is no tube's wall.
constexpr std::size_t kMostLooseEdges = 4000;

// A straight edge has no point but its ends.
void AddPoints(const FaceEdge& edge, std::vector<Vector3d>& points) {
  points.insert(points.end(), edge.points.begin(), edge.points.end());
  if (edge.points.size() == 2) points.emplace_back((edge.points[0] + edge.points[1]) / 2);
}

double LengthOf(const std::vector<Vector3d>& points) {
  double length = 0;
  for (std::size_t i = 1; i < points.size(); ++i) length += (points[i] - points[i - 1]).norm();
  return length;
}

// Whether two edges that faces do not share are one all the same, as of faces that nobody sewed.
bool LieOnEachOther(const FaceEdge& a, const FaceEdge& b) {
  constexpr double kSameEdgeEndMm = 1e-2;
  constexpr double kChordSag = 0.03;  // [of its length] what chords leave of an edge
  if (a.points.size() < 2 || b.points.size() < 2) return false;
  const double length = LengthOf(a.points);
  const double within = kSameEdgeEndMm + kChordSag * length;
  if (std::abs(length - LengthOf(b.points)) > within) return false;
  const auto middle = [](const FaceEdge& e) -> Vector3d {
    Vector3d sum = Vector3d::Zero();
    for (std::size_t i = 1; i < e.points.size(); ++i) sum += e.points[i - 1] + e.points[i];
    return sum / (2.0 * double(e.points.size() - 1));
  };
  if ((middle(a) - middle(b)).norm() > within) return false;
  const auto is_closed = [](const FaceEdge& e) {
    return (e.points.front() - e.points.back()).norm() < kSameEdgeEndMm;
  };
  if (is_closed(a) && is_closed(b)) return true;
  const auto same = [](const Vector3d& p, const Vector3d& q) {
    return (p - q).norm() < kSameEdgeEndMm;
  };
  return (same(a.points.front(), b.points.front()) && same(a.points.back(), b.points.back())) ||
         (same(a.points.front(), b.points.back()) && same(a.points.back(), b.points.front()));
}

// The end straights go on beyond the ends, as the longer side of an oblique cut does.
double FromAxisMm(const Place& at) {
  return at.across_mm * (at.radial - at.radial.dot(at.tangent) * at.tangent).norm();
}

enum class Lies { kOuter, kInner, kElsewhere };

// Faces of a body, and which of them lie about a tube's wall.
class WallFaces {
 public:
  WallFaces(const CadBody& body, const CadTube& tube, const Developed& developed)
      : tube_(tube), tolerance_(2 * MatchToleranceMm(tube.pipe_radius_mm)) {
    for (const FaceEdge& edge : body.edges) {
      faces_[edge.face].push_back(&edge);
      by_edge_[edge.edge].push_back(&edge);
    }
    for (const SurfacePatch& patch : body.patches) patches_[patch.face].push_back(&patch);
    for (const auto& [face, edges] : faces_) {
      for (const FaceEdge* edge : edges) {
        auto& places = across_[edge];
        for (const Vector3d& p : edge->points) places.push_back(FromAxisMm(developed.Of(p)));
      }
      lies_[face] = LiesOn(face, edges);
    }
  }

  const std::vector<const FaceEdge*>& EdgesOf(int face) const { return faces_.at(face); }
  bool IsOn(const FaceEdge& edge, double radius_mm) const {
    const auto& places = across_.at(&edge);
    return std::all_of(places.begin(), places.end(),
                       [&](double mm) { return std::abs(mm - radius_mm) < tolerance_; });
  }
  double FarthestMm(const FaceEdge& edge) const {
    const auto& places = across_.at(&edge);
    return places.empty() ? 0 : *std::max_element(places.begin(), places.end());
  }

  // Faces of neither surface that share edges, in groups.
  std::vector<std::vector<int>> Groups() const {
    std::map<int, int> of;
    for (const auto& [face, lies] : lies_) {
      if (lies == Lies::kElsewhere) of[face] = face;
    }
    const auto root = [&](int face) {
      while (of.at(face) != face) face = of.at(face);
      return face;
    };
    const auto join = [&](int a, int b) {
      if (!of.contains(a) || !of.contains(b)) return;
      const int ra = root(a), rb = root(b);
      of[std::max(ra, rb)] = std::min(ra, rb);
    };
    std::vector<const FaceEdge*> loose;
    for (const auto& [number, uses] : by_edge_) {
      for (const FaceEdge* use : uses) join(uses.front()->face, use->face);
      if (uses.size() == 1 && of.contains(uses.front()->face)) loose.push_back(uses.front());
    }
    for (std::size_t i = 0; i < loose.size() && loose.size() < kMostLooseEdges; ++i) {
      for (std::size_t j = 0; j < i; ++j) {
        if (LieOnEachOther(*loose[i], *loose[j])) join(loose[i]->face, loose[j]->face);
      }
    }
    std::map<int, std::vector<int>> groups;
    for (const auto& [face, parent] : of) groups[root(face)].push_back(face);
    std::vector<std::vector<int>> all;
    for (auto& [first, faces] : groups) all.push_back(std::move(faces));
    return all;
  }

 private:
  // A plane may have its whole border on the outer surface and be none of it: a milled flat. What
  // is known as a bend is one, though it lies nearer to an end of the tube that comes back to it.
  Lies LiesOn(int face, const std::vector<const FaceEdge*>& edges) const {
    if (tube_.faces.contains(face)) return Lies::kOuter;
    const auto patches = patches_.find(face);
    if (patches == patches_.end()) return Lies::kElsewhere;
    const auto is_on = [&](double radius_mm) {
      return std::all_of(patches->second.begin(), patches->second.end(),
                         [&](const SurfacePatch* patch) {
                           return patch->kind == PatchKind::kFree ||
                                  std::abs(patch->radius_mm - radius_mm) < tolerance_;
                         }) &&
             std::all_of(edges.begin(), edges.end(),
                         [&](const FaceEdge* edge) { return IsOn(*edge, radius_mm); });
    };
    if (is_on(tube_.pipe_radius_mm)) return Lies::kOuter;
    if (tube_.wall_mm && is_on(tube_.pipe_radius_mm - *tube_.wall_mm)) return Lies::kInner;
    return Lies::kElsewhere;
  }

  const CadTube& tube_;
  double tolerance_;
  std::map<int, std::vector<const FaceEdge*>> faces_, by_edge_;
  std::map<int, std::vector<const SurfacePatch*>> patches_;
  std::map<const FaceEdge*, std::vector<double>> across_;
  std::map<int, Lies> lies_;
};

// The angle of a place about the centre line, seen from `middle`: places around are counted from
// another bend on the other side of one.
double TurnFrom(const Place& middle, const Place& at) {
  const Vector3d zero = (middle.radial - middle.radial.dot(at.tangent) * at.tangent).normalized();
  return std::atan2(at.radial.dot(at.tangent.cross(zero)), at.radial.dot(zero));
}

// The part of the turn that no place of `turns` lies in, at most [rad]. Sorts them.
double WidestGap(std::vector<double>& turns) {
  std::sort(turns.begin(), turns.end());
  double widest = turns.front() + 2 * std::numbers::pi - turns.back();
  for (std::size_t i = 1; i < turns.size(); ++i) {
    widest = std::max(widest, turns[i] - turns[i - 1]);
  }
  return widest;
}

// Where its border on the outer surface lies; false: all around, or at an end.
bool Locate(const CadTube& tube, const Developed& developed, WallCut& cut) {
  const double tolerance = MatchToleranceMm(tube.pipe_radius_mm);
  const double from = tolerance + (tube.first.is_plane ? tube.first.fitting_mm : 0);
  const double to =
      tube.spine.length_mm() - tolerance - (tube.last.is_plane ? tube.last.fitting_mm : 0);
  Vector3d mean = Vector3d::Zero();
  double low = std::numeric_limits<double>::infinity(), high = -low;
  std::vector<Place> places;
  for (const Vector3d& p : cut.outer) {
    places.push_back(developed.Of(p));
    low = std::min(low, places.back().along_mm);
    high = std::max(high, places.back().along_mm);
    mean += p / double(cut.outer.size());
  }
  if (low < from || high > to) return false;
  cut.middle = developed.Of(mean);
  std::vector<double> turns;
  for (const Place& place : places) turns.push_back(TurnFrom(cut.middle, place));
  if (WidestGap(turns) < kLeastGapDeg * std::numbers::pi / 180) return false;
  // From one side to the other, the middle between both.
  const double turn = (turns.front() + turns.back()) / 2;
  const Vector3d radial = Eigen::AngleAxisd(turn, cut.middle.tangent) * cut.middle.radial;
  const Vector3d on_axis = mean - cut.middle.across_mm * cut.middle.radial;
  cut.middle = developed.Of(on_axis + tube.pipe_radius_mm * radial);
  cut.along_mm = high - low;
  cut.around_mm = (turns.back() - turns.front()) * tube.pipe_radius_mm;
  cut.middle.along_mm = (low + high) / 2;
  return true;
}

}  // namespace

std::vector<WallCut> WallCutsOf(const CadBody& body, const CadTube& tube,
                                const Developed& developed) {
  const double outer_mm = tube.pipe_radius_mm;
  const double tolerance = 2 * MatchToleranceMm(outer_mm);
  const WallFaces faces(body, tube, developed);
  std::vector<WallCut> cuts;
  for (const std::vector<int>& group : faces.Groups()) {
    WallCut cut;
    cut.faces = group;
    bool stands_out = false;
    for (const int face : group) {
      for (const FaceEdge* edge : faces.EdgesOf(face)) {
        AddPoints(*edge, cut.border);
        stands_out |= faces.FarthestMm(*edge) > outer_mm + tolerance;
        if (faces.IsOn(*edge, outer_mm)) AddPoints(*edge, cut.outer);
        if (tube.wall_mm && faces.IsOn(*edge, outer_mm - *tube.wall_mm)) {
          AddPoints(*edge, cut.inner);
        }
      }
    }
    if (stands_out || cut.outer.empty() || !Locate(tube, developed, cut)) continue;
    cut.is_through = !cut.inner.empty();
    cuts.push_back(std::move(cut));
  }
  return cuts;
}

}  // namespace bendloop::host
