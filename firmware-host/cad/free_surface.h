// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "firmware-host/cad/cad_shape.h"

namespace bendloop::host {

// Samples nearer to a cylinder or torus than this are one: CAD systems write swept tubes as
// B-splines that are exact, or approximate them to 1e-3 mm and worse, which is told.
inline constexpr double kExactSurfaceMm = 1e-4;

// A patch of samples that lie on a cylinder or torus within kExactSurfaceMm becomes that cylinder
// or torus; any other stays as it is. The axis comes from the normals: those of a surface of
// revolution all meet it, a linear condition on the axis' line coordinates.
void RecogniseFreeSurface(SurfacePatch& patch);

}  // namespace bendloop::host
