// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "pipeline/tube/measurement.h"

namespace bendloop::host {

// The tube's surface unrolled, length by angle, with its cuts, holes and slots; empty where there
// are none and the ends are square.
std::string UnrolledSvg(const pipeline::Measurement& m);

}  // namespace bendloop::host
