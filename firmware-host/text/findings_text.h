// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "pipeline/tube/measurement.h"

namespace bendloop::host {

// What was found beside the rows, in sentences below them: the fit, the sections of bends, the
// tube's form, and what is on its surface.
std::string FindingsText(const pipeline::Measurement& measurement);

}  // namespace bendloop::host
