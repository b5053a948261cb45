// SPDX-License-Identifier: Apache-2.0
#include "pipeline/structure/neighbour_separation.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "hal/angles.h"
#include "hal/spine.h"
#include "pipeline/structure/structure_moves.h"

namespace bendloop::pipeline {
namespace {

// What a joint between the tube and its neighbour looks like: a bend that no machine makes. By
// trial where nothing else is said.
struct JointSettings {
  // [degrees] A joint turns by more.
  double least_turn_deg = 20.0;
  // [of r_P] No die bends tighter; and the 1 sigma of a bend radius that counts as known.
  double tight = 1.1, known = 0.2;
  // [of r_P] The fit holds a bend radius at r_P (FitBounds): there its sigma says little. [degrees]
  // A lesser turn may be held there by chance, and so may one that tubes of this form would not
  // tell from a bend as wide as the pipe: [times the form] how far its corner lies off that.
  double tightest = 1.001, clear_turn_deg = 30.0, clear_forms = 3.0;
  // [degrees] 1 sigma of angle or rotation beside a segment without samples.
  double vague_deg = 15.0;
  // [of r_P] A shorter segment may be without samples by chance.
  double bare = 1.0;
  // [of r_P] Nodes so near to a joint belong to neither piece.
  double around = 1.5;
  // [of r_P] A shorter piece is no tube.
  double shortest = 4.0;
};
constexpr JointSettings kJoint;

bool IsClear(double turn_deg, const SurfaceFit& fit) {
  const double corner = 1.0 / std::cos(0.5 * turn_deg * hal::kRadiansPerDegree) - 1.0;  // of r_P
  return turn_deg > kJoint.clear_turn_deg &&
         corner * fit.tube.pipe_radius_mm > kJoint.clear_forms * fit.form_mm;
}

std::vector<Eigen::Vector3d> Joints(const SurfaceFit& fit) {
  const auto segments = hal::SpineSegments(fit.tube.program, fit.tube.X_WT);
  const double few = FewSamplesPerMm(fit, segments);
  const auto is_bare = [&](std::size_t k) {  // short ones may be by chance
    return segments[k].length_mm > kJoint.bare * fit.tube.pipe_radius_mm &&
           fit.segment_samples[k] < few * segments[k].length_mm;
  };
  std::vector<Eigen::Vector3d> joints;
  for (std::size_t k = 1; k + 1 < segments.size(); k += 2) {
    const hal::BendRow& row = fit.tube.program.rows[k / 2];
    const double r = fit.tube.pipe_radius_mm;
    const bool tight = (*row.bend_radius_mm < kJoint.tightest * r && IsClear(row.angle_deg, fit)) ||
                       (*row.bend_radius_mm < kJoint.tight * r &&
                        fit.sigma.rows[k / 2].bend_radius_mm.value_or(0.0) < kJoint.known * r);
    const hal::BendRow& sigma = fit.sigma.rows[k / 2];
    const bool vague = std::max(sigma.angle_deg, sigma.rotation_deg) > kJoint.vague_deg &&
                       (is_bare(k - 1) || is_bare(k) || is_bare(k + 1));
    if (row.angle_deg < kJoint.least_turn_deg || !(tight || vague)) continue;
    joints.push_back(segments[k].PointAt(0.5 * segments[k].length_mm));
  }
  return joints;
}

}  // namespace

std::vector<SpinePolygon> PiecesBetweenJoints(const SurfaceFit& fit, const SpinePolygon& polygon,
                                              bool across) {
  const std::vector<Eigen::Vector3d> joints = Joints(fit);
  if (joints.empty()) return {polygon};
  const double around_mm = kJoint.around * fit.tube.pipe_radius_mm;
  const auto from_joint = [&polygon](std::size_t i, const Eigen::Vector3d& joint) {
    return (polygon[i].position_mm - joint).norm();
  };
  std::vector<bool> is_joint(polygon.size(), false);
  for (const Eigen::Vector3d& joint : joints) {
    std::size_t nearest = 0;
    for (std::size_t i = 1; i < polygon.size(); ++i) {
      if (from_joint(i, joint) < from_joint(nearest, joint)) nearest = i;
    }
    // The neighbours along the curve: others may only pass by.
    std::size_t first = nearest, last = nearest;
    while (first > 0 && from_joint(first - 1, joint) < around_mm) --first;
    while (last + 1 < polygon.size() && from_joint(last + 1, joint) < around_mm) ++last;
    for (std::size_t i = first; i <= last; ++i) is_joint[i] = true;
  }
  std::vector<SpinePolygon> pieces(1);
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    if (!is_joint[i]) {
      pieces.back().push_back(polygon[i]);
    } else if (!pieces.back().empty()) {
      pieces.emplace_back();
    }
  }
  std::erase_if(pieces, [&](const SpinePolygon& piece) {
    return piece.size() < 2 || LengthOf(piece) < kJoint.shortest * fit.tube.pipe_radius_mm;
  });
  if (pieces.empty()) return {polygon};
  if (across) pieces = JoinedOverGaps(std::move(pieces), fit.tube.pipe_radius_mm);
  std::stable_sort(pieces.begin(), pieces.end(),
                   [](const auto& a, const auto& b) { return LengthOf(a) > LengthOf(b); });
  return pieces;
}

}  // namespace bendloop::pipeline
