// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cad/tube_chain.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>
#include <tuple>
#include <utility>

#include "firmware-host/cad/free_surface.h"
#include "firmware-host/cad/piece_rim.h"
#include "firmware-host/cad/radius_groups.h"

namespace bendloop::host {
namespace {

using Eigen::Vector3d;

// A straight with no face between two others in line may be so many diameters long.
constexpr double kLongestMissingDiameters = 10;

// Or longer, where something wider about the axis covers this part of it.
constexpr double kLeastCovered = 0.5;

// Pieces of one tube may lie so much askew [deg] where they share their border.
constexpr double kSharedKinkDeg = 1;

struct End {
  int piece = 0;
  bool at_to = false;
  Vector3d point, outward;
};

End EndOf(const std::vector<TubePiece>& pieces, int piece, bool at_to) {
  const TubePiece& p = pieces[std::size_t(piece)];
  const double along = at_to ? p.to : p.from;
  const Vector3d t = p.TangentAt(along);
  return {piece, at_to, p.PointAt(along), at_to ? t : Vector3d(-t)};
}

double AngleDeg(const Vector3d& a, const Vector3d& b) {
  return std::atan2(a.cross(b).norm(), a.dot(b)) * 180 / std::numbers::pi;
}

// The number of the fewest decimals near `value`, which samples say that lie up to `off_mm` off: a
// B-spline for a bend of 40 mm is one of 39.9999987 to the fit. At most by what an exact one is
// off, so that what is near alone keeps the decimals it has.
double Roundest(double value, double off_mm) {
  constexpr double kLeastMm = 2e-6;  // numbers of ten digits
  const double within = std::clamp(off_mm, kLeastMm, kExactSurfaceMm);
  for (double per_unit = 1; per_unit < 1e8; per_unit *= 10) {
    const double rounded = std::round(value * per_unit) / per_unit;
    if (std::abs(rounded - value) <= within) return rounded;
  }
  return value;
}

// Of a chain's pieces by their lengths: of its cylinders where these and its tori scatter, of both
// where they do not, and where it has none, of its B-splines.
class ChainRadius {
 public:
  void Add(const TubePiece& piece) {
    if (piece.inferred) return;
    if (piece.off_mm > 0) {
      splines_.Add(piece);
    } else {
      given_.Add(piece);
      if (!piece.is_arc) straights_.Add(piece);
    }
    least_mm_ = std::min(least_mm_, piece.radius_mm);
    most_mm_ = std::max(most_mm_, piece.radius_mm);
    off_mm_ = std::max(off_mm_, piece.off_mm);
  }

  std::optional<double> Mm() const {
    if (scatter_mm() > 0 && straights_.weight > 0) return straights_.Mean();
    if (given_.weight > 0) return given_.Mean();
    if (splines_.weight > 0) return Roundest(splines_.Mean(), off_mm_);
    return std::nullopt;
  }

  // How far the radii lie apart; 0: less than a file's rounding may make of it.
  double scatter_mm() const {
    const double apart_mm = most_mm_ - least_mm_;
    return apart_mm > MatchToleranceMm(most_mm_) / 4 ? apart_mm : 0;
  }

 private:
  struct Sum {
    double weighted = 0, weight = 0;
    void Add(const TubePiece& piece) {
      weighted += piece.radius_mm * piece.length_mm();
      weight += piece.length_mm();
    }
    double Mean() const { return weighted / weight; }
  };
  Sum straights_, given_, splines_;
  double least_mm_ = INFINITY, most_mm_ = 0;
  double off_mm_ = 0;
};

class Linker {
 public:
  Linker(std::vector<TubePiece>& pieces, std::vector<int> of, bool may_infer_bends)
      : pieces_(pieces), of_(std::move(of)), may_infer_bends_(may_infer_bends) {
    radius_mm_ = pieces_[std::size_t(of_.front())].radius_mm;
    tolerance_mm_ = MatchToleranceMm(radius_mm_);
  }

  std::vector<TubeChain> Chains() {
    for (const int i : of_) AddEnds(i);
    MatchTouching(false);
    MatchTouching(true);
    // What is inferred offers its own ends, so this comes to an end: each takes two of the free.
    while (InferOne()) MatchTouching(false);
    MarkKinks();
    return Walk();
  }

 private:
  struct Slot {
    End end;
    int mate = -1;
    double kink_deg = 0;
    Vector3d kink_at = Vector3d::Zero();
  };

  void AddEnds(int piece) {
    slots_.push_back({EndOf(pieces_, piece, false)});
    slots_.push_back({EndOf(pieces_, piece, true)});
  }

  const TubePiece& PieceOf(const Slot& slot) const { return pieces_[std::size_t(slot.end.piece)]; }
  bool IsFree(std::size_t i) const { return slots_[i].mate < 0; }

