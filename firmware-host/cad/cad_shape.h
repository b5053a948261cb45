// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <string>
#include <string_view>
#include <vector>

#include "hal/result.h"

// What a CAD file holds, as bendloop-cad tells it (schema "bendloop.cad-shape/1", README.md).
// Lengths in mm, in the file's own coordinates with all placements made.
namespace bendloop::host {

enum class PatchKind { kCylinder, kTorus, kFree };

struct OrientedPoint {
  Eigen::Vector3d point, normal;  // the normal points out of the material
  bool in_face = true;            // false: of its surface, beyond the face's edges
};

// A face that is not plane, or the part of it between two places where its curvature may jump.
//   cylinder  origin + radius (cos u x + sin u y) + v axis
//   torus     origin + (bend_radius + radius cos v) (cos u x + sin u y) + radius sin v axis
struct SurfacePatch {
  int face = 0;  // counted from 1 in its body
  PatchKind kind = PatchKind::kFree;
  std::string name;  // "cone", "B-spline surface"
  Eigen::Vector3d origin, axis, x, y;
  double radius_mm = 0, bend_radius_mm = 0;
  double u0 = 0, u1 = 0, v0 = 0, v1 = 0;
  bool concave = false;                // the material is outside of the cylinder or torus
  std::vector<OrientedPoint> samples;  // of a free one
  // Of a free one: which of its face's pieces it is, counted along the surface's two parameters.
  int cell_u = 0, cell_v = 0;
  double off_mm = 0;  // of a free one that was taken for a cylinder or torus: its farthest sample
};

// An edge of a face; a seam, where a face meets itself, is none. A pole or an apex is one of one
// point.
struct FaceEdge {
  int face = 0;
  int edge = 0;                         // the same number: the same edge
  std::vector<Eigen::Vector3d> points;  // along it
};

enum class BodyKind { kSolid, kSurface, kWire };

struct CadBody {
  std::string name;
  std::string occurrence, assembly;  // in which it stands, and what it is called there; or empty
  BodyKind kind = BodyKind::kSolid;
  int faces = 0;
  int joined = 1;           // of so many bodies of the file (body_join.h)
  int repeated = 0;         // so many more bodies of the file are this one, in the same place
  bool recognised = false;  // its free surfaces have been looked at (near_surface.h)
  bool has_tube = false;    // one of TubesOf (cad_tube.h), or what lies in one's bore
  std::vector<SurfacePatch> patches;
  std::vector<FaceEdge> edges;
  std::vector<std::vector<Eigen::Vector3d>> curves;  // of a wire, each smooth
};

struct CadShape {
  std::string format;
  bool names_unit = true;  // of length; OpenCASCADE takes mm where a file names none
  int lost_faces = 0;      // of the file, which OpenCASCADE could not build; 0 of IGES
  std::vector<CadBody> bodies;
};

// `text` is bendloop-cad's answer about `file`. kBadInput with what it says of a file that it could
// not read; kInternal when the answer is no answer.
hal::Result<CadShape> ReadCadShape(std::string_view text, std::string_view file);

}  // namespace bendloop::host
