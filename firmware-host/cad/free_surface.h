// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "firmware-host/cad/cad_shape.h"

namespace bendloop::host {

// Samples nearer to a cylinder or torus than this are one: B-splines with weights are exact. Others
// come near to it alone (near_surface.h).
inline constexpr double kExactSurfaceMm = 1e-4;

// How far off samples may lie [mm] of a surface with this pipe radius [mm].
using SurfaceLimit = double (*)(double radius_mm);

// Where the axis of a patch's cylinder, or of its surface of revolution, must be, if it is one.
struct SurfaceGuess {
  bool is_plane = false, has_revolution = false;
  double across = 0;  // mean square of the normals along cylinder_axis; 0: of a cylinder
  double size_mm = 0;
  Eigen::Vector3d mean, cylinder_axis, revolution_axis, on_revolution_axis;
};
SurfaceGuess GuessSurface(const SurfacePatch& patch);

// The patch becomes a cylinder, or a torus, about the axis when all samples lie within `limit`.
bool BecomeCylinder(SurfacePatch& patch, const Eigen::Vector3d& axis, const Eigen::Vector3d& mean,
                    SurfaceLimit limit);
bool BecomeTorus(SurfacePatch& patch, const Eigen::Vector3d& axis, const Eigen::Vector3d& at,
                 SurfaceLimit limit);

// Whether a patch is a plane by another name: an end, or a flange's face.
bool IsPlane(const SurfacePatch& patch);

// A patch of samples that lie on a cylinder or torus within kExactSurfaceMm becomes that cylinder
// or torus; any other stays as it is. The axis comes from the normals: those of a surface of
// revolution all meet it, a linear condition on the axis' line coordinates.
void RecogniseFreeSurface(SurfacePatch& patch);

}  // namespace bendloop::host
