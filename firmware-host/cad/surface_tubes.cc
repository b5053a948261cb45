// SPDX-License-Identifier: Apache-2.0
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <set>
#include <utility>

#include "firmware-host/cad/branches.h"
#include "firmware-host/cad/cad_tube.h"
#include "firmware-host/cad/chain_notes.h"
#include "firmware-host/cad/developed.h"
#include "firmware-host/cad/end_form.h"
#include "firmware-host/cad/free_surface.h"
#include "firmware-host/cad/left_out.h"
#include "firmware-host/cad/near_surface.h"
#include "firmware-host/cad/note_text.h"
#include "firmware-host/cad/tube_layers.h"

namespace bendloop::host {
namespace {

using Eigen::Vector3d;
// A straight tube is at least so many diameters long; what is shorter is a hole, a nut, a boss.
constexpr double kFewestDiameters = 2;
// Somewhere along it a tube has so much around it [deg]; what nowhere has more than half a turn is
// the edge of something flat, or the round side of an oval profile.
constexpr double kRoundAroundDeg = 270;
// A tube that goes on with another diameter does so within so many diameters.
constexpr double kReducerDiameters = 4;
// A whole torus that has less of its surface is a fillet or a groove.
constexpr double kRingAroundDeg = 350;
// Joints below this [deg] are tangent.
constexpr double kTangentDeg = 0.02;

class BodyTubes {
 public:
  explicit BodyTubes(CadBody& body) : body_(body) {
    RecogniseFreeSurfaces(body_);
    free_forms_ = std::count_if(body_.patches.begin(), body_.patches.end(), IsFreeForm);
    pieces_ = PiecesOf(body_);
    const auto first_ring = std::stable_partition(
        pieces_.begin(), pieces_.end(), [](const TubePiece& piece) { return !piece.is_ring(); });
    rings_.assign(first_ring, pieces_.end());
    pieces_.erase(first_ring, pieces_.end());
    // A whole torus with nothing else about it.
    for (const TubePiece& ring : rings_) {
      if (!ring.concave && ring.around_deg() > kRingAroundDeg) ring_radius_mm_ = ring.radius_mm;
    }
    chains_ = ChainsOf(pieces_, free_forms_ == 0);
  }

  std::vector<CadTube> Tubes() {
    std::vector<CadTube> tubes;
    for (const auto& cluster : Clusters()) {
      if (auto tube = TubeOf(cluster)) tubes.push_back(std::move(*tube));
    }
    KeepLongestOfBroken(tubes);
    MarkReducers(tubes);
    if (tubes.empty() && ring_radius_mm_ > 0) tubes.push_back(RingOf(ring_radius_mm_));
    if (tubes.empty() && free_forms_ > 0) tubes.push_back(FreeTube());
    return tubes;
  }

 private:
  using Cluster = std::vector<const TubeChain*>;

  const TubePiece& PieceOf(int i) const { return pieces_[std::size_t(i)]; }

  static bool OneAxis(const TubePiece& a, const TubePiece& b) {
    const double tolerance = MatchToleranceMm(std::min(a.radius_mm, b.radius_mm));
    if (a.is_arc != b.is_arc) return false;
    if (a.is_arc) {
      return (a.origin - b.origin).norm() < tolerance &&
             std::abs(a.bend_radius_mm - b.bend_radius_mm) < tolerance &&
             a.axis.cross(b.axis).norm() * a.bend_radius_mm < tolerance;
    }
    const Vector3d p = b.PointAt(b.from) - a.origin, q = b.PointAt(b.to) - a.origin;
    const double u = p.dot(a.axis), v = q.dot(a.axis);
    return (p - u * a.axis).norm() < tolerance && (q - v * a.axis).norm() < tolerance &&
           std::max(u, v) > a.from - tolerance && std::min(u, v) < a.to + tolerance;
  }

  bool ShareAxis(const TubeChain& a, const TubeChain& b) const {
    for (const int i : a.pieces) {
      for (const int j : b.pieces) {
        if (OneAxis(PieceOf(i), PieceOf(j))) return true;
      }
    }
    return false;
  }

  // Chains about one axis: a tube's outer and inner surface, and what sits on it.
  std::vector<Cluster> Clusters() const {
    std::vector<std::size_t> of(chains_.size());
    std::iota(of.begin(), of.end(), 0);
    for (std::size_t i = 0; i < chains_.size(); ++i) {
      for (std::size_t j = 0; j < i; ++j) {
        if (of[i] == of[j] || !ShareAxis(chains_[i], chains_[j])) continue;
        const std::size_t from = of[i], to = of[j];
        std::replace(of.begin(), of.end(), from, to);
      }
    }
    std::vector<Cluster> clusters;
    for (std::size_t k = 0; k < chains_.size(); ++k) {
      Cluster cluster;
      for (std::size_t i = 0; i < chains_.size(); ++i) {
        if (of[i] == k) cluster.push_back(&chains_[i]);
      }
      if (!cluster.empty()) clusters.push_back(std::move(cluster));
    }
    return clusters;
  }

