// SPDX-License-Identifier: Apache-2.0
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numeric>
#include <set>
#include <utility>

#include "firmware-host/cad/branches.h"
#include "firmware-host/cad/cad_tube.h"
#include "firmware-host/cad/developed.h"
#include "firmware-host/cad/end_form.h"
#include "firmware-host/cad/free_surface.h"
#include "firmware-host/cad/left_out.h"
#include "firmware-host/cad/near_surface.h"
#include "firmware-host/cad/piece_rim.h"
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
// So many arcs of a B-spline in a row, without a straight between, are no bends but a free form.
constexpr int kMostArcsInARow = 3;
// B-splines with weights are arcs but for the rounding of a file; others lie farther off [mm].
constexpr double kSplineRoundingMm = 1e-6;
// Joints below this [deg] are tangent.
constexpr double kTangentDeg = 0.02;

std::string Text(const char* format, double value) {
  char text[120];
  std::snprintf(text, sizeof text, format, value);
  return text;
}

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
          Text("straights and bends meet at up to %.3f degrees", basis.sharpest_joint_deg));
    }
    if (basis.widest_joint_mm > MatchToleranceMm(basis.radius_mm)) {
      tube.notes.push_back(
          Text("straights and bends meet up to %.3f mm beside each other", basis.widest_joint_mm));
    }
    AddApartNotes(basis, tube);
    SetEnd(cluster, basis, basis.last, tube.spine, tube.last);
    Spine turned = tube.spine.Reversed();
    SetEnd(cluster, basis, basis.first, turned, tube.first);
    tube.spine = turned.Reversed();
    // Without a bore a flat end is a bar's, or that of a tube whose bore the file leaves out.
    for (TubeEnd* end : {&tube.first, &tube.last}) {
      if (end->cover == EndCover::kFlat && !tube.wall_mm) end->cover = EndCover::kNone;
    }
    AddProblems(basis, tube);
    AddSplineNotes(basis, tube);
    const bool long_enough = tube.spine.length_mm() >= 2 * kFewestDiameters * tube.pipe_radius_mm;
    // A straight hole through a block is no tube.
    const bool is_bore = outer->concave && body_.kind == BodyKind::kSolid;
    const double around =
        std::max(MostAroundDeg(*outer, pieces_), inner ? MostAroundDeg(*inner, pieces_) : 0);
    tube.is_round = around >= kRoundAroundDeg;
    if (!tube.is_bent() && (is_bore || !long_enough || !tube.is_round)) return std::nullopt;
    if (!tube.is_round) {
      tube.problems.push_back(Text(
          "its profile is not round: its curved sides go %.0f degrees around, at most", around));
    }
    AddGapNotes(basis, tube);
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

  // What its pieces leave between them, and gaps and overlaps along it, which its rows bridge.
  static void AddApartNotes(const TubeChain& basis, CadTube& tube) {
    const double told_mm = MatchToleranceMm(basis.radius_mm);
    if (basis.scatter_mm > 0) {
      tube.notes.push_back(
          Text("the diameters of its straights and bends lie up to %.3f mm apart: the part file "
               "has the straights', on average",
               2 * basis.scatter_mm));
    }
    if (basis.widest_gap_mm > told_mm) {
      tube.notes.push_back(
          Text("straights and bends begin up to %.3f mm behind each other's ends: the rows bridge "
               "these gaps",
               basis.widest_gap_mm));
    }
    if (basis.widest_overlap_mm > told_mm) {
      tube.notes.push_back(
          Text("straights and bends reach up to %.3f mm into each other: the rows are those of the "
               "bends as they are",
               basis.widest_overlap_mm));
    }
  }

  // How near B-splines come to what they stand for, and where that is no tube.
  void AddSplineNotes(const TubeChain& basis, CadTube& tube) const {
    double off = 0;
    int in_a_row = 0, most = 0;
    Vector3d middle = Vector3d::Zero();  // of those in a row
    std::vector<Vector3d> row;
    for (const int i : basis.pieces) {
      const TubePiece& piece = PieceOf(i);
      off = std::max(off, piece.off_mm);
      in_a_row = piece.is_arc && piece.off_mm > kExactSurfaceMm ? in_a_row + 1 : 0;
      if (in_a_row == 0) row.clear();
      if (in_a_row > 0) row.push_back(piece.PointAt((piece.from + piece.to) / 2));
      if (in_a_row <= most) continue;
      most = in_a_row;
      middle = row[row.size() / 2];
    }
    if (most > kMostArcsInARow) {
      tube.problems.push_back("it bends as a B-spline, about " + FilePlace(middle) + ": " +
                              std::to_string(most) +
                              " arcs in a row, without a straight between, would be near to it");
    } else if (off > kExactSurfaceMm) {
      tube.notes.push_back(
          Text("its B-splines lie up to %.4f mm off the straights and bends they stand for", off));
    } else if (off > kSplineRoundingMm && tube.is_bent()) {
      // So near, and still the rows are the fit's and not the drawing's: angles have odd decimals.
      tube.notes.push_back(
          Text("its bends are B-splines, fitted by arcs that they lie up to %.6f mm off", off));
    }
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
      tube.notes.push_back(
          Text("%.1f mm of the same pipe about its axis do not meet it: they are not in the rows",
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

  void AddGapNotes(const TubeChain& outer, CadTube& tube) const {
    const Developed developed(tube.spine);
    for (const int i : outer.pieces) {
      const TubePiece& piece = PieceOf(i);
      if (piece.widest_gap_mm <= MatchToleranceMm(piece.radius_mm)) continue;
      const double unit = piece.is_arc ? piece.bend_radius_mm : 1;
      const double along_mm =
          developed.Of(piece.PointAt(piece.gap_from + piece.widest_gap_mm / 2 / unit)).along_mm;
      const double reach_mm = ReachInGap(developed, along_mm, piece);
      const auto told = [&](double from_end_mm) {
        return Text("a gap of %.3f mm between faces", piece.widest_gap_mm) +
               (piece.is_arc ? " of a bend" : " of a straight") +
               Text(" at %.1f mm of the developed length is taken as tube; ", from_end_mm) +
               (reach_mm > piece.radius_mm + MatchToleranceMm(piece.radius_mm)
                    ? Text("what is there reaches %.1f mm in diameter (a bead, a nut)",
                           2 * reach_mm)
                    : "there may be a groove");
      };
      tube.placed_notes.push_back(told(along_mm));
      tube.placed_notes_reversed.push_back(told(tube.spine.length_mm() - along_mm));
    }
  }

  // How far from the axis what lies in a piece's gap reaches; 0: nothing does.
  double ReachInGap(const Developed& developed, double along_mm, const TubePiece& piece) const {
    constexpr double kMostRadii = 3;  // what reaches farther is told as a plate or a branch
    const double half_mm = piece.widest_gap_mm / 2 + MatchToleranceMm(piece.radius_mm);
    double reach_mm = 0;
    for (const FaceEdge& edge : body_.edges) {
      for (const Vector3d& p : edge.points) {
        const Place at = developed.Of(p);
        if (std::abs(at.along_mm - along_mm) > half_mm) continue;
        if (at.across_mm < kMostRadii * piece.radius_mm)
          reach_mm = std::max(reach_mm, at.across_mm);
      }
    }
    for (const TubePiece& ring : rings_) {
      const Place at = developed.Of(ring.origin);
      const bool is_about = at.across_mm < MatchToleranceMm(piece.radius_mm);
      if (is_about && !ring.concave && std::abs(at.along_mm - along_mm) < half_mm) {
        reach_mm = std::max(reach_mm, ring.bend_radius_mm + ring.radius_mm);
      }
    }
    return reach_mm;
  }

  // What the border of the chain's last piece says: a plane that cuts through a bend may leave
  // nothing of the straight on the axis.
  void TakeOwnCut(const TubeChain& chain, const ChainEnd& chain_end, const EndView& view,
                  double& at_mm, double& whole_mm, TubeEnd& end) const {
    const TubePiece& piece = PieceOf(chain_end.piece);
    if (piece.inferred) return;
    if (piece.is_arc) {
      end.in_bend = !EndsSquare(piece, chain_end.at_to ? piece.to : piece.from);
      return;
    }
    const TubePiece* bend = BendBeside(chain, chain_end.piece);
    const auto cut = CutOf(body_, piece, bend, view.origin, view.outward);
    if (!cut) return;
    if (cut->in_bend) {
      end.in_bend = true;
      return;
    }
    Take(*cut, at_mm, end);
    whole_mm = cut->lowest_mm;
  }

  // Where the tube ends on `spine`'s last straight: at the cut of what reaches farthest about it.
  void SetEnd(const Cluster& cluster, const TubeChain& outer, const ChainEnd& chain_end,
              Spine& spine, TubeEnd& end) const {
    const TubePiece& piece = PieceOf(chain_end.piece);
    // Of the straight that ends here: the bend before it may lean from it.
    const Vector3d origin = spine.end;
    const Vector3d outward =
        chain_end.at_to ? piece.TangentAt(piece.to) : Vector3d(-piece.TangentAt(piece.from));
    spine.end_outward = outward;
    double at = 0, whole = 0;
    TakeOwnCut(outer, chain_end, {origin, outward}, at, whole, end);
    if (end.in_bend) {
      spine.end = piece.is_arc ? origin : spine.arcs.back().to;
      return;
    }
    double plain = at;
    const std::set<int> tubes = FacesOfBentTubes();
    for (bool grew = true; grew;) {
      grew = false;
      const double before = at;
      for (const TubeChain* chain : cluster) {
        if (chain == &outer) continue;
        for (const int i : chain->pieces) grew |= Extend(*chain, i, origin, outward, at, end);
      }
      // After a bend whose straight has no face, what goes on is that straight.
      if (piece.is_arc) plain += at - before;
      if (end.oblique_deg != 0) continue;
      const EndForm form = FormBeyond(body_, piece, {origin, outward}, at, tubes);
      if (form.cover != EndCover::kNone) end.cover = form.cover;
      // A flange on a bend is no straight, and what closes it is an end.
      if (piece.is_arc && form.cover != EndCover::kDome && form.cover != EndCover::kPoint) continue;
      grew |= form.end_mm > at + 1e-6;
      at = std::max(at, form.end_mm);
    }
    if (end.is_plane && end.oblique_deg == 0 && !piece.is_arc) {
      at = std::max(at, EdgeBeyond({origin, outward}, at, piece.radius_mm, tubes));
      const FreeForm form = FreeFormBeyond(body_, pieces_, chains_, outer, chain_end);
      if (form.is_end_form(outer.radius_mm)) {
        at = std::max(at, form.along_mm);
        end.flat = FlatEndOf(body_, {origin, outward}, at, outer.radius_mm);
      }
    }
    const bool is_fitting = at - plain > MatchToleranceMm(piece.radius_mm) / 4;
    end.fitting_mm = is_fitting ? at - plain : 0;
    end.whole_before_mm = end.is_plane ? 0 : at - whole;
    spine.end = origin + at * outward;
  }

  // The bend that the chain has before or behind one of its straights; null: it has none.
  const TubePiece* BendBeside(const TubeChain& chain, int number) const {
    const auto at = std::find(chain.pieces.begin(), chain.pieces.end(), number);
    const auto is_bend = [&](int i) { return PieceOf(i).is_arc && !PieceOf(i).inferred; };
    if (at != chain.pieces.begin() && is_bend(at[-1])) return &PieceOf(at[-1]);
    return at + 1 != chain.pieces.end() && is_bend(at[1]) ? &PieceOf(at[1]) : nullptr;
  }

  static void Take(const EndCut& cut, double& at, TubeEnd& end) {
    at = cut.along_mm;
    end.oblique_deg = cut.is_plane ? cut.oblique_deg : 0;
    end.is_plane = cut.is_plane;
    end.longest = cut.longest;
    end.longest_twice = cut.longest_twice;
    end.reaches_bend |= cut.reaches_bend;
  }

  // A bore or a fitting that begins before `at` and goes on.
  bool Extend(const TubeChain& chain, int number, const Vector3d& origin, const Vector3d& outward,
              double& at, TubeEnd& end) const {
    const TubePiece& piece = PieceOf(number);
    const double tolerance = MatchToleranceMm(piece.radius_mm);
    if (piece.is_arc || piece.inferred || piece.axis.cross(outward).norm() > 1e-4) return false;
    const Vector3d d = piece.PointAt(piece.from) - origin;
    if ((d - d.dot(outward) * outward).norm() > tolerance) return false;
    const double a = d.dot(outward), b = (piece.PointAt(piece.to) - origin).dot(outward);
    const double low = std::min(a, b);
    if (low > at + tolerance) return false;
    const auto cut = CutOf(body_, piece, BendBeside(chain, number), origin, outward);
    if (cut && cut->in_bend) return false;
    const double to = cut ? cut->along_mm : std::max(a, b);
    if (to < at + 1e-6) return false;
    if (cut) {
      Take(*cut, at, end);
    } else {
      at = to;
    }
    return true;
  }

  // A chamfer or a rounded lip: edges within the pipe radius of the axis that lie farther out, by
  // less than a pipe radius, and not on a bent tube: this one may come back to its own end.
  // `tubes`: faces of such.
  double EdgeBeyond(const EndView& view, double at, double radius_mm,
                    const std::set<int>& tubes) const {
    std::set<int> of_tubes;
    for (const FaceEdge& edge : body_.edges) {
      if (tubes.contains(edge.face)) of_tubes.insert(edge.edge);
    }
    std::vector<const TubePiece*> elsewhere;
    for (const TubeChain& chain : chains_) {
      if (chain.spine.arcs.empty()) continue;
      for (const int i : chain.pieces) {
        const TubePiece& piece = PieceOf(i);
        const bool is_here = !piece.is_arc && piece.axis.cross(view.outward).norm() < 1e-4 &&
                             view.Across(piece.origin) < MatchToleranceMm(radius_mm);
        if (!is_here) elsewhere.push_back(&piece);
      }
    }
    double farthest = at;
    for (const FaceEdge& edge : body_.edges) {
      if (of_tubes.contains(edge.edge)) continue;
      for (const Vector3d& p : edge.points) {
        const double along = view.Along(p);
        if (along <= farthest || along > at + radius_mm) continue;
        if (view.Across(p) > radius_mm + MatchToleranceMm(radius_mm)) continue;
        const bool is_elsewhere =
            std::any_of(elsewhere.begin(), elsewhere.end(), [&](const TubePiece* piece) {
              return piece->HasOnSurface(p, MatchToleranceMm(piece->radius_mm));
            });
        if (!is_elsewhere) farthest = along;
      }
    }
    return farthest;
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
                ? Text("straights meet in a bend of %.3f mm radius", bend_mm) +
                      Text(" and %.3f degrees, tighter than the pipe's own radius,", end->kink_deg)
                : Text("straights meet in a kink of %.3f degrees (a mitre)", end->kink_deg);
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
                     : Text("), which reaches %.1f mm beyond it", form.along_mm) +
                           Text("; of these the length counts %.1f", counted_mm));
    };
    tube.placed_notes.push_back(told(is_first));
    tube.placed_notes_reversed.push_back(told(!is_first));
  }

  // Straights and bends of bent tubes: of others, as beyond a reducer, and of this one, which may
  // come back to its own end. None is the form of an end, however near it lies.
  std::set<int> FacesOfBentTubes() const {
    std::set<int> faces;
    for (const TubeChain& chain : chains_) {
      if (chain.spine.arcs.empty()) continue;
      for (const int i : chain.pieces)
        faces.insert(PieceOf(i).faces.begin(), PieceOf(i).faces.end());
    }
    return faces;
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
        a.notes.push_back(
            Text("it goes on with a diameter of %.3f mm (a reducer): the rows are those of this "
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
