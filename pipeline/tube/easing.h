// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <limits>
#include <optional>
#include <vector>

#include "hal/bend_program.h"
#include "hal/pose.h"
#include "hal/spine.h"

namespace bendloop::pipeline {

// A bend does not begin and end with a step of its curvature: clamp and pressure die let it rise
// and fall within about a pipe diameter. Its curvature is taken for that of the sharp arc, smoothed
// along the spine by a kernel of this variance [mm^2]; its root is the easing length. What that
// does to the spine depends on the variance and hardly on the kernel's shape: the arc moves towards
// the inner side by variance / (2 bend radius), as a clothoid of length l does by l^2 / (24
// radius).
//
// The kernel is a box, as of a clothoid, smoothed by a Gaussian. An eased bend is so many arcs:
// exact geometry, and all that knows lines and arcs knows it. Of three steps and five arcs
// radii of one die that eases by a pipe radius came out wrong by several sigma, together; of
// fifteen, which end at 2.2 standard deviations of the kernel, by 1.7 where the noise is a
// thousandth of the pipe radius. The tube's rows keep their meaning: the straights' lines with
// their corners, and the radius of the die.
constexpr std::size_t kEasedPieces = 19;

// Root of the kernel's kurtosis, its fourth moment over the square of its variance, on which the
// spine's place depends next: 1.8 for a box, 3 for a Gaussian.
constexpr double kUsualReach = 1.549, kReachSigma = 0.15;  // 2.4, give or take as much
constexpr double kLeastReach = 1.35, kMostReach = 1.73;

// Clamp and pressure die need not be alike: the curvature rises under a kernel of (1 + skew) times
// the variance and falls under one of (1 - skew) times. 1 sigma of what is expected, and the most.
constexpr double kSkewSigma = 0.4, kMostSkew = 0.95;

// The kernel of one bend.
struct BendKernel {
  double variance_mm2 = 0, reach = kUsualReach;
  std::optional<double> skew = {};  // none: it rises as it falls
  double room_mm = std::numeric_limits<double>::infinity();
};

struct Easing {
  std::vector<double> variance_mm2;  // of every bend; none: they are sharp
  double reach = kUsualReach;        // of the tube's kernel
  std::vector<double> skew = {};     // of every bend; none: they rise as they fall
  // How far each may reach beyond its sharp arc, as EasingWithin() has it; none: as far as it does.
  std::vector<double> room_mm = {};

  BendKernel of(std::size_t bend) const {
    const auto own = bend < skew.size() ? std::optional(skew[bend]) : std::nullopt;
    return {variance_mm2[bend], reach, own, room_of_mm(bend)};
  }
  double room_of_mm(std::size_t bend) const {
    return bend < room_mm.size() ? room_mm[bend] : std::numeric_limits<double>::infinity();
  }

  bool empty() const { return variance_mm2.empty(); }
};

struct BendPiece {
  double angle_rad = 0;
  double bend_radius_mm = 0;
};
using EasedPieces = std::array<BendPiece, kEasedPieces>;
struct EasedBend {
  EasedPieces pieces;
  double before_mm = 0, behind_mm = 0;  // how far it reaches beyond the sharp arc's tangent points
};
EasedBend Ease(double angle_rad, double bend_radius_mm, const BendKernel& easing);

// Segments of a tube whose bends may be eased: line, pieces of the first bend, line, ...
struct EasedSpine {
  std::vector<hal::SpineSegment> segments;
  std::size_t pieces = 1;     // of every bend
  std::vector<double> share;  // of the bend's curvature, by segment; 1 for lines

  bool is_line(std::size_t segment) const { return segment % (pieces + 1) == 0; }
  std::size_t row(std::size_t segment) const { return segment / (pieces + 1); }  // of the program
  double length_mm() const {
    return segments.empty() ? 0.0 : segments.back().from_start_mm + segments.back().length_mm;
  }
};
EasedSpine SpineOf(const hal::BendProgram& program, const hal::Pose& X_WT, const Easing& easing);

// The same with no bend eased further than the straights beside it are long.
Easing EasingWithin(const hal::BendProgram& program, const Easing& easing);

}  // namespace bendloop::pipeline
