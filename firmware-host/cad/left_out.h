// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "firmware-host/cad/cad_tube.h"

namespace bendloop::host {

// A sentence for each of `others` (chains of the tube's body that are no part of it) that has the
// tube's own diameter and goes on where the tube ends, though it does not meet it; and one for
// those that lie beside it and are too short for tubes of their own. What stands on the tube is
// told as a branch.
std::vector<std::string> LeftOutNotes(const CadTube& tube,
                                      const std::vector<const TubeChain*>& others);

}  // namespace bendloop::host
