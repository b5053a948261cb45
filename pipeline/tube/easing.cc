// SPDX-License-Identifier: Apache-2.0
#include "pipeline/tube/easing.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>
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
  // [of the kernel's standard deviation] How far pieces reach beyond the sharp arc; what would lie
  // beyond is in the last one. By trial: with 2.2 lengths of tubes that ease by a pipe radius err
  // by 1.7 of their sigmas where noise is small, and with 3 nineteen pieces are too long.
  double tails = 2.6;
  // [of it] What a straight that is too short for them leaves of them, at least.
  double least_tails = 1.5;
  // [of the standard deviation] A shorter arc is as one of this length under a narrower kernel.
  double least_arc = 0.3;
  // [of the variance] The box' share of the kernel's, where the root of kurtosis would leave it
  // nothing or all.
  double least_box = 0.05, most_box = 0.999;
  // [of the bend's angle] That each piece turns at least.
  double least_turn = 2e-5;
  // [of the variance of bend and kernel] The least of a kernel that may be divided by.
  double least_variance = 1e-6;
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

// [mm^2] Integral of the integral of a Gaussian's distribution function, up to s.
double TwiceIntegrated(double s_mm, double sigma_mm) {
  const double z = s_mm / sigma_mm;
  const double density = std::exp(-0.5 * z * z) / std::sqrt(2.0 * std::numbers::pi);
  const double below = 0.5 * std::erfc(-z / std::numbers::sqrt2);
  return 0.5 * ((s_mm * s_mm + sigma_mm * sigma_mm) * below + s_mm * sigma_mm * density);
}

// A bend's curvature along the spine: the sharp arc's box, smoothed by a box and a Gaussian.
struct CurvatureProfile {
  double arc_mm, box_mm, sigma_mm;

  // What is turned of the bend's angle `s_mm` from its middle: 0 to 1.
  double TurnedAt(double s_mm) const {
    const auto of_box_mm2 = [&](double s) {
      return TwiceIntegrated(s + 0.5 * box_mm, sigma_mm) -
             TwiceIntegrated(s - 0.5 * box_mm, sigma_mm);
    };
    return (of_box_mm2(s_mm + 0.5 * arc_mm) - of_box_mm2(s_mm - 0.5 * arc_mm)) / (arc_mm * box_mm);
  }
};

CurvatureProfile ProfileOf(double arc_mm, double variance_mm2, double reach) {
  const double of_both_mm2 = arc_mm * arc_mm / 12.0 + variance_mm2;
  variance_mm2 = std::max(variance_mm2, kKernel.least_variance * of_both_mm2);
  if (arc_mm < kKernel.least_arc * std::sqrt(variance_mm2)) {
    arc_mm = kKernel.least_arc * std::sqrt(of_both_mm2);
    variance_mm2 = of_both_mm2 - arc_mm * arc_mm / 12.0;
  }
  // A box that has this share of a variance takes 1.2 of its square from a Gaussian's kurtosis.
  const double box = std::clamp(std::sqrt(std::max(0.0, (3.0 - reach * reach) / 1.2)),
                                kKernel.least_box, kKernel.most_box);
  return {arc_mm, std::sqrt(12.0 * box * variance_mm2), std::sqrt((1.0 - box) * variance_mm2)};
}

