// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "pipeline/spine/spine_polygon.h"
#include "pipeline/spline/shortcut_graph.h"

namespace bendloop::pipeline {

// From the nodes to lines and arcs (Bauer & Polthier 2009, sections 4.5 and 4): vertices and
// tangent lines of the simplified polygon, then the shortcut graph. A line follows the nodes under
// its edge where there are enough of them, which steadies it against the noise of the two end
// nodes. The arcs get twice the tolerance (section 4.5 gives both the same, but the simplified
// vertices already used up one).
ArcLineSpline InitialSpline(const SpinePolygon& polygon, double epsilon_mm);

}  // namespace bendloop::pipeline
