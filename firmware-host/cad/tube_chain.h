// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "firmware-host/cad/tube_piece.h"
#include "hal/tube.h"

namespace bendloop::host {

// A bend of a centre line.
struct SpineArc {
  Eigen::Vector3d centre, from, to;
  Eigen::Vector3d tangent_in, tangent_out;
  Eigen::Vector3d normal;  // unit, tangent_in x tangent_out for less than 180 degrees
  double bend_radius_mm = 0;
  double angle_rad = 0;
};

// A centre line of straights and bends.
struct Spine {
  Eigen::Vector3d start, end;
  Eigen::Vector3d direction;  // of the first straight
  std::vector<SpineArc> arcs;
  // Out of the tube at its ends, along the straights themselves, which may be askew to the bends
  // beside them; zero: they are not.
  Eigen::Vector3d start_outward = Eigen::Vector3d::Zero(), end_outward = Eigen::Vector3d::Zero();

  double length_mm() const;
  Eigen::Vector3d end_direction() const {
    return arcs.empty() ? direction : arcs.back().tangent_out;
  }
  Eigen::Vector3d OutwardAt(bool is_first) const;
  Spine Reversed() const;
};

// The tube of that centre line, in place. Straights between bends are measured along their
// tangents; those that the file's rounding makes negative, above -0.01 mm, are 0.
hal::Tube TubeFromSpine(const Spine& spine, double pipe_radius_mm);

// The other way round. `tube` has a bend radius at each bend.
Spine SpineOf(const hal::Tube& tube);

// What goes on beyond the end of a chain, where it does not just end.
struct ChainEnd {
  int piece = -1;
  bool at_to = false;   // of its piece
  double kink_deg = 0;  // another straight of the same radius meets here at this angle
  Eigen::Vector3d kink_at = Eigen::Vector3d::Zero();  // where their axes do
};

// Straights and bends of one radius, end to end.
struct TubeChain {
  double radius_mm = 0;
  double scatter_mm = 0;  // how far its pieces' radii lie apart, beyond a file's rounding
  bool concave = false;
  std::vector<int> pieces;  // in order
  ChainEnd first, last;
  Spine spine;  // up to where its faces reach; ends are cut later (end_cut.h)
  bool is_closed = false;
  double sharpest_joint_deg = 0;  // between neighbours that should be tangent
  double widest_joint_mm = 0;     // how far these lie beside each other
  // And before each other, or into each other, along the straight.
  double widest_gap_mm = 0, widest_overlap_mm = 0;
  // What no face showed, as counted from the first and from the last end.
  std::vector<std::string> notes, notes_reversed;
};

// Chains of the pieces that go all around a tube. Where faces are missing between two of them,
// what must have been there is added to `pieces`: a straight between bends in line, a bend between
// straights that meet at equal distances; `may_infer_bends` is false where free surfaces lie, which
// may be those bends.
std::vector<TubeChain> ChainsOf(std::vector<TubePiece>& pieces, bool may_infer_bends);

}  // namespace bendloop::host