  std::optional<CadTube> TubeOf(const Cluster& cluster) {
    const std::vector<TubeLayer> layers = LayersOf(cluster, pieces_);
    const TubeLayer* outer = OuterOf(layers);
    if (outer == nullptr) return std::nullopt;
    const TubeLayer* inner =
        outer->concave ? nullptr : InnerOf(layers, *outer, body_.kind == BodyKind::kSolid);
    const TubeChain& basis = BasisOf(*outer, inner);
    if (basis.is_closed) return RingOf(outer->radius_mm);
    CadTube tube;
    tube.pipe_radius_mm = outer->radius_mm;
    tube.spine = basis.spine;
    const auto elbows = ElbowsOf(layers, *outer, inner);
    tube.notes = ElbowNotes(elbows, *outer, inner);
    AddInferredNotes(basis, elbows, tube);
    AddFaces(*outer, tube);
    if (inner != nullptr) {
      tube.wall_mm = outer->radius_mm - inner->radius_mm;
      AddFaces(*inner, tube);
    }
    if (outer->concave) tube.notes.push_back("no outer surface: the pipe radius is the bore's");
    if (basis.radius_mm < outer->radius_mm) {
      tube.notes.push_back("the outer surface lacks faces: the inner one is followed");
    }
    if (basis.sharpest_joint_deg > kTangentDeg) {
      tube.notes.push_back(
          NoteText("straights and bends meet at up to %.3f degrees", basis.sharpest_joint_deg));
    }
    if (basis.widest_joint_mm > MatchToleranceMm(basis.radius_mm)) {
      tube.notes.push_back(NoteText("straights and bends meet up to %.3f mm beside each other",
                                    basis.widest_joint_mm));
    }
    AddApartNotes(basis, tube);
    const TubeEnds ends(body_, pieces_, chains_);
    tube.last = ends.At(basis.last, basis, cluster, tube.spine);
    Spine turned = tube.spine.Reversed();
    tube.first = ends.At(basis.first, basis, cluster, turned);
    tube.spine = turned.Reversed();
    // Without a bore a flat end is a bar's, or that of a tube whose bore the file leaves out.
    for (TubeEnd* end : {&tube.first, &tube.last}) {
      if (end->cover == EndCover::kFlat && !tube.wall_mm) end->cover = EndCover::kNone;
    }
    AddProblems(basis, tube);
    AddSplineNotes(pieces_, basis, tube);
    const bool long_enough = tube.spine.length_mm() >= 2 * kFewestDiameters * tube.pipe_radius_mm;
    // A straight hole through a block is no tube.
    const bool is_bore = outer->concave && body_.kind == BodyKind::kSolid;
    const double around =
        std::max(MostAroundDeg(*outer, pieces_), inner ? MostAroundDeg(*inner, pieces_) : 0);
    tube.is_round = around >= kRoundAroundDeg;
    if (!tube.is_bent() && (is_bore || !long_enough || !tube.is_round)) return std::nullopt;
    if (!tube.is_round) {
      tube.problems.push_back(NoteText(
          "its profile is not round: its curved sides go %.0f degrees around, at most", around));
    }
    AddGapNotes(body_, pieces_, rings_, basis, tube);
    AddOtherNotes(cluster, *outer, basis, tube);
    return tube;
  }

  void AddFaces(const TubeLayer& layer, CadTube& tube) const {
    for (const TubeChain* chain : layer.chains) {
      for (const int i : chain->pieces) {
        tube.faces.insert(PieceOf(i).faces.begin(), PieceOf(i).faces.end());
      }
    }
  }

  // What no face shows. A bend whose faces are an elbow's is told as that.
  static void AddInferredNotes(const TubeChain& basis, const std::vector<const TubeLayer*>& elbows,
                               CadTube& tube) {
    tube.placed_notes = basis.notes;
    tube.placed_notes_reversed = basis.notes_reversed;
    std::size_t shown = 0;
    for (const TubeLayer* elbow : elbows) shown = std::max(shown, elbow->shown_arcs);
    const auto is_of_bend = [](const std::string& note) { return note.starts_with("bend "); };
    const auto inferred = std::count_if(basis.notes.begin(), basis.notes.end(), is_of_bend);
    if (shown == 0 || std::size_t(inferred) > shown) return;
    std::erase_if(tube.placed_notes, is_of_bend);
    std::erase_if(tube.placed_notes_reversed, is_of_bend);
  }

