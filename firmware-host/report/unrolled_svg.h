// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "pipeline/tube/measurement.h"

namespace bendloop::host {

// The tube's surface unrolled and seen from outside, length by angle, with its cuts, holes, slots,
// dents and weld seam; empty where there are none and the ends are square.
std::string UnrolledSvg(const pipeline::Measurement& m);
// The radius of an end by place, the end on the right; empty where it is the pipe's.
std::string EndProfileSvg(const pipeline::EndForm& end, double pipe_radius_mm);

}  // namespace bendloop::host
