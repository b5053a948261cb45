// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "firmware-host/cad/cad_tube.h"

namespace bendloop::host {

// What is odd about a tube's bends: those that XYZ cannot carry, those with less straight between
// them than a clamp needs, those tighter than benders make them, or rather bows.
std::vector<std::string> BendNotes(const CadTube& tube);

}  // namespace bendloop::host
