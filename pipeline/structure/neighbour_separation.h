// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "pipeline/fit/surface_fit.h"
#include "pipeline/spine/spine_polygon.h"

namespace bendloop::pipeline {

// What lies close together is connected to one curve, a neighbour or a clamp with the tube as well.
// The joint shows in the fit: a bend as tight as the pipe is thick, which no machine bends, or one
// beside which there are next to no samples, which therefore may be any bend. The curve's pieces
// between such joints, longest first; one piece of all nodes: the tube is whole.
// `across`: pieces on either side of what the joints enclose may belong together, as beside a
// clamp.
std::vector<SpinePolygon> PiecesBetweenJoints(const SurfaceFit& fit, const SpinePolygon& polygon,
                                              bool across);

}  // namespace bendloop::pipeline
