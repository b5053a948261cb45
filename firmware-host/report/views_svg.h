// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "firmware-host/report/scene.h"

namespace bendloop::host {

// Front, top and side view of a part as SVG: for paper, and for browsers without WebGL.
std::string ViewsSvg(const Scene& scene, double scale_mm);

// The colour bar with its numbers [mm], and marks at +-`tolerance_mm` when that is above 0.
std::string ColourBarSvg(double scale_mm, double tolerance_mm);

}  // namespace bendloop::host
