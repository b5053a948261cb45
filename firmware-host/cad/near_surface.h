// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "firmware-host/cad/cad_shape.h"

namespace bendloop::host {

// How far off a cylinder or torus of this pipe radius a B-spline may lie that stands for it [mm].
// Systems approximate to 0.001 mm (CATIA) up to 0.025 mm (NX, Creo), and to more for large pipes;
// a free form is off by far more than that along a pipe's length.
double NearSurfaceMm(double radius_mm);

// The free surfaces of `body` that are cylinders or tori become these: exact ones piece by piece,
// others by face, or along a face as far as one cylinder or torus goes, all pieces around it
// together. Planes go, as bendloop-cad tells of no plane. What is none of them stays as it is.
void RecogniseFreeSurfaces(CadBody& body);

}  // namespace bendloop::host
