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
  // [standard deviations of the Gaussian] Nothing is left of the box so far beyond its end: pieces
  // of two kernels are few. By trial.
  double beyond_box = 3.0;
  // [of it] What a straight that is too short for them leaves of them, at least.
  double least_tails = 1.5;
  // [of the standard deviation] A shorter arc is as one of this length under a narrower kernel.
  double least_arc = 0.3;
  // [of the variance] The box' share of the kernel's, where the root of kurtosis would leave it
  // nothing or all.
  double least_box = 0.05, most_box = 0.999;
  // [of the bend's angle] That each piece turns at least.
  double least_turn = 2e-5;
  // [of the kernels' variance over the arc's square] How much less kernels differ. By trial.
  double apart = 1.0;
  // [rad] The chord of a slighter bend does not tell where its corner is.
  double slight_rad = 1e-3;
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

// A box smoothed by a Gaussian.
struct Kernel {
  double box_mm, sigma_mm;

  double variance_mm2() const { return box_mm * box_mm / 12.0 + sigma_mm * sigma_mm; }
  // [mm^2] Integral of its distribution function up to s, times the box.
  double Integrated(double s_mm) const {
    return TwiceIntegrated(s_mm + 0.5 * box_mm, sigma_mm) -
           TwiceIntegrated(s_mm - 0.5 * box_mm, sigma_mm);
  }
};

// A bend's curvature along the spine: the sharp arc's box, each of its steps smoothed by a kernel.
struct CurvatureProfile {
  double arc_mm;
  Kernel rise, fall;
  bool may_differ;

  // What is turned of the bend's angle `s_mm` from its middle: 0 to 1.
  double TurnedAt(double s_mm) const {
    const double risen_mm2 = rise.Integrated(s_mm + 0.5 * arc_mm);
    const double fallen_mm2 = fall.Integrated(s_mm - 0.5 * arc_mm) * (rise.box_mm / fall.box_mm);
    return (risen_mm2 - fallen_mm2) / (arc_mm * rise.box_mm);
  }
  CurvatureProfile Backwards() const { return {arc_mm, fall, rise, may_differ}; }
};

CurvatureProfile ProfileOf(double arc_mm, const BendKernel& easing) {
  const double of_both_mm2 = arc_mm * arc_mm / 12.0 + easing.variance_mm2;
  double variance_mm2 = std::max(easing.variance_mm2, kKernel.least_variance * of_both_mm2);
  if (arc_mm < kKernel.least_arc * std::sqrt(variance_mm2)) {
    arc_mm = kKernel.least_arc * std::sqrt(of_both_mm2);
    variance_mm2 = of_both_mm2 - arc_mm * arc_mm / 12.0;
  }
  // A box that has this share of a variance takes 1.2 of its square from a Gaussian's kurtosis.
  const double box = std::clamp(std::sqrt(std::max(0.0, (3.0 - easing.reach * easing.reach) / 1.2)),
                                kKernel.least_box, kKernel.most_box);
  const auto kernel = [box](double kernel_mm2) {
    return Kernel{std::sqrt(12.0 * box * kernel_mm2), std::sqrt((1.0 - box) * kernel_mm2)};
  };
  // Where the arc is as short as its kernels are wide, one would end before the other has begun.
  const double arc_mm2 = arc_mm * arc_mm;
  const double skew =
      easing.skew.value_or(0.0) * arc_mm2 / (arc_mm2 + kKernel.apart * variance_mm2);
  return {arc_mm, kernel((1.0 + skew) * variance_mm2), kernel((1.0 - skew) * variance_mm2),
          easing.skew.has_value()};
}

constexpr std::size_t kSide = kEasedPieces / 2;

// Where the pieces of one side of a bend begin, from its middle, and what is turned there of its
// angle.
struct Side {
  std::array<double, kSide + 1> at_mm, turned;
};

// `least_mm`: how far it reaches beyond the arc.
Side SideOf(const CurvatureProfile& profile, double least_mm, double room_mm) {
  double ramp_mm = kKernel.tails * std::sqrt(profile.rise.variance_mm2());
  if (profile.may_differ) {
    const Kernel& rise = profile.rise;
    ramp_mm = std::min(ramp_mm, 0.5 * rise.box_mm + kKernel.beyond_box * rise.sigma_mm);
  }
  ramp_mm = std::max(least_mm, std::min(ramp_mm, room_mm));
  const double end_mm = 0.5 * profile.arc_mm + ramp_mm;
  const double flat_mm =
      std::max(0.5 * profile.arc_mm - ramp_mm, end_mm / static_cast<double>(kEasedPieces));
  const double step_mm = (end_mm - flat_mm) / kSide;
  std::array<double, kSide + 3> exact;  // from one step before the first place on
  for (std::size_t i = 0; i < exact.size(); ++i) {
    exact[i] = profile.TurnedAt(-end_mm + (static_cast<double>(i) - 1.0) * step_mm);
  }
  Side side;
  for (std::size_t i = 0; i <= kSide; ++i) {
    side.at_mm[i] = -end_mm + static_cast<double>(i) * step_mm;
    // Where a ramp begins at once the piece before it would turn the other way; and what hardly
    // turns has a radius that nobody can calculate with.
    side.turned[i] = i == 0 ? 0.0
                            : std::max(side.turned[i - 1] + kKernel.least_turn,
                                       (14.0 * exact[i + 1] - exact[i] - exact[i + 2]) / 12.0);
  }
  return side;
}

