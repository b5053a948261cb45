// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <vector>

#include "pipeline/spine/spine_node.h"

namespace bendloop::pipeline {

// Ordered nodes of one curve; tangents point forward.
using SpinePolygon = std::vector<SpineNode>;

// Orders the nodes into curves: thins nodes that say the same, connects them (NN-Crust), and joins
// pieces over gaps that a line or one arc bridges, as where a clamp hides the tube. Longest first;
// scraps shorter than two pipe radii (clutter) are left out.
std::vector<SpinePolygon> SpinePolygons(std::span<const SpineNode> nodes, double pipe_radius_mm);

// The last part of it: joins pieces over gaps, and leaves out scraps.
std::vector<SpinePolygon> JoinedOverGaps(std::vector<SpinePolygon> pieces, double pipe_radius_mm);

// Whether its nodes lie so much further from their samples that it is no pipe beside the other, as
// the edges of a clamp, which a cylinder can be fitted to as well.
bool IsMuchRougher(const SpinePolygon& polygon, const SpinePolygon& than, double pipe_radius_mm);

// The same curve from its other end.
void Reverse(SpinePolygon& polygon);

// Length along the nodes [mm], gaps included.
double LengthOf(const SpinePolygon& polygon);

}  // namespace bendloop::pipeline
