// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <set>
#include <string>
#include <vector>

#include "firmware-host/cad/cad_tube.h"

namespace bendloop::host {

// A sentence for each round bore that is drilled into the tube and is none of its openings: blind,
// countersunk, through a bar, in what stands on it, in the form or the flange at an end. `known`:
// faces of which something else is told; those of these bores are added.
std::vector<std::string> BoreNotes(const CadBody& body, const CadTube& tube, std::set<int>& known);

}  // namespace bendloop::host
