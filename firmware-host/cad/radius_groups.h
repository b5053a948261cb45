// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "firmware-host/cad/tube_piece.h"

namespace bendloop::host {

// The pieces that go all around a tube, in groups of one radius and one side of the material. Where
// straights that others lead on to scatter, those of several radii that meet are one group.
std::vector<std::vector<int>> RadiusGroups(const std::vector<TubePiece>& pieces);

}  // namespace bendloop::host
