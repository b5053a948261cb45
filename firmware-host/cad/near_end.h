// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "firmware-host/cad/cad_tube.h"

namespace bendloop::host {

// Of the lines and arcs nearest to a body: moves the end of `spine` to where the border of the
// body's outer faces about it lies, and tells how that is cut. Leaves both as they are where no
// border goes around it.
void EndAtBorder(const CadBody& body, double pipe_radius_mm, Spine& spine, TubeEnd& end);

}  // namespace bendloop::host
