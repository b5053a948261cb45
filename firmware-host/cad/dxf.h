// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "firmware-host/cad/tube_chain.h"
#include "hal/tube.h"

namespace bendloop::host {

// The tube's centre line as DXF (AC1009, which everything reads; mm): its lines and arcs on layer
// CENTRELINE, its corners as a polyline on layer CORNERS where it has corners (a bend of 180
// degrees has none).
std::string DxfText(const Spine& spine, const hal::Tube& tube);

}  // namespace bendloop::host
