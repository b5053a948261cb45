// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cad/end_cut.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <complex>
#include <iterator>
#include <map>
#include <numbers>
#include <set>
#include <vector>

namespace bendloop::host {
namespace {

using Eigen::Vector3d;
// Of the sectors around an axis that an end's edge covers.
constexpr std::size_t kAllAround = 64;
// Below this an end counts as square [deg]: what coordinates of 5 digits make of a square one.
constexpr double kSquareDeg = 0.02;

struct Frame {
  Vector3d origin, along, x, y;
  double Along(const Vector3d& p) const { return (p - origin).dot(along); }
  double Angle(const Vector3d& p) const {
    return std::atan2((p - origin).dot(y), (p - origin).dot(x));
  }
};

bool IsAlongAxis(const FaceEdge& edge, const Frame& frame, double tolerance_mm) {
  const Vector3d d = edge.points.back() - edge.points.front();
  return edge.points.size() == 2 && (d - d.dot(frame.along) * frame.along).norm() < tolerance_mm;
}

// Two edges along the axis that lie on each other: of two halves that share no edge. The sides of a
// notch lie on nothing.
bool LieOnEachOther(const FaceEdge& a, const FaceEdge& b, const Frame& frame, double tolerance_mm) {
  const Vector3d d = b.points.front() - a.points.front();
  if (&a == &b || (d - d.dot(frame.along) * frame.along).norm() > tolerance_mm) return false;
  // Not of two temporaries, to which std::minmax gives references.
  const auto [a0, a1] = std::minmax({frame.Along(a.points.front()), frame.Along(a.points.back())});
  const auto [b0, b1] = std::minmax({frame.Along(b.points.front()), frame.Along(b.points.back())});
  return std::min(a1, b1) - std::max(a0, b0) > tolerance_mm;
}

// Edges of the piece against what is not of it.
std::vector<const FaceEdge*> BorderOf(const CadBody& body, const TubePiece& piece,
                                      const Frame& frame, double tolerance_mm) {
  std::map<int, int> times;
  std::vector<const FaceEdge*> own;
  for (const FaceEdge& edge : body.edges) {
    if (std::find(piece.faces.begin(), piece.faces.end(), edge.face) == piece.faces.end()) continue;
    ++times[edge.edge];
    own.push_back(&edge);
  }
  std::erase_if(own, [&](const FaceEdge* e) { return times[e->edge] > 1 || e->points.size() < 2; });
  std::vector<const FaceEdge*> along, border;
  for (const FaceEdge* e : own) {
    if (IsAlongAxis(*e, frame, tolerance_mm)) along.push_back(e);
  }
  std::copy_if(own.begin(), own.end(), std::back_inserter(border), [&](const FaceEdge* e) {
    return !IsAlongAxis(*e, frame, tolerance_mm) ||
           std::none_of(along.begin(), along.end(), [&](const FaceEdge* other) {
             return LieOnEachOther(*e, *other, frame, tolerance_mm);
           });
  });
  return border;
}

// Edges that meet at their ends, in groups.
std::vector<std::vector<const FaceEdge*>> Loops(std::vector<const FaceEdge*> edges,
                                                double tolerance_mm) {
  const auto meet = [&](const FaceEdge* a, const FaceEdge* b) {
    for (const Vector3d* p : {&a->points.front(), &a->points.back()}) {
      for (const Vector3d* q : {&b->points.front(), &b->points.back()}) {
        if ((*p - *q).norm() < tolerance_mm) return true;
      }
    }
    return false;
  };
  std::vector<std::vector<const FaceEdge*>> loops;
  while (!edges.empty()) {
    std::vector<const FaceEdge*> loop{edges.back()};
    edges.pop_back();
    for (std::size_t i = 0; i < loop.size(); ++i) {
      const auto joined = std::stable_partition(
          edges.begin(), edges.end(), [&](const FaceEdge* e) { return !meet(loop[i], e); });
      loop.insert(loop.end(), joined, edges.end());
      edges.erase(joined, edges.end());
    }
    loops.push_back(std::move(loop));
  }
  return loops;
}

// Of a shape: the side, or the two, on which its farthest points lie.
void SetLongest(const std::vector<const FaceEdge*>& loop, const Frame& frame, EndCut& cut) {
  constexpr double kFarthest = 0.1;  // of how far it goes along the axis
  constexpr double kOneSided = 0.3, kTwoSided = 0.5;
  const double least = cut.highest_mm - kFarthest * (cut.highest_mm - cut.lowest_mm);
  std::complex<double> once = 0, twice = 0;
  double all = 0;
  for (const FaceEdge* edge : loop) {
    for (std::size_t i = 0; i + 1 < edge->points.size(); ++i) {
      const Vector3d &p = edge->points[i], &q = edge->points[i + 1];
      if (frame.Along(p) < least || frame.Along(q) < least) continue;
      const double angle = frame.Angle(p);
      const double step = std::remainder(frame.Angle(q) - angle, 2 * std::numbers::pi);
      once += std::polar(std::abs(step), angle + step / 2);
      twice += std::polar(std::abs(step), 2 * (angle + step / 2));
      all += std::abs(step);
    }
  }
  cut.longest_twice = std::abs(once) < kOneSided * all;
  if (!(all > 0) || (cut.longest_twice && std::abs(twice) < kTwoSided * all)) {
    cut.longest_twice = false;
    return;
  }
  const double angle = cut.longest_twice ? std::arg(twice) / 2 : std::arg(once);
  cut.longest = std::cos(angle) * frame.x + std::sin(angle) * frame.y;
}

EndCut CutThrough(const std::vector<const FaceEdge*>& loop, const Frame& frame,
                  double tolerance_mm) {
  Vector3d mean = Vector3d::Zero();
  double count = 0;
  EndCut cut;
  cut.lowest_mm = INFINITY;
  cut.highest_mm = -INFINITY;
  for (const FaceEdge* edge : loop) {
    for (const Vector3d& p : edge->points) {
      mean += p;
      ++count;
      cut.lowest_mm = std::min(cut.lowest_mm, frame.Along(p));
      cut.highest_mm = std::max(cut.highest_mm, frame.Along(p));
    }
  }
  mean /= count;
  Eigen::Matrix3d spread = Eigen::Matrix3d::Zero();
  for (const FaceEdge* edge : loop) {
    for (const Vector3d& p : edge->points) spread += (p - mean) * (p - mean).transpose();
  }
  Vector3d n = Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(spread).eigenvectors().col(0);
  if (n.dot(frame.along) < 0) n = -n;
  double off = 0;
  for (const FaceEdge* edge : loop) {
    for (const Vector3d& p : edge->points) off = std::max(off, std::abs((p - mean).dot(n)));
  }
  const double cosine = n.dot(frame.along);
  cut.is_plane = off < tolerance_mm && cosine > 0.1;
  if (!cut.is_plane) {
    cut.along_mm = cut.highest_mm;
    SetLongest(loop, frame, cut);
    return cut;
  }
  cut.along_mm = (mean - frame.origin).dot(n) / cosine;
  cut.oblique_deg = std::atan2(n.cross(frame.along).norm(), cosine) * 180 / std::numbers::pi;
  if (cut.oblique_deg < kSquareDeg) {
    cut.oblique_deg = 0;
  } else {
    cut.longest = (cosine * frame.along - n).normalized();
  }
  return cut;
}

// The end of the bend's centre line that lies nearest to one of the straight's.
Vector3d JointOf(const TubePiece& straight, const TubePiece& bend) {
  Vector3d joint = bend.PointAt(bend.from);
  double nearest = INFINITY;
  for (const double at : {bend.from, bend.to}) {
    for (const double end : {straight.from, straight.to}) {
      const double apart = (bend.PointAt(at) - straight.PointAt(end)).norm();
      if (apart >= nearest) continue;
      nearest = apart;
      joint = bend.PointAt(at);
    }
  }
  return joint;
}

// Where a straight and its bend meet is no part of an end's edge, and a cut that touches or crosses
// the joint is one edge only without it.
void DropJoint(const TubePiece& bend, const Frame& frame, double joint_mm, double tolerance_mm,
               std::vector<const FaceEdge*>& border) {
  std::set<int> of_bend;
  for (const FaceEdge* edge : bend.edges) of_bend.insert(edge->edge);
  std::erase_if(border, [&](const FaceEdge* edge) {
    return of_bend.contains(edge->edge) ||
           std::all_of(edge->points.begin(), edge->points.end(), [&](const Vector3d& p) {
             return std::abs(frame.Along(p) - joint_mm) < tolerance_mm;
           });
  });
}

std::size_t SectorsAround(const std::vector<const FaceEdge*>& loop, const Frame& frame) {
  Around around;
  for (const FaceEdge* edge : loop) AddAround(edge->points, frame.origin, frame.along, around);
  return around.count();
}

// The cut of which `part` is what lies on the straight, and the bend has the rest in the same
// plane.
std::optional<EndCut> CutOverBend(std::vector<const FaceEdge*> part, const TubePiece& bend,
                                  const Frame& frame, double tolerance_mm) {
  const EndCut cut = CutThrough(part, frame, tolerance_mm);
  if (!cut.is_plane || cut.oblique_deg == 0) return std::nullopt;
  const double angle = cut.oblique_deg * std::numbers::pi / 180;
  const Vector3d normal = std::cos(angle) * frame.along - std::sin(angle) * cut.longest;
  const Vector3d at = frame.origin + cut.along_mm * frame.along;
  for (const FaceEdge* edge : bend.edges) {
    const bool lies_in_it = std::all_of(
        edge->points.begin(), edge->points.end(),
        [&](const Vector3d& p) { return std::abs((p - at).dot(normal)) < tolerance_mm; });
    if (lies_in_it) part.push_back(edge);
  }
  if (SectorsAround(part, frame) < kAllAround) return std::nullopt;
  EndCut whole = CutThrough(part, frame, tolerance_mm);
  whole.reaches_bend = true;
  return whole.is_plane ? std::optional(whole) : std::nullopt;
}

std::optional<EndCut> FarthestCut(const std::vector<const FaceEdge*>& border, const TubePiece* bend,
                                  const Frame& frame, double tolerance_mm) {
  std::optional<EndCut> farthest;
  for (const auto& loop : Loops(border, tolerance_mm)) {
    std::optional<EndCut> cut;
    if (SectorsAround(loop, frame) >= kAllAround) {
      cut = CutThrough(loop, frame, tolerance_mm);
    } else if (bend != nullptr) {
      cut = CutOverBend(loop, *bend, frame, tolerance_mm);
    }
    if (!cut) continue;
    if (!farthest ||
        cut->highest_mm + cut->lowest_mm > farthest->highest_mm + farthest->lowest_mm) {
      farthest = cut;
    }
  }
  return farthest;
}

}  // namespace

std::optional<EndCut> CutOf(const CadBody& body, const TubePiece& piece, const TubePiece* bend,
                            const Vector3d& origin, const Vector3d& outward) {
  const Vector3d x = outward.unitOrthogonal();
  const Frame frame{origin, outward, x, outward.cross(x)};
  const double tolerance_mm = MatchToleranceMm(piece.radius_mm) / 4;
  const auto border = BorderOf(body, piece, frame, tolerance_mm);
  if (bend != nullptr) {
    auto end = border;
    const double joint_mm = frame.Along(JointOf(piece, *bend));
    DropJoint(*bend, frame, joint_mm, tolerance_mm, end);
    if (auto cut = FarthestCut(end, bend, frame, tolerance_mm)) {
      cut->in_bend = cut->is_plane && cut->along_mm < joint_mm - tolerance_mm;
      return cut;
    }
  }
  return FarthestCut(border, nullptr, frame, tolerance_mm);
}

}  // namespace bendloop::host