  // How far apart two ends are that may be one joint; `loosely`: though they lie beside each other.
  std::optional<double> Gap(const Slot& a, const Slot& b, bool loosely) const {
    if (a.end.piece == b.end.piece) return std::nullopt;
    const double angle = AngleDeg(a.end.outward, -b.end.outward);
    if (angle > kSharedKinkDeg) return std::nullopt;
    const Vector3d gap = b.end.point - a.end.point;
    const double axial = gap.dot(a.end.outward), beside = BesideMm(a, b);
    // A straight's faces may end before the bend's, or be cut into by them.
    const bool line = !PieceOf(a).is_arc || !PieceOf(b).is_arc;
    if (std::abs(axial) > (line ? std::max(radius_mm_, tolerance_mm_) : tolerance_mm_))
      return std::nullopt;
    const double most_mm = std::max(kBesideRadii * radius_mm_, tolerance_mm_);
    const bool meets = angle <= kKinkDeg && beside <= (loosely ? most_mm : tolerance_mm_);
    if (!meets && (beside > most_mm || !ShareBorder(PieceOf(a), PieceOf(b)))) return std::nullopt;
    return gap.norm();
  }

  static double BesideMm(const Slot& a, const Slot& b) {
    const Vector3d gap = b.end.point - a.end.point;
    return (gap - gap.dot(a.end.outward) * a.end.outward).norm();
  }

  // What meets is joined before what lies beside each other.
  void MatchTouching(bool loosely) {
    struct Pair {
      double gap;
      std::size_t a, b;
    };
    std::vector<Pair> pairs;
    for (std::size_t a = 0; a < slots_.size(); ++a) {
      for (std::size_t b = a + 1; IsFree(a) && b < slots_.size(); ++b) {
        if (!IsFree(b)) continue;
        if (const auto gap = Gap(slots_[a], slots_[b], loosely)) pairs.push_back({*gap, a, b});
      }
    }
    std::stable_sort(pairs.begin(), pairs.end(),
                     [](const Pair& p, const Pair& q) { return p.gap < q.gap; });
    for (const Pair& p : pairs) {
      if (IsFree(p.a) && IsFree(p.b)) Join(p.a, p.b);
    }
  }

  void Join(std::size_t a, std::size_t b) {
    slots_[a].mate = int(b);
    slots_[b].mate = int(a);
  }

  // The nearest pair of free ends between which a piece without faces must have been.
  bool InferOne() {
    std::optional<TubePiece> best;
    double best_length = INFINITY;
    for (std::size_t a = 0; a < slots_.size(); ++a) {
      for (std::size_t b = a + 1; IsFree(a) && b < slots_.size(); ++b) {
        if (!IsFree(b) || slots_[a].end.piece == slots_[b].end.piece) continue;
        auto piece = MissingStraight(slots_[a], slots_[b]);
        if (!piece && may_infer_bends_) piece = MissingBend(slots_[a], slots_[b]);
        if (piece && piece->length_mm() < best_length) {
          best_length = piece->length_mm();
          best = piece;
        }
      }
    }
    if (!best) return false;
    best->radius_mm = radius_mm_;
    best->inferred = true;
    best->around.set();
    pieces_.push_back(*best);
    AddEnds(int(pieces_.size()) - 1);
    return true;
  }

  std::optional<TubePiece> MissingStraight(const Slot& a, const Slot& b) const {
    const Vector3d gap = b.end.point - a.end.point;
    const double length = gap.norm();
    if (length <= radius_mm_) return std::nullopt;
    const bool in_line = AngleDeg(a.end.outward, gap) < kKinkDeg / 10 &&
                         AngleDeg(b.end.outward, -gap) < kKinkDeg / 10;
    if (!in_line) return std::nullopt;
    // Asked last: it looks at all pieces, and engraved text has thousands of ends.
    if (length > 2 * kLongestMissingDiameters * radius_mm_ &&
        !IsCovered(a.end.point, gap / length, length)) {
      return std::nullopt;
    }
    TubePiece piece;
    piece.origin = a.end.point;
    piece.axis = gap / length;
    piece.x = piece.axis.unitOrthogonal();
    piece.to = length;
    return piece;
  }

  // A silencer or sleeve about the axis hides what goes on in it.
  bool IsCovered(const Vector3d& from, const Vector3d& along, double length) const {
    return std::any_of(pieces_.begin(), pieces_.end(), [&](const TubePiece& piece) {
      if (piece.is_arc || piece.inferred || piece.radius_mm <= radius_mm_ ||
          (AngleDeg(piece.axis, along) > kKinkDeg && AngleDeg(piece.axis, -along) > kKinkDeg)) {
        return false;
      }
      const Vector3d p = piece.PointAt(piece.from) - from, q = piece.PointAt(piece.to) - from;
      const double u = p.dot(along), v = q.dot(along);
      const double covered = std::min(std::max(u, v), length) - std::max(std::min(u, v), 0.0);
      return (p - u * along).norm() < tolerance_mm_ && covered > kLeastCovered * length;
    });
  }

