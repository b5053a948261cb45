// SPDX-License-Identifier: Apache-2.0
#include "pipeline/tube/easing.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <span>

#include "hal/angles.h"

namespace bendloop::pipeline {
namespace {

struct KernelSettings {
  // [rad] Of wider bends the corner runs away, and what is said of the tangent points is that of
  // this angle.
  double widest_rad = 150.0 * hal::kRadiansPerDegree;
  // [of a straight between two bends] Each may reach so far into it.
  double room = 0.45;
};
constexpr KernelSettings kKernel;
constexpr double kLeastAngle = 1e-9;  // [rad] keeps a bend of nothing from being divided by

// Turned left in the plane by pieces that begin along +x: where they end.
Eigen::Vector2d EndOf(std::span<const BendPiece> pieces) {
  Eigen::Vector2d at = Eigen::Vector2d::Zero();
  double heading = 0;
  for (const BendPiece& piece : pieces) {
    const double next = heading + piece.angle_rad;
    at += piece.bend_radius_mm *
          Eigen::Vector2d(std::sin(next) - std::sin(heading), std::cos(heading) - std::cos(next));
    heading = next;
  }
  return at;
}

// The pieces of an arc of this length and curvature, whose kernel has its steps `step_mm` apart,
// which is no more than the arc.
std::array<BendPiece, kEasedPieces> Pieces(double arc_mm, double angle_rad, double step_mm,
                                           double reach) {
  const double outer = 0.5 / (reach * reach);  // weight of an outer step
  const double radius_mm = arc_mm / angle_rad;
  std::array<double, kEasedPieces> part, length_mm;
  if (arc_mm >= 2.0 * step_mm) {
    part = {outer, 1.0 - outer, 1.0, 1.0 - outer, outer};
    length_mm = {step_mm, step_mm, arc_mm - 2.0 * step_mm, step_mm, step_mm};
  } else {  // the last step comes after the first one's arc
    part = {outer, 1.0 - outer, 1.0 - 2.0 * outer, 1.0 - outer, outer};
    length_mm = {step_mm, arc_mm - step_mm, 2.0 * step_mm - arc_mm, arc_mm - step_mm, step_mm};
  }
  std::array<BendPiece, kEasedPieces> pieces;
  for (std::size_t i = 0; i < kEasedPieces; ++i) {
    pieces[i] = {length_mm[i] * part[i] / radius_mm, radius_mm / part[i]};
  }
  return pieces;
}

}  // namespace

EasedBend Ease(double angle_rad, double bend_radius_mm, double variance_mm2, double reach) {
  angle_rad = std::max(angle_rad, kLeastAngle);
  double arc_mm = angle_rad * bend_radius_mm;
  double step_mm = reach * std::sqrt(std::max(0.0, variance_mm2));
  if (arc_mm < step_mm) {
    // An arc shorter than the kernel's steps would leave gaps. What counts is the variance of the
    // curvature along the spine: that of a longer arc under a narrower kernel is the same.
    const double square = reach * reach;
    const double of_both_mm2 = arc_mm * arc_mm / 12.0 + variance_mm2;
    arc_mm = step_mm = std::sqrt(square * of_both_mm2 / (square / 12.0 + 1.0));
  }
  EasedBend bend;
  bend.pieces = Pieces(arc_mm, angle_rad, step_mm, reach);
  // Both chords lie along the sum of the tangents; what they differ by the straights lose.
  auto pieces = bend.pieces;
  double angle = angle_rad;
  if (angle > kKernel.widest_rad) {
    angle = kKernel.widest_rad;
    pieces =
        Pieces(angle * bend_radius_mm, angle, std::min(step_mm, angle * bend_radius_mm), reach);
  }
  const double chord_mm = 2.0 * bend_radius_mm * std::sin(0.5 * angle);
  bend.beyond_mm = (EndOf(pieces).norm() - chord_mm) / (2.0 * std::cos(0.5 * angle));
  return bend;
}

Easing EasingWithin(const hal::BendProgram& program, const Easing& easing) {
  Easing within = easing;
  const std::size_t bends = program.bend_count();
  for (std::size_t i = 0; i < within.variance_mm2.size(); ++i) {
    const auto room_mm = [&](std::size_t row) {
      const bool is_end = row == 0 || row == bends;
      return (is_end ? 2.0 : 1.0) * kKernel.room * std::max(0.0, program.rows[row].length_mm);
    };
    const double most_mm = std::min(room_mm(i), room_mm(i + 1)) / easing.reach;
    within.variance_mm2[i] = std::min(within.variance_mm2[i], most_mm * most_mm);
  }
  return within;
}

EasedSpine SpineOf(const hal::BendProgram& program, const hal::Pose& X_WT, const Easing& easing) {
  EasedSpine spine;
  if (easing.empty()) {
    spine.segments = hal::SpineSegments(program, X_WT);
    spine.share.assign(spine.segments.size(), 1.0);
    return spine;
  }
  spine.pieces = kEasedPieces;
  const Easing within = EasingWithin(program, easing);
  hal::BendProgram pieces;  // with straights of nothing between the pieces of a bend
  double beyond_before_mm = 0;
  for (std::size_t i = 0; i < program.rows.size(); ++i) {
    const hal::BendRow& row = program.rows[i];
    if (i == program.bend_count()) {
      pieces.rows.push_back(
          {std::max(0.0, row.length_mm - beyond_before_mm), row.rotation_deg, 0, std::nullopt});
      break;
    }
    const double radius_mm = row.bend_radius_mm.value_or(0.0);
    const EasedBend bend = Ease(row.angle_deg * hal::kRadiansPerDegree, radius_mm,
                                within.variance_mm2[i], within.reach);
    for (std::size_t k = 0; k < kEasedPieces; ++k) {
      const BendPiece& piece = bend.pieces[k];
      const double line_mm =
          k == 0 ? std::max(0.0, row.length_mm - beyond_before_mm - bend.beyond_mm) : 0.0;
      pieces.rows.push_back({line_mm, k == 0 ? row.rotation_deg : 0.0,
                             piece.angle_rad / hal::kRadiansPerDegree, piece.bend_radius_mm});
    }
    beyond_before_mm = bend.beyond_mm;
  }
  const auto all = hal::SpineSegments(pieces, X_WT);
  for (std::size_t k = 0; k < all.size(); ++k) {
    const bool is_arc = k % 2 == 1;
    if (!is_arc && (k / 2) % kEasedPieces != 0) continue;
    spine.segments.push_back(all[k]);
    const std::size_t bend = (k / 2) / kEasedPieces;
    spine.share.push_back(is_arc ? *program.rows[bend].bend_radius_mm / all[k].bend_radius_mm
                                 : 1.0);
  }
  return spine;
}

}  // namespace bendloop::pipeline