  // What the rows do not hold.
  void AddOtherNotes(const Cluster& cluster, const TubeLayer& outer, const TubeChain& basis,
                     CadTube& tube) const {
    double lost = 0;
    // Where the inner surface is followed, the outer one is in pieces.
    const bool follows_outer =
        std::find(outer.chains.begin(), outer.chains.end(), &basis) != outer.chains.end();
    for (const TubeChain* chain : outer.chains) {
      if (chain == &basis || !follows_outer) continue;
      if (chain->spine.length_mm() > outer.radius_mm) lost += chain->spine.length_mm();
    }
    if (lost > 0) {
      tube.notes.push_back(NoteText(
          "%.1f mm of the same pipe about its axis do not meet it: they are not in the rows",
          lost));
    }
    std::vector<const TubeChain*> others;
    for (const TubeChain& chain : chains_) {
      if (std::find(cluster.begin(), cluster.end(), &chain) == cluster.end()) {
        others.push_back(&chain);
      }
    }
    const auto add = [](std::vector<std::string> more, std::vector<std::string>& notes) {
      notes.insert(notes.end(), more.begin(), more.end());
    };
    std::set<int> round;
    for (const TubeChain& chain : chains_) {
      for (const int i : chain.pieces)
        round.insert(PieceOf(i).faces.begin(), PieceOf(i).faces.end());
    }
    add(BranchNotes(tube, others), tube.placed_notes);
    add(LeftOutNotes(tube, others), tube.placed_notes);
    add(PlateNotes(body_, tube, others, round), tube.placed_notes);
    CadTube back = tube;
    back.spine = tube.spine.Reversed();
    std::swap(back.first, back.last);
    add(BranchNotes(back, others), tube.placed_notes_reversed);
    add(LeftOutNotes(back, others), tube.placed_notes_reversed);
    add(PlateNotes(body_, back, others, round), tube.placed_notes_reversed);
  }

  // Of a torus about the corner `at` whose centre line is tighter than the pipe; 0: none is there.
  double TooTightBendMm(const Vector3d& at, double radius_mm) const {
    for (const SurfacePatch& patch : body_.patches) {
      if (patch.kind == PatchKind::kTorus && patch.bend_radius_mm <= patch.radius_mm &&
          std::abs(patch.radius_mm - radius_mm) < MatchToleranceMm(radius_mm) &&
          (patch.origin - at).norm() < 2 * radius_mm) {
        return patch.bend_radius_mm;
      }
    }
    return 0;
  }

  void AddProblems(const TubeChain& outer, CadTube& tube) const {
    for (const ChainEnd* end : {&outer.first, &outer.last}) {
      if (end->kink_deg > 0) {
        const double bend_mm = TooTightBendMm(end->kink_at, outer.radius_mm);
        const std::string what =
            bend_mm > 0
                ? NoteText("straights meet in a bend of %.3f mm radius", bend_mm) +
                      NoteText(" and %.3f degrees, tighter than the pipe's own radius,",
                               end->kink_deg)
                : NoteText("straights meet in a kink of %.3f degrees (a mitre)", end->kink_deg);
        tube.problems.push_back(what + " at " + FilePlace(end->kink_at) +
                                ", which no bender makes");
      }
      const FreeForm form = FreeFormBeyond(body_, pieces_, chains_, outer, *end);
      if (form.name.empty()) continue;
      if (!form.is_end_form(outer.radius_mm)) {
        tube.problems.push_back("a straight goes on at " + FilePlace(form.at) + " as a " +
                                form.name + " that is no cylinder or torus: a bend that is no arc");
      } else {
        AddFormNotes(form, end == &outer.first, tube);
      }
    }
    std::sort(tube.problems.begin(), tube.problems.end());
    tube.problems.erase(std::unique(tube.problems.begin(), tube.problems.end()),
                        tube.problems.end());
  }

  static void AddFormNotes(const FreeForm& form, bool is_first, CadTube& tube) {
    // A dome is told with its end.
    if ((is_first ? tube.first : tube.last).cover == EndCover::kDome) return;
    const double counted_mm = ((is_first ? tube.spine.start : tube.spine.end) - form.at).norm();
    const bool counts = counted_mm > form.along_mm - MatchToleranceMm(tube.pipe_radius_mm);
    const auto told = [&](bool first) {
      return std::string("the ") + (first ? "first" : "last") + " end has a form of its own (" +
             form.name +
             (counts ? "), up to whose end the length counts"
                     : NoteText("), which reaches %.1f mm beyond it", form.along_mm) +
                           NoteText("; of these the length counts %.1f", counted_mm));
    };
    tube.placed_notes.push_back(told(is_first));
    tube.placed_notes_reversed.push_back(told(!is_first));
  }