  std::optional<TubePiece> MissingBend(const Slot& a, const Slot& b) const {
    if (PieceOf(a).is_arc || PieceOf(b).is_arc) return std::nullopt;
    const Vector3d t = a.end.outward, u = -b.end.outward;  // into and out of the bend
    const double angle = AngleDeg(t, u) * std::numbers::pi / 180;
    const Vector3d normal = t.cross(u);
    const double sine = normal.norm();
    if (sine < std::sin(kKinkDeg * std::numbers::pi / 180)) return std::nullopt;
    const Vector3d gap = b.end.point - a.end.point;
    if (std::abs(gap.dot(normal)) / sine > tolerance_mm_) return std::nullopt;
    // a + s t = b - r u
    const double s = gap.cross(u).dot(normal) / (sine * sine);
    const double r = gap.cross(t).dot(normal) / (sine * sine) * -1;
    if (std::abs(s - r) > tolerance_mm_) return std::nullopt;
    const double radius = (s + r) / 2 / std::tan(angle / 2);
    if (radius < radius_mm_ || radius > 100 * radius_mm_) return std::nullopt;
    TubePiece piece;
    piece.is_arc = true;
    piece.axis = normal / sine;
    piece.bend_radius_mm = radius;
    piece.origin = a.end.point + radius * piece.axis.cross(t);
    piece.x = (a.end.point - piece.origin).normalized();
    piece.to = angle;
    return piece;
  }

  // Of a pair of ends that point at each other the angle of their kink, and where it is.
  std::optional<std::pair<double, Vector3d>> KinkOf(const Slot& a, const Slot& b) const {
    const Vector3d t = a.end.outward, u = -b.end.outward;
    const double angle = AngleDeg(t, u);
    if (angle < kKinkDeg || angle > 170) return std::nullopt;
    const double reach =
        radius_mm_ * (std::tan(angle / 2 * std::numbers::pi / 180) + 0.1) + tolerance_mm_;
    const Vector3d normal = t.cross(u), gap = b.end.point - a.end.point;
    if (std::abs(gap.dot(normal)) / normal.norm() > tolerance_mm_) return std::nullopt;
    const double s = gap.cross(u).dot(normal) / normal.squaredNorm();
    const double r = -gap.cross(t).dot(normal) / normal.squaredNorm();
    if (std::abs(s) > reach || std::abs(r) > reach) return std::nullopt;
    return std::make_pair(angle, Vector3d(a.end.point + s * t));
  }

  // Straights cut to a mitre reach beyond the point where their axes meet, or up to it. The far end
  // of a short one may lie as near to it, and points the other way: the slighter kink is the one.
  void MarkKinks() {
    for (std::size_t i = 0; i < slots_.size(); ++i) {
      for (std::size_t j = i + 1; IsFree(i) && j < slots_.size(); ++j) {
        if (!IsFree(j) || slots_[i].end.piece == slots_[j].end.piece) continue;
        const auto kink = KinkOf(slots_[i], slots_[j]);
        if (!kink) continue;
        for (Slot* slot : {&slots_[i], &slots_[j]}) {
          if (slot->kink_deg > 0 && slot->kink_deg <= kink->first) continue;
          std::tie(slot->kink_deg, slot->kink_at) = *kink;
        }
      }
    }
  }

  std::vector<TubeChain> Walk() {
    std::vector<TubeChain> chains;
    std::vector<bool> used(slots_.size(), false);
    for (std::size_t i = 0; i < slots_.size(); ++i) {
      if (IsFree(i) && !used[i]) chains.push_back(From(i, used));
    }
    for (std::size_t i = 0; i < slots_.size(); ++i) {
      if (used[i]) continue;
      chains.push_back(From(i, used));
      chains.back().is_closed = true;
    }
    return chains;
  }

  // `number`: of the bend, or of the straight.
  static std::string InferredNote(bool is_arc, std::size_t number) {
    return is_arc ? "bend " + std::to_string(number) + " has no face: it follows from its straights"
                  : "a piece of straight " + std::to_string(number) +
                        " has no face: what is around it lies in line";
  }

