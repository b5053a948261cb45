// SPDX-License-Identifier: Apache-2.0
#include "pipeline/features/cut_faces.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numeric>

#include "hal/angles.h"
#include "hal/spine.h"
#include "hal/tube_features.h"
#include "pipeline/features/sampling.h"

namespace bendloop::pipeline {
namespace {

struct FaceSettings {
  // [of r_P] Beside [sigma] of kSampling, how far from the border a face may be: of cuts that were
  // not told the border is known to the distance of samples.
  double beside = 0.03;
  // [of a dent's depth] Deeper samples are of its middle, and those in between of its flanks.
  double deep = 0.75, flank = 0.25, of_cells = 3.0;
  // A gaussian has four times as many on its flanks, a flat that was pressed with a sharp edge as
  // many as a third of those of its middle; mixed pixels are fewer.
  double least_flank = 0.15;
  // So many of its middle show whether it has flanks; [sigma] a dent that is no
  // deeper does not.
  double least_deep = 8.0, certain = 10.0;
  // Of all as deep as its middle: where more are of faces, and no fewer than so many, it is theirs.
  double most_of_faces = 0.6, least_of_faces = 3.0;
  // [of its size] and [of r_P] So far around its middle.
  double look = 0.75, look_more = 0.5;
};
constexpr FaceSettings kFaces;

double Tangent(double angle_deg) { return std::tan(angle_deg * hal::kRadiansPerDegree); }

}  // namespace

CutFaces::CutFaces(const hal::Tube& tube, const TubeFeaturesFound& features) {
  const auto segments = hal::SpineSegments(tube.program, tube.X_WT);
  if (segments.empty()) return;
  for (const bool at_start : {true, false}) {
    const auto& found = at_start ? features.first_end : features.last_end;
    const hal::EndCut cut = found ? found->cut : hal::EndCut();
    const double at_mm = at_start ? 0.0 : hal::SpineLength(tube.program);
    const hal::SurfaceFrame frame = hal::FrameAt(segments, at_mm, cut.around_deg);
    const Eigen::Vector3d outward = at_start ? Eigen::Vector3d(-frame.tangent) : frame.tangent;
    const double slope = Tangent(cut.obliquity_deg);
    ends_.push_back({frame.spine_mm, (outward - slope * frame.outward).normalized(),
                     1.5 * tube.pipe_radius_mm * std::hypot(1.0, slope)});
  }
  for (const OpeningFound& found : features.openings) {
    const hal::WallOpening& opening = found.opening;
    const hal::SurfaceFrame frame = hal::FrameAt(segments, opening.along_mm, opening.around_deg);
    const Eigen::Vector3d drill = (frame.outward + Tangent(opening.lean_along_deg) * frame.tangent -
                                   Tangent(opening.lean_around_deg) * frame.sideways())
                                      .normalized();
    openings_.push_back({found.position_mm, frame.outward, drill,
                         (found.direction - found.direction.dot(drill) * drill).normalized(),
                         0.5 * (opening.length_mm - opening.width_mm), 0.5 * opening.width_mm,
                         tube.pipe_radius_mm});
  }
}

double CutFaces::ReachMm(double noise_mm, double pipe_radius_mm) {
  return kSampling.on_surface * noise_mm + kFaces.beside * pipe_radius_mm;
}

bool CutFaces::AreAt(const Eigen::Vector3d& point_mm, double reach_mm) const {
  for (const End& end : ends_) {
    // Of this end, and not of a leg that passes it.
    const Eigen::Vector3d off_mm = point_mm - end.point_mm;
    if (off_mm.norm() < end.near_mm && off_mm.dot(end.normal) > -reach_mm) return true;
  }
  for (const Opening& opening : openings_) {
    Eigen::Vector3d off_mm = point_mm - opening.middle_mm;
    // Of this wall, and not of the one across or of a leg that passes above.
    if (std::abs(off_mm.dot(opening.outward)) > opening.pipe_radius_mm) continue;
    off_mm -= off_mm.dot(opening.drill) * opening.drill;
    const double along_mm = off_mm.dot(opening.along);
    off_mm -= std::clamp(along_mm, -opening.half_line_mm, opening.half_line_mm) * opening.along;
    if (off_mm.norm() < opening.half_width_mm + reach_mm) return true;
  }
  return false;
}

void KeepPressedIn(const hal::Tube& tube, const CutFaces& faces, double noise_mm,
                   std::span<const PointBlock> blocks, std::vector<DentFound>& dents) {
  if (dents.empty()) return;
  const double r_mm = tube.pipe_radius_mm;
  const auto segments = hal::SpineSegments(tube.program, tube.X_WT);
  const std::vector<SegmentFrame> frames = SegmentFrames(segments, 0.0);
  const double face_mm = CutFaces::ReachMm(noise_mm, r_mm);
  std::vector<std::int32_t> candidates;
  std::erase_if(dents, [&](const DentFound& dent) {
    if (dent.depth_mm < kSampling.on_surface * noise_mm) return false;
    const double reach_mm = kFaces.look * dent.size_mm + kFaces.look_more * r_mm;
    // Cells that hold some of the wall, too, make less of how deep the rest is.
    const double most = dent.sigma_mm < 0.5 * dent.depth_mm ? 2.0 - kFaces.deep : kFaces.of_cells;
    double deep = 0, flank = 0, of_faces = 0;
    for (const PointBlock& block : blocks) {
      const double near_mm = reach_mm + block.half_diagonal_mm;
      if ((block.center_mm - dent.position_mm).squaredNorm() > near_mm * near_mm) continue;
      CandidateSegments(block, frames, 2.0 * r_mm, candidates);
      if (candidates.empty()) continue;
      for (const Eigen::Vector3d& point : block.points) {
        if ((point - dent.position_mm).squaredNorm() > reach_mm * reach_mm) continue;
        const double in_mm = r_mm - NearestSegment(point, frames, candidates).distance_mm;
        const double part = in_mm / dent.depth_mm;
        if (part < kFaces.flank || part > most) continue;
        if (faces.AreAt(point, face_mm)) {
          of_faces += part > kFaces.deep ? 1 : 0;
        } else {
          (part > kFaces.deep ? deep : flank) += 1;
        }
      }
    }
    return (of_faces >= kFaces.least_of_faces &&
            of_faces > kFaces.most_of_faces * (deep + of_faces)) ||
           (dent.depth_mm > kFaces.certain * noise_mm && deep >= kFaces.least_deep &&
            flank < kFaces.least_flank * deep);
  });
}

}  // namespace bendloop::pipeline
