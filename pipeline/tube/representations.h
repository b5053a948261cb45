// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "hal/bend_program.h"
#include "hal/result.h"
#include "hal/tube.h"

// The representations of a tube (Bauer & Polthier 2009, section 5) into each other. hal::Tube is
// the pose representation of section 5.3; its program alone is LRA.
namespace bendloop::pipeline {

// The same tube fed from its other end: lengths, rotations, angles and radii in reverse order, all
// with their signs. The first rotation, which only turns the tube in the clamp, becomes 0.
hal::BendProgram ReverseProgram(const hal::BendProgram& program);

// The same tube in the same place, described from its other end.
hal::Tube ReverseTube(const hal::Tube& tube);

// XYZ of the trade: the points where neighbouring straights would meet, and both ends.
struct ControlPolygon {
  std::vector<Eigen::Vector3d> points_mm;            // n + 2 for n bends
  std::vector<std::optional<double>> bend_radii_mm;  // n, of points 1 to n; empty: a sharp corner
};

// `tube.program` as a control polygon in the frame that `tube.X_WT` leads to. kBadInput for a bend
// of 180 degrees or more: its straights do not meet in front of it.
hal::Result<ControlPolygon> PolygonFromTube(const hal::Tube& tube);

// The tube with this control polygon, its pipe radius 0. Points on a straight give rows of angle 0.
// kBadInput when the bends leave a straight negative (beyond 0.01 mm, which rounded coordinates
// may cost), for coinciding points, and for a polygon that turns back on itself.
hal::Result<hal::Tube> TubeFromPolygon(const ControlPolygon& polygon);

// How a bender's Y (feed) is counted.
enum class FeedCount {
  kIncremental,  // the straight before the bend (L of LRA)
  kAlongSpine,   // from the tube's start to the bend's start: straights and arcs
  kStraights,    // sum of the straights up to the bend
};

// How a bender's B (plane of bend) is counted.
enum class RotationCount {
  kIncremental,  // from the previous bend plane, (-180, 180] (R of LRA)
  kCumulative,   // from the tube's start, [0, 360)
};

struct YbcStyle {
  FeedCount feed = FeedCount::kIncremental;
  RotationCount rotation = RotationCount::kIncremental;
  int rotation_sign =
      1;  // +1: right-handed about the feed direction; -1: the machine's is opposite
};

// One row of a bender's YBC table; as in hal::BendRow, the last has no bend.
struct YbcRow {
  double y_mm = 0;
  double b_deg = 0;
  double c_deg = 0;
  std::optional<double> bend_radius_mm;

  bool operator==(const YbcRow&) const = default;
};

// kBadInput when the feed counts along the spine and a bend's radius is unknown.
hal::Result<std::vector<YbcRow>> YbcFromProgram(const hal::BendProgram& program,
                                                const YbcStyle& style);
// kBadInput as above, and for a feed that goes backwards.
hal::Result<hal::BendProgram> ProgramFromYbc(const std::vector<YbcRow>& rows,
                                             const YbcStyle& style);

// Whether the program can be a tube: at least one row, finite numbers, lengths not negative, angles
// in [0, 360), radii positive, no bend in the last row. kBadInput names the row, counted from 1.
hal::Result<void> CheckProgram(const hal::BendProgram& program);

}  // namespace bendloop::pipeline
