// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "firmware-host/cad/cad_tube.h"

namespace bendloop::host {

// What the rows of `tube` bridge between the straights and bends of its chain, which are of
// `pieces`: radii that scatter, gaps, overlaps.
void AddApartNotes(const TubeChain& chain, CadTube& tube);

// How near the chain's B-splines come to the straights and bends that they stand for, and where
// that is no tube: one of its problems.
void AddSplineNotes(const std::vector<TubePiece>& pieces, const TubeChain& chain, CadTube& tube);

// Gaps between the faces of one piece. `rings`: whole tori of the body, as beads and seals are.
void AddGapNotes(const CadBody& body, const std::vector<TubePiece>& pieces,
                 const std::vector<TubePiece>& rings, const TubeChain& chain, CadTube& tube);

}  // namespace bendloop::host
