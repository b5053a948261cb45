// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cad/near_end.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "hal/angles.h"

namespace bendloop::host {
namespace {

using Eigen::Vector3d;
// Lines and arcs that are only near lean so far from what they are near to, at most [deg]: less is
// no oblique cut.
constexpr double kNearDeg = 1;
// And lie so many pipe radii beside it, and off its surface.
constexpr double kNearAxisRadii = 0.2, kOffRadii = 0.5;

bool LiesAboutEnd(const CadBody& body, int face, const Vector3d& end, const Vector3d& outward,
                  double radius_mm) {
  return std::any_of(body.edges.begin(), body.edges.end(), [&](const FaceEdge& edge) {
    return edge.face == face &&
           std::any_of(edge.points.begin(), edge.points.end(), [&](const Vector3d& p) {
             const Vector3d d = p - end;
             const double along = d.dot(outward), across = (d - along * outward).norm();
             return std::abs(along) < radius_mm &&
                    std::abs(across - radius_mm) < kOffRadii * radius_mm;
           });
  });
}

// The outer faces about the end of `spine`, and the axis that they have, or the spine's.
TubePiece FacesAbout(const CadBody& body, double radius_mm, const Spine& spine) {
  TubePiece piece;
  piece.radius_mm = radius_mm;
  piece.axis = spine.end_direction();
  const double least_cosine = std::cos(2 * kNearDeg * hal::kRadiansPerDegree);
  for (const SurfacePatch& patch : body.patches) {
    if (patch.kind == PatchKind::kTorus || (patch.kind == PatchKind::kCylinder && patch.concave)) {
      continue;
    }
    if (!LiesAboutEnd(body, patch.face, spine.end, spine.end_direction(), radius_mm)) continue;
    if (patch.kind == PatchKind::kCylinder) {
      const double cosine = patch.axis.dot(spine.end_direction());
      const double beside = (spine.end - patch.origin).cross(patch.axis).norm();
      if (std::abs(cosine) < least_cosine || beside > kNearAxisRadii * radius_mm) continue;
      piece.axis = cosine < 0 ? Vector3d(-patch.axis) : patch.axis;
    }
    piece.faces.push_back(patch.face);
  }
  return piece;
}

}  // namespace

void EndAtBorder(const CadBody& body, double pipe_radius_mm, Spine& spine, TubeEnd& end) {
  const TubePiece piece = FacesAbout(body, pipe_radius_mm, spine);
  const std::optional<EndCut> cut = CutOf(body, piece, nullptr, spine.end, piece.axis);
  if (!cut || std::abs(cut->along_mm) > pipe_radius_mm) return;
  end = {};
  end.is_plane = cut->is_plane;
  if (!cut->is_plane || cut->oblique_deg > kNearDeg) {
    end.oblique_deg = cut->is_plane ? cut->oblique_deg : 0;
    end.longest = cut->longest;
    end.longest_twice = cut->longest_twice;
  }
  end.whole_before_mm = cut->is_plane ? 0 : cut->highest_mm - cut->lowest_mm;
  spine.end += cut->along_mm * spine.end_direction();
}

}  // namespace bendloop::host
