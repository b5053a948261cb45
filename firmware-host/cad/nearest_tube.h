// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "firmware-host/cad/cad_tube.h"
#include "hal/result.h"

namespace bendloop::host {

// The lines and arcs nearest to the outer surface of `body`, whose free surfaces are sampled
// densely: measured as a scan would be. `like` gives the pipe radius, where known, and name and
// place. kBadInput when the samples are no tube.
hal::Result<CadTube> NearestTube(const CadBody& body, const CadTube& like);

}  // namespace bendloop::host