// Arcs as long as each other where the curvature rises and falls, and one between. Each turns as
// far as the profile does along it, and the variance of their curvature is the profile's. Headings
// that were the profile's where arcs meet would lie beside it between them, all to one side: by a
// twelfth of their second differences, on average, which would make all of the bend tighter.
EasedPieces Pieces(double arc_mm, double angle_rad, double variance_mm2, double reach,
                   double room_mm) {
  const CurvatureProfile profile = ProfileOf(arc_mm, variance_mm2, reach);
  const double kernel_mm2 =
      profile.box_mm * profile.box_mm / 12.0 + profile.sigma_mm * profile.sigma_mm;
  // Without any room, as far as the narrowest kernel: no piece turns on the spot.
  const double least_mm = kKernel.least_tails * std::sqrt(kKernel.least_variance *
                                                          (arc_mm * arc_mm / 12.0 + variance_mm2));
  const double ramp_mm =
      std::max(least_mm, std::min(kKernel.tails * std::sqrt(kernel_mm2), room_mm));
  const double end_mm = 0.5 * profile.arc_mm + ramp_mm;
  const double flat_mm =
      std::max(0.5 * profile.arc_mm - ramp_mm, end_mm / static_cast<double>(kEasedPieces));
  constexpr std::size_t kSide = kEasedPieces / 2;
  const double step_mm = (end_mm - flat_mm) / kSide;
  std::array<double, kSide + 3> exact;  // from one step before the first place on
  for (std::size_t i = 0; i < exact.size(); ++i) {
    exact[i] = profile.TurnedAt(-end_mm + (static_cast<double>(i) - 1.0) * step_mm);
  }
  std::array<double, kEasedPieces + 1> at_mm, turned;
  for (std::size_t i = 0; i <= kSide; ++i) {
    at_mm[i] = -end_mm + static_cast<double>(i) * step_mm;
    // Where a ramp begins at once the piece before it would turn the other way; and what hardly
    // turns has a radius that nobody can calculate with.
    turned[i] = i == 0 ? 0.0
                       : std::max(turned[i - 1] + kKernel.least_turn,
                                  (14.0 * exact[i + 1] - exact[i] - exact[i + 2]) / 12.0);
    at_mm[kEasedPieces - i] = -at_mm[i];
    turned[kEasedPieces - i] = 1.0 - turned[i];
  }
  double spread_mm2 = 0;
  for (std::size_t i = 0; i < kEasedPieces; ++i) {
    const double a = at_mm[i], b = at_mm[i + 1];
    spread_mm2 += (turned[i + 1] - turned[i]) * (a * a + a * b + b * b) / 3.0;
  }
  const double scale = std::sqrt((arc_mm * arc_mm / 12.0 + variance_mm2) / spread_mm2);
  EasedPieces pieces;
  for (std::size_t i = 0; i < kEasedPieces; ++i) {
    const double turn_rad = angle_rad * std::max(kLeastAngle, turned[i + 1] - turned[i]);
    pieces[i] = {turn_rad, scale * (at_mm[i + 1] - at_mm[i]) / turn_rad};
  }
  return pieces;
}

}  // namespace

EasedBend Ease(double angle_rad, double bend_radius_mm, double variance_mm2, double reach,
               double room_mm) {
  angle_rad = std::max(angle_rad, kLeastAngle);
  const double arc_mm = angle_rad * bend_radius_mm;
  EasedBend bend;
  bend.pieces = Pieces(arc_mm, angle_rad, variance_mm2, reach, room_mm);
  // Both chords lie along the sum of the tangents; what they differ by the straights lose.
  auto pieces = bend.pieces;
  double angle = angle_rad;
  if (angle > kKernel.widest_rad) {
    angle = kKernel.widest_rad;
    pieces = Pieces(angle * bend_radius_mm, angle, variance_mm2, reach, room_mm);
  }
  const double chord_mm = 2.0 * bend_radius_mm * std::sin(0.5 * angle);
  const double over_mm = 2.0 * std::cos(0.5 * angle);
  const double eased_chord_mm = EndOf(pieces).norm();
  bend.beyond_mm = (eased_chord_mm - chord_mm) / over_mm;
  const double most_mm = 0.5 / kKernel.room * room_mm;  // half of the straight
  if (bend.beyond_mm > most_mm) {
    // Less than nothing would be left of the straight, and the rows would be another tube's.
    const double shorter = (chord_mm + over_mm * most_mm) / eased_chord_mm;
    for (BendPiece& piece : bend.pieces) piece.bend_radius_mm *= shorter;
    bend.beyond_mm = most_mm;
  }
  return bend;
}

Easing EasingWithin(const hal::BendProgram& program, const Easing& easing) {
  Easing within = easing;
  within.room_mm.clear();
  const std::size_t bends = program.bend_count();
  for (std::size_t i = 0; i < within.variance_mm2.size(); ++i) {
    const auto room_mm = [&](std::size_t row) {
      const bool is_end = row == 0 || row == bends;
      return (is_end ? 2.0 : 1.0) * kKernel.room * std::max(0.0, program.rows[row].length_mm);
    };
    within.room_mm.push_back(std::min(room_mm(i), room_mm(i + 1)));
    const double most_mm = within.room_mm.back() / kKernel.least_tails;
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
                                within.variance_mm2[i], within.reach, within.room_of_mm(i));
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
