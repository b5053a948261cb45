// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cad/tube_end.h"

#include <Eigen/Geometry>
#include <algorithm>

#include "firmware-host/cad/piece_rim.h"

namespace bendloop::host {
namespace {

using Eigen::Vector3d;

void Take(const EndCut& cut, double& at, TubeEnd& end) {
  at = cut.along_mm;
  end.oblique_deg = cut.is_plane ? cut.oblique_deg : 0;
  end.is_plane = cut.is_plane;
  end.longest = cut.longest;
  end.longest_twice = cut.longest_twice;
  end.reaches_bend |= cut.reaches_bend;
}

}  // namespace

TubeEnd TubeEnds::At(const ChainEnd& chain_end, const TubeChain& chain,
                     const std::vector<const TubeChain*>& about, Spine& spine) const {
  TubeEnd end;
  const TubePiece& piece = PieceOf(chain_end.piece);
  // Of the straight that ends here: the bend before it may lean from it.
  const Vector3d origin = spine.end;
  const Vector3d outward =
      chain_end.at_to ? piece.TangentAt(piece.to) : Vector3d(-piece.TangentAt(piece.from));
  const EndView view{origin, outward};
  spine.end_outward = outward;
  double at = 0, whole = 0;
  TakeOwnCut(chain, chain_end, view, at, whole, end);
  if (end.in_bend) {
    spine.end = piece.is_arc ? origin : spine.arcs.back().to;
    return end;
  }
  double plain = at;
  const std::set<int> tubes = FacesOfBentTubes();
  for (bool grew = true; grew;) {
    grew = false;
    const double before = at;
    for (const TubeChain* other : about) {
      if (other == &chain) continue;
      for (const int i : other->pieces) grew |= Extend(*other, i, view, at, end);
    }
    // After a bend whose straight has no face, what goes on is that straight.
    if (piece.is_arc) plain += at - before;
    if (end.oblique_deg != 0) continue;
    const EndForm form = FormBeyond(body_, piece, view, at, tubes);
    if (form.cover != EndCover::kNone) end.cover = form.cover;
    // A flange on a bend is no straight, and what closes it is an end.
    if (piece.is_arc && form.cover != EndCover::kDome && form.cover != EndCover::kPoint) continue;
    grew |= form.end_mm > at + 1e-6;
    at = std::max(at, form.end_mm);
  }
  if (end.is_plane && end.oblique_deg == 0 && !piece.is_arc) {
    at = std::max(at, EdgeBeyond(view, at, piece.radius_mm, tubes));
    const FreeForm form = FreeFormBeyond(body_, pieces_, chains_, chain, chain_end);
    if (form.is_end_form(chain.radius_mm)) {
      at = std::max(at, form.along_mm);
      end.flat = FlatEndOf(body_, view, at, chain.radius_mm);
    }
  }
  const bool is_fitting = at - plain > MatchToleranceMm(piece.radius_mm) / 4;
  end.fitting_mm = is_fitting ? at - plain : 0;
  end.whole_before_mm = end.is_plane ? 0 : at - whole;
  spine.end = origin + at * outward;
  return end;
}

// What the border of the chain's last piece says: a plane that cuts through a bend may leave
// nothing of the straight on the axis.
void TubeEnds::TakeOwnCut(const TubeChain& chain, const ChainEnd& chain_end, const EndView& view,
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

// The bend that the chain has before or behind one of its straights; null: it has none.
const TubePiece* TubeEnds::BendBeside(const TubeChain& chain, int number) const {
  const auto at = std::find(chain.pieces.begin(), chain.pieces.end(), number);
  const auto is_bend = [&](int i) { return PieceOf(i).is_arc && !PieceOf(i).inferred; };
  if (at != chain.pieces.begin() && is_bend(at[-1])) return &PieceOf(at[-1]);
  return at + 1 != chain.pieces.end() && is_bend(at[1]) ? &PieceOf(at[1]) : nullptr;
}

// A bore or a fitting that begins before `at` and goes on.
bool TubeEnds::Extend(const TubeChain& chain, int number, const EndView& view, double& at,
                      TubeEnd& end) const {
  const TubePiece& piece = PieceOf(number);
  const double tolerance = MatchToleranceMm(piece.radius_mm);
  if (piece.is_arc || piece.inferred || piece.axis.cross(view.outward).norm() > 1e-4) return false;
  const Vector3d from = piece.PointAt(piece.from);
  if (view.Across(from) > tolerance) return false;
  const double a = view.Along(from), b = view.Along(piece.PointAt(piece.to));
  const double low = std::min(a, b);
  if (low > at + tolerance) return false;
  const auto cut = CutOf(body_, piece, BendBeside(chain, number), view.origin, view.outward);
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
double TubeEnds::EdgeBeyond(const EndView& view, double at, double radius_mm,
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

// Straights and bends of bent tubes: of others, as beyond a reducer, and of this one, which may
// come back to its own end. None is the form of an end, however near it lies.
std::set<int> TubeEnds::FacesOfBentTubes() const {
  std::set<int> faces;
  for (const TubeChain& chain : chains_) {
    if (chain.spine.arcs.empty()) continue;
    for (const int i : chain.pieces) faces.insert(PieceOf(i).faces.begin(), PieceOf(i).faces.end());
  }
  return faces;
}

}  // namespace bendloop::host
