// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <set>
#include <string>
#include <vector>

#include "firmware-host/cad/tube_chain.h"
#include "firmware-host/cad/tube_piece.h"

namespace bendloop::host {

// How far the tube goes on beyond its straight `piece`, along `outward` from `origin`: faces that
// join its edge at `at_mm` and theirs in turn, as of a chamfer, a flare, a swage or a cap, while
// they keep near to the axis. `at_mm` where nothing goes on. `others`: faces of other tubes, as
// beyond a reducer.
double FormEndMm(const CadBody& body, const TubePiece& piece, const Eigen::Vector3d& origin,
                 const Eigen::Vector3d& outward, double at_mm, const std::set<int>& others);

// Whether a surface is neither plane nor cylinder, torus, cone or sphere.
bool IsFreeForm(const SurfacePatch& patch);

// The free surfaces that begin where a chain ends.
struct FreeForm {
  std::string name;       // empty: none does
  double reach_mm = 0;    // from the end's centre
  double across_mm = 0;   // from the line that the end points along
  bool leads_on = false;  // to another end of the same pipe
};
FreeForm FreeFormBeyond(const CadBody& body, const std::vector<TubePiece>& pieces,
                        const std::vector<TubeChain>& chains, const TubeChain& chain,
                        const ChainEnd& end);

}  // namespace bendloop::host
