// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cad/chain_notes.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "firmware-host/cad/developed.h"
#include "firmware-host/cad/free_surface.h"
#include "firmware-host/cad/note_text.h"

namespace bendloop::host {
namespace {

using Eigen::Vector3d;
// So many arcs of a B-spline in a row, without a straight between, are no bends but a free form.
constexpr int kMostArcsInARow = 3;
// B-splines with weights are arcs but for the rounding of a file; others lie farther off [mm].
constexpr double kSplineRoundingMm = 1e-6;

// How far from the axis what lies in a piece's gap reaches; 0: nothing does.
double ReachInGap(const CadBody& body, const std::vector<TubePiece>& rings,
                  const Developed& developed, double along_mm, const TubePiece& piece) {
  constexpr double kMostRadii = 3;  // what reaches farther is told as a plate or a branch
  const double half_mm = piece.widest_gap_mm / 2 + MatchToleranceMm(piece.radius_mm);
  double reach_mm = 0;
  for (const FaceEdge& edge : body.edges) {
    for (const Vector3d& p : edge.points) {
      const Place at = developed.Of(p);
      if (std::abs(at.along_mm - along_mm) > half_mm) continue;
      if (at.across_mm < kMostRadii * piece.radius_mm) reach_mm = std::max(reach_mm, at.across_mm);
    }
  }
  for (const TubePiece& ring : rings) {
    const Place at = developed.Of(ring.origin);
    const bool is_about = at.across_mm < MatchToleranceMm(piece.radius_mm);
    if (is_about && !ring.concave && std::abs(at.along_mm - along_mm) < half_mm) {
      reach_mm = std::max(reach_mm, ring.bend_radius_mm + ring.radius_mm);
    }
  }
  return reach_mm;
}

}  // namespace

void AddApartNotes(const TubeChain& chain, CadTube& tube) {
  const double told_mm = MatchToleranceMm(chain.radius_mm);
  if (chain.scatter_mm > 0) {
    tube.notes.push_back(
        NoteText("the diameters of its straights and bends lie up to %.3f mm apart: the part file "
                 "has the straights', on average",
                 2 * chain.scatter_mm));
  }
  if (chain.widest_gap_mm > told_mm) {
    tube.notes.push_back(NoteText(
        "straights and bends begin up to %.3f mm behind each other's ends: the rows bridge "
        "these gaps",
        chain.widest_gap_mm));
  }
  if (chain.widest_overlap_mm > told_mm) {
    tube.notes.push_back(NoteText(
        "straights and bends reach up to %.3f mm into each other: the rows are those of the "
        "bends as they are",
        chain.widest_overlap_mm));
  }
}

void AddSplineNotes(const std::vector<TubePiece>& pieces, const TubeChain& chain, CadTube& tube) {
  double off = 0;
  int in_a_row = 0, most = 0;
  Vector3d middle = Vector3d::Zero();  // of those in a row
  std::vector<Vector3d> row;
  for (const int i : chain.pieces) {
    const TubePiece& piece = pieces[std::size_t(i)];
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
    tube.notes.push_back(NoteText(
        "its B-splines lie up to %.4f mm off the straights and bends they stand for", off));
  } else if (off > kSplineRoundingMm && tube.is_bent()) {
    // So near, and still the rows are the fit's and not the drawing's: angles have odd decimals.
    tube.notes.push_back(
        NoteText("its bends are B-splines, fitted by arcs that they lie up to %.6f mm off", off));
  }
}

void AddGapNotes(const CadBody& body, const std::vector<TubePiece>& pieces,
                 const std::vector<TubePiece>& rings, const TubeChain& chain, CadTube& tube) {
  const Developed developed(tube.spine);
  for (const int i : chain.pieces) {
    const TubePiece& piece = pieces[std::size_t(i)];
    if (piece.widest_gap_mm <= MatchToleranceMm(piece.radius_mm)) continue;
    const double unit = piece.is_arc ? piece.bend_radius_mm : 1;
    const double along_mm =
        developed.Of(piece.PointAt(piece.gap_from + piece.widest_gap_mm / 2 / unit)).along_mm;
    const double reach_mm = ReachInGap(body, rings, developed, along_mm, piece);
    const auto told = [&](double from_end_mm) {
      return NoteText("a gap of %.3f mm between faces", piece.widest_gap_mm) +
             (piece.is_arc ? " of a bend" : " of a straight") +
             NoteText(" at %.1f mm of the developed length is taken as tube; ", from_end_mm) +
             (reach_mm > piece.radius_mm + MatchToleranceMm(piece.radius_mm)
                  ? NoteText("what is there reaches %.1f mm in diameter (a bead, a nut)",
                             2 * reach_mm)
                  : "there may be a groove");
    };
    tube.placed_notes.push_back(told(along_mm));
    tube.placed_notes_reversed.push_back(told(tube.spine.length_mm() - along_mm));
  }
}

}  // namespace bendloop::host
