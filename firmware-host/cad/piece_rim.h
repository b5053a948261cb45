// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "firmware-host/cad/tube_piece.h"

namespace bendloop::host {

// A bend ends where the planes of its border cross its centre line, and not at the farthest point
// of a border that leans a little. What leans by more than a degree, is no plane or does not go all
// around stays as it is.
void EndAtBorders(TubePiece& piece);

// Whether a bend's border goes around it at `at`, square or leaning by a degree at most; where one
// cuts askew through a bend, none does.
bool EndsSquare(const TubePiece& bend, double at);

// Whether the faces of two pieces share an edge, by its number or by all of its points.
bool ShareBorder(const TubePiece& a, const TubePiece& b);

}  // namespace bendloop::host