// Arcs as long as each other where the curvature rises and where it falls, and one between. Each
// turns as far as the profile does along it, and the variance of their curvature is the profile's.
// Headings that were the profile's where arcs meet would lie beside it between them, all to one
// side: by a twelfth of their second differences, on average, which would make all of the bend
// tighter.
EasedPieces Pieces(double arc_mm, double angle_rad, const BendKernel& easing) {
  const CurvatureProfile profile = ProfileOf(arc_mm, easing);
  // Without any room, as far as the narrowest kernel: no piece turns on the spot.
  const double of_both_mm2 = arc_mm * arc_mm / 12.0 + easing.variance_mm2;
  const double least_mm = kKernel.least_tails * std::sqrt(kKernel.least_variance * of_both_mm2);
  const Side rise = SideOf(profile, least_mm, easing.room_mm);
  const Side fall = SideOf(profile.Backwards(), least_mm, easing.room_mm);
  std::array<double, kEasedPieces + 1> at_mm, turned;
  for (std::size_t i = 0; i <= kSide; ++i) {
    at_mm[i] = rise.at_mm[i];
    turned[i] = rise.turned[i];
    at_mm[kEasedPieces - i] = -fall.at_mm[i];
    turned[kEasedPieces - i] = 1.0 - fall.turned[i];
  }
  double spread_mm2 = 0;
  for (std::size_t i = 0; i < kEasedPieces; ++i) {
    const double a = at_mm[i], b = at_mm[i + 1];
    spread_mm2 += (turned[i + 1] - turned[i]) * (a * a + a * b + b * b) / 3.0;
  }
  const double scale = std::sqrt(of_both_mm2 / spread_mm2);
  EasedPieces pieces;
  for (std::size_t i = 0; i < kEasedPieces; ++i) {
    const double turn_rad = angle_rad * std::max(kLeastAngle, turned[i + 1] - turned[i]);
    pieces[i] = {turn_rad, scale * (at_mm[i + 1] - at_mm[i]) / turn_rad};
  }
  return pieces;
}

// By how much further from the corner of its lines a bend ends than it begins.
double EndsLaterMm(std::span<const BendPiece> pieces, double angle_rad) {
  if (angle_rad > kKernel.slight_rad) {
    const Eigen::Vector2d aside(-std::sin(0.5 * angle_rad), std::cos(0.5 * angle_rad));
    return EndOf(pieces).dot(aside) / std::sin(0.5 * angle_rad);
  }
  // The corner is where the bend turns on average.
  double length_mm = 0, turn_mm = 0;
  for (const BendPiece& piece : pieces) {
    const double piece_mm = piece.angle_rad * piece.bend_radius_mm;
    turn_mm += piece.angle_rad * (length_mm + 0.5 * piece_mm);
    length_mm += piece_mm;
  }
  return length_mm - 2.0 * turn_mm / angle_rad;
}

}  // namespace

EasedBend Ease(double angle_rad, double bend_radius_mm, const BendKernel& easing) {
  angle_rad = std::max(angle_rad, kLeastAngle);
  const double arc_mm = angle_rad * bend_radius_mm;
  EasedBend bend;
  bend.pieces = Pieces(arc_mm, angle_rad, easing);
  // Chords lie along the sum of the tangents, or nearly; what they differ by along it the straights
  // lose.
  auto pieces = bend.pieces;
  double angle = angle_rad;
  if (angle > kKernel.widest_rad) {
    angle = kKernel.widest_rad;
    pieces = Pieces(angle * bend_radius_mm, angle, easing);
  }
  const double chord_mm = 2.0 * bend_radius_mm * std::sin(0.5 * angle);
  const double over_mm = 2.0 * std::cos(0.5 * angle);
  const Eigen::Vector2d along(std::cos(0.5 * angle), std::sin(0.5 * angle));
  const double eased_chord_mm = easing.skew ? EndOf(pieces).dot(along) : EndOf(pieces).norm();
  double beyond_mm = (eased_chord_mm - chord_mm) / over_mm;
  const double most_mm = 0.5 / kKernel.room * easing.room_mm;  // half of the straight
  if (beyond_mm > most_mm) {
    // Less than nothing would be left of the straight, and the rows would be another tube's.
    const double shorter = (chord_mm + over_mm * most_mm) / eased_chord_mm;
    for (BendPiece& piece : bend.pieces) piece.bend_radius_mm *= shorter;
    beyond_mm = most_mm;
  }
  double later_mm = 0;
  if (easing.skew) {
    const double free_mm = most_mm - beyond_mm;
    later_mm = std::clamp(0.5 * EndsLaterMm(pieces, angle), -free_mm, free_mm);
  }
  bend.before_mm = beyond_mm - later_mm;
  bend.behind_mm = beyond_mm + later_mm;
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
    const EasedBend bend = Ease(row.angle_deg * hal::kRadiansPerDegree, radius_mm, within.of(i));
    for (std::size_t k = 0; k < kEasedPieces; ++k) {
      const BendPiece& piece = bend.pieces[k];
      const double line_mm =
          k == 0 ? std::max(0.0, row.length_mm - beyond_before_mm - bend.before_mm) : 0.0;
      pieces.rows.push_back({line_mm, k == 0 ? row.rotation_deg : 0.0,
                             piece.angle_rad / hal::kRadiansPerDegree, piece.bend_radius_mm});
    }
    beyond_before_mm = bend.behind_mm;
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
