// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <optional>
#include <set>
#include <vector>

#include "firmware-host/cad/cad_shape.h"
#include "firmware-host/cad/end_cut.h"
#include "firmware-host/cad/end_form.h"
#include "firmware-host/cad/flat_end.h"
#include "firmware-host/cad/tube_chain.h"

namespace bendloop::host {

// An end of the tube.
struct TubeEnd {
  double oblique_deg = 0;  // of the cut; 0: square
  bool is_plane = true;    // false: cut to a shape, and the length is up to its farthest point
  double fitting_mm = 0;   // the plain outer surface ends so far before it
  EndCover cover = EndCover::kNone;  // kFlat: of a tube whose bore the file shows
  // Of one that is no plane: up to so far before it the outer surface goes all around.
  double whole_before_mm = 0;
  // Of an oblique cut, and of a shape: unit, from the axis to where the tube is longest; zero: that
  // is nowhere. `longest_twice`: and on the other side.
  Eigen::Vector3d longest = Eigen::Vector3d::Zero();
  bool longest_twice = false;
  bool reaches_bend = false;  // its plane cuts into the bend beside it
  // Its cut goes through the bend where the rows end: the bend counts to its farthest point.
  bool in_bend = false;
  std::optional<FlatEnd> flat;
};

// Where the tubes of a body end. All that it is made of outlives it.
class TubeEnds {
 public:
  TubeEnds(const CadBody& body, const std::vector<TubePiece>& pieces,
           const std::vector<TubeChain>& chains)
      : body_(body), pieces_(pieces), chains_(chains) {}

  // The end that `spine` has on its last straight, at the cut of what reaches farthest about it,
  // and lets it end there. `about`: the chains about its axis, of which it follows `chain`.
  TubeEnd At(const ChainEnd& chain_end, const TubeChain& chain,
             const std::vector<const TubeChain*>& about, Spine& spine) const;

 private:
  const TubePiece& PieceOf(int i) const { return pieces_[std::size_t(i)]; }
  const TubePiece* BendBeside(const TubeChain& chain, int number) const;
  void TakeOwnCut(const TubeChain& chain, const ChainEnd& chain_end, const EndView& view,
                  double& at_mm, double& whole_mm, TubeEnd& end) const;
  bool Extend(const TubeChain& chain, int number, const EndView& view, double& at_mm,
              TubeEnd& end) const;
  double EdgeBeyond(const EndView& view, double at_mm, double radius_mm,
                    const std::set<int>& tubes) const;
  std::set<int> FacesOfBentTubes() const;

  const CadBody& body_;
  const std::vector<TubePiece>& pieces_;
  const std::vector<TubeChain>& chains_;
};

}  // namespace bendloop::host
