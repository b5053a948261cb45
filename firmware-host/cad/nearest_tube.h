// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "firmware-host/cad/cad_tube.h"
#include "hal/result.h"

namespace bendloop::host {

// The lines and arcs nearest to the outer surface of `body`, whose free surfaces are sampled
// densely: measured as a scan would be. Of a centre line, to a pipe along its curves. `like` gives
// the pipe radius, where known (of a centre line always), and name and place. kBadInput when the
// samples are no tube.
hal::Result<CadTube> NearestTube(const CadBody& body, const CadTube& like);

}  // namespace bendloop::host