  TubeChain From(std::size_t slot, std::vector<bool>& used) {
    TubeChain chain;
    chain.concave = PieceOf(slots_[slot]).concave;
    chain.first = {slots_[slot].end.piece, slots_[slot].end.at_to, slots_[slot].kink_deg,
                   slots_[slot].kink_at};
    std::size_t at = slot;
    ChainRadius radius;
    std::vector<std::pair<bool, std::size_t>> inferred;  // a bend, its number; or a straight's
    for (;;) {
      const std::size_t other = at ^ 1;  // the slots of a piece stand beside each other
      used[at] = used[other] = true;
      const TubePiece& piece = PieceOf(slots_[at]);
      chain.pieces.push_back(slots_[at].end.piece);
      radius.Add(piece);
      AddToSpine(piece, at % 2 == 1, chain);
      if (piece.inferred) {
        inferred.emplace_back(piece.is_arc, chain.spine.arcs.size() + (piece.is_arc ? 0 : 1));
      }
      chain.last = {slots_[other].end.piece, slots_[other].end.at_to, slots_[other].kink_deg,
                    slots_[other].kink_at};
      const int next = slots_[other].mate;
      if (next < 0 || used[std::size_t(next)]) break;
      const Slot &end = slots_[other], &begin = slots_[std::size_t(next)];
      chain.sharpest_joint_deg =
          std::max(chain.sharpest_joint_deg, AngleDeg(end.end.outward, -begin.end.outward));
      chain.widest_joint_mm = std::max(chain.widest_joint_mm, BesideMm(end, begin));
      AddApart(end, begin, chain);
      at = std::size_t(next);
    }
    chain.radius_mm = radius.Mm().value_or(radius_mm_);
    chain.scatter_mm = radius.scatter_mm();
    const std::size_t bends = chain.spine.arcs.size();
    for (const auto& [is_arc, number] : inferred) {
      chain.notes.push_back(InferredNote(is_arc, number));
      chain.notes_reversed.push_back(InferredNote(is_arc, bends + (is_arc ? 1 : 2) - number));
    }
    return chain;
  }

  void AddApart(const Slot& end, const Slot& begin, TubeChain& chain) const {
    const TubePiece &a = PieceOf(end), &b = PieceOf(begin);
    if (a.inferred || b.inferred || ShareBorder(a, b)) return;
    const double apart_mm = (begin.end.point - end.end.point).dot(end.end.outward);
    chain.widest_gap_mm = std::max(chain.widest_gap_mm, apart_mm);
    chain.widest_overlap_mm = std::max(chain.widest_overlap_mm, -apart_mm);
  }

  // Two pieces of one bend, as edges of a centre line come.
  static bool GoesOn(const SpineArc& before, const SpineArc& arc, double tolerance_mm) {
    return (before.centre - arc.centre).norm() < tolerance_mm / 4 &&
           (before.to - arc.from).norm() < tolerance_mm &&
           std::abs(before.bend_radius_mm - arc.bend_radius_mm) < tolerance_mm / 4 &&
           AngleDeg(before.normal, arc.normal) < kKinkDeg / 10;
  }

  static void AddToSpine(const TubePiece& piece, bool backwards, TubeChain& chain) {
    const double in = backwards ? piece.to : piece.from, out = backwards ? piece.from : piece.to;
    const double sign = backwards ? -1 : 1;
    Spine& spine = chain.spine;
    if (chain.pieces.size() == 1) {
      spine.start = piece.PointAt(in);
      spine.direction = sign * piece.TangentAt(in);
    }
    spine.end = piece.PointAt(out);
    if (piece.is_arc) {
      SpineArc arc;
      arc.centre = piece.origin;
      arc.from = piece.PointAt(in);
      arc.to = piece.PointAt(out);
      arc.tangent_in = sign * piece.TangentAt(in);
      arc.tangent_out = sign * piece.TangentAt(out);
      arc.normal = sign * piece.axis;
      arc.bend_radius_mm =
          piece.off_mm > 0 ? Roundest(piece.bend_radius_mm, piece.off_mm) : piece.bend_radius_mm;
      arc.angle_rad = piece.to - piece.from;
      if (!spine.arcs.empty() &&
          GoesOn(spine.arcs.back(), arc, MatchToleranceMm(chain.radius_mm))) {
        spine.arcs.back().to = arc.to;
        spine.arcs.back().tangent_out = arc.tangent_out;
        spine.arcs.back().angle_rad += arc.angle_rad;
      } else {
        spine.arcs.push_back(arc);
      }
    }
  }

  std::vector<TubePiece>& pieces_;
  std::vector<int> of_;
  bool may_infer_bends_;
  double radius_mm_ = 0, tolerance_mm_ = 0;
  std::vector<Slot> slots_;
};

}  // namespace

std::vector<TubeChain> ChainsOf(std::vector<TubePiece>& pieces, bool may_infer_bends) {
  std::vector<TubeChain> chains;
  for (std::vector<int>& group : RadiusGroups(pieces)) {
    auto found = Linker(pieces, std::move(group), may_infer_bends).Chains();
    for (TubeChain& chain : found) chains.push_back(std::move(chain));
  }
  return chains;
}

}  // namespace bendloop::host