  // Whether `b` goes on where `a` ends.
  static bool GoesOnAs(const Spine& a, const Spine& b, double radius_mm) {
    const Vector3d gap = b.start - a.end, outward = a.end_direction();
    return outward.cross(b.direction).norm() < 1e-3 && outward.dot(b.direction) > 0 &&
           gap.cross(outward).norm() < MatchToleranceMm(radius_mm) &&
           std::abs(gap.dot(outward)) < 2 * kReducerDiameters * radius_mm;
  }

  // Tubes in line, end to end, with different diameters are one tube that changes its own.
  static void MarkReducers(std::vector<CadTube>& tubes) {
    for (CadTube& a : tubes) {
      for (const CadTube& b : tubes) {
        if (&a == &b || !a.is_bent() || !b.is_bent()) continue;
        const double wide = std::max(a.pipe_radius_mm, b.pipe_radius_mm);
        const Spine a_turned = a.spine.Reversed(), b_turned = b.spine.Reversed();
        if (!GoesOnAs(a.spine, b.spine, wide) && !GoesOnAs(a.spine, b_turned, wide) &&
            !GoesOnAs(a_turned, b.spine, wide) && !GoesOnAs(a_turned, b_turned, wide)) {
          continue;
        }
        a.goes_on = true;
        a.notes.push_back(NoteText(
            "it goes on with a diameter of %.3f mm (a reducer): the rows are those of this "
            "part of it alone",
            2 * b.pipe_radius_mm));
      }
    }
  }

  // The pieces of a tube that is broken by kinks and free bends are one tube.
  static void KeepLongestOfBroken(std::vector<CadTube>& tubes) {
    std::stable_sort(tubes.begin(), tubes.end(), [](const CadTube& a, const CadTube& b) {
      // Of what is as long, to what numbers hold, the widest.
      const auto order = [](const CadTube& t) {
        return std::make_pair(std::round(t.spine.length_mm() * 1e6), t.pipe_radius_mm);
      };
      return order(a) > order(b);
    });
    std::vector<CadTube> kept;
    for (CadTube& tube : tubes) {
      const bool known = std::any_of(kept.begin(), kept.end(), [&](const CadTube& k) {
        return !k.problems.empty() && !tube.problems.empty() &&
               std::abs(k.pipe_radius_mm - tube.pipe_radius_mm) <
                   MatchToleranceMm(k.pipe_radius_mm);
      });
      if (!known) kept.push_back(std::move(tube));
    }
    tubes = std::move(kept);
  }

  static CadTube RingOf(double pipe_radius_mm) {
    CadTube tube;
    tube.is_ring = true;
    tube.pipe_radius_mm = pipe_radius_mm;
    tube.spine.start = tube.spine.end = Vector3d::Zero();
    tube.spine.direction = Vector3d::UnitX();
    tube.problems.emplace_back("it is closed and has no ends, from which rows could count");
    return tube;
  }

  CadTube FreeTube() const {
    std::set<std::string> names;
    Vector3d low = Vector3d::Constant(INFINITY), high = -low;
    for (const SurfacePatch& patch : body_.patches) {
      if (!IsFreeForm(patch)) continue;
      names.insert(patch.name);
      for (const OrientedPoint& s : patch.samples) {
        low = low.cwiseMin(s.point);
        high = high.cwiseMax(s.point);
      }
    }
    CadTube tube;
    tube.spine.start = tube.spine.end = Vector3d::Zero();
    tube.spine.direction = Vector3d::UnitX();
    tube.problems.push_back("its surface is a " + *names.begin() +
                            " that is no cylinder or torus, about " + FilePlace((low + high) / 2) +
                            ": no lines and arcs");
    return tube;
  }

  CadBody& body_;
  long free_forms_ = 0;
  double ring_radius_mm_ = 0;  // 0: the body has no whole torus
  std::vector<TubePiece> pieces_;
  std::vector<TubePiece>
      rings_;  // beads, seals and fillets: whole tori, which are none of the pieces
  std::vector<TubeChain> chains_;
};

}  // namespace

std::vector<CadTube> TubesOfSurfaces(CadBody& body) { return BodyTubes(body).Tubes(); }

}  // namespace bendloop::host
