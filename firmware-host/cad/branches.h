// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "firmware-host/cad/cad_tube.h"

namespace bendloop::host {

// A sentence for each round thing of `others` (chains of the tube's body that are no part of it)
// that stands on the tube: branches of a T, sockets, bosses. The rows say nothing of them.
std::vector<std::string> BranchNotes(const CadTube& tube,
                                     const std::vector<const TubeChain*>& others);

}  // namespace bendloop::host
