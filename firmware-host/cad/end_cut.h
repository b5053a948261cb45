// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <optional>

#include "firmware-host/cad/tube_piece.h"

namespace bendloop::host {

// How a straight's end is cut.
struct EndCut {
  double along_mm = 0;  // where the cut's plane meets the axis, along the outward direction
  double oblique_deg = 0;
  // Unit, from the axis to where the tube is longest; zero of a square one, and of a shape whose
  // farthest points lie on no side.
  Eigen::Vector3d longest = Eigen::Vector3d::Zero();
  bool longest_twice = false;            // and as long on the other side, as a saddle
  bool is_plane = true;                  // else `along_mm` is the farthest point, as of a saddle
  double lowest_mm = 0, highest_mm = 0;  // of the edge
  bool reaches_bend = false;  // the edge goes over faces of the bend that the straight begins at
  bool in_bend = false;       // and the axis is cut there, so that nothing of the straight is left
};

// The border of the piece's faces that goes around the axis and lies farthest out; nothing when no
// edge does (loose faces with gaps). `bend`: the one that a straight begins at, if any: an oblique
// cut may end at their joint, or go on over the bend. `origin`: where along_mm is 0; `outward`:
// unit.
std::optional<EndCut> CutOf(const CadBody& body, const TubePiece& piece, const TubePiece* bend,
                            const Eigen::Vector3d& origin, const Eigen::Vector3d& outward);

}  // namespace bendloop::host
