// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <set>
#include <string>
#include <vector>

#include "firmware-host/cad/cad_tube.h"

namespace bendloop::host {

// A sentence for each round thing of `others` (chains of the tube's body that are no part of it)
// that stands on the tube: branches of a T, sockets, bosses. The rows say nothing of them.
std::vector<std::string> BranchNotes(const CadTube& tube,
                                     const std::vector<const TubeChain*>& others);

// A sentence for what else of the tube's body stands farther off its axis than its own surface, and
// is none of `others` and no end's form: a plate, a bracket. `round` are the faces of all chains.
std::vector<std::string> PlateNotes(const CadBody& body, const CadTube& tube,
                                    const std::vector<const TubeChain*>& others,
                                    const std::set<int>& round);

}  // namespace bendloop::host
