// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "firmware-host/cad/tube_chain.h"

namespace bendloop::host {

// The chains about one axis that have one radius: a surface of a tube, whole or in pieces.
struct TubeLayer {
  double radius_mm = 0, length_mm = 0;
  std::size_t arcs = 0;
  // What faces show of it: its straights, out of how much the chains have, and how many bends.
  double shown_straight_mm = 0, straight_mm = 0;
  std::size_t shown_arcs = 0;
  bool concave = false;
  std::vector<const TubeChain*> chains;
};

std::vector<TubeLayer> LayersOf(const std::vector<const TubeChain*>& cluster,
                                const std::vector<TubePiece>& pieces);

// The widest that goes along most of the tube; null: there is none. A silencer about a bent pipe is
// longer than the pipe, and has no bends; elbows that are wider than the pipe have no straights.
const TubeLayer* OuterOf(const std::vector<TubeLayer>& layers);

// The widest below `outer` that goes along half of it; null: there is none. A solid says by its
// faces' sides which surface may be a bore.
const TubeLayer* InnerOf(const std::vector<TubeLayer>& layers, const TubeLayer& outer, bool solid);

// The chain that shows most of the tube: the outer surface's, unless it lacks bends that the inner
// one's has.
const TubeChain& BasisOf(const TubeLayer& outer, const TubeLayer* inner);

// Bends of another diameter than the straights', outside or in the bore: elbows that are put or
// drawn between them. `inner`: null: there is none.
std::vector<const TubeLayer*> ElbowsOf(const std::vector<TubeLayer>& layers, const TubeLayer& outer,
                                       const TubeLayer* inner);
std::vector<std::string> ElbowNotes(const std::vector<const TubeLayer*>& elbows,
                                    const TubeLayer& outer, const TubeLayer* inner);

// How far around the layer's faces go, in that of its pieces where they go farthest [deg].
double MostAroundDeg(const TubeLayer& layer, const std::vector<TubePiece>& pieces);

}  // namespace bendloop::host
