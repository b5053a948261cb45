// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <span>
#include <vector>

#include "hal/spine.h"

// What is cut into a tube, drilled through its wall or pressed into it. Places are (along, around):
// along the spine from its start [mm], and around the feed direction, right-handed, from the normal
// of the bend that is there or was the last before; before the first bend from the first's [deg].
namespace bendloop::hal {

// A hole or slot through the wall. Seen along the drill's axis its border is that of all places no
// further than half the width from a line: a circle (a hole) where length and width are the same,
// two half circles and two lines otherwise (a slot).
struct WallOpening {
  double along_mm = 0;  // where the drill's axis meets the surface
  double around_deg = 0;
  double length_mm = 0;  // over all
  double width_mm = 0;   // across; at most the length
  // Of the length: from the feed direction, right-handed about the outward normal, (-90, 90].
  double axis_deg = 0;
  // Of a hole: of the drill's axis, going out, from the outward normal towards the feed direction
  // and towards growing angles. Both 0: radial.
  double lean_along_deg = 0, lean_around_deg = 0;

  bool is_hole() const { return length_mm == width_mm; }
  bool operator==(const WallOpening&) const = default;
};

// A plane cut. It meets the spine where the tube's length ends.
struct EndCut {
  double obliquity_deg = 0;  // of the plane to the cross-section; 0: square
  double around_deg = 0;     // where the tube is longest

  bool operator==(const EndCut&) const = default;
};

// What an end has beside its plane.
struct EndEdge {
  // Of a bevel of the outside: along the tube, and how far the wall has come in at the end.
  double bevel_mm = 0, bevel_depth_mm = 0;
  // Of a burr that stands out of the wall all round: how far at the end, and along the tube.
  double burr_mm = 0, burr_length_mm = 0;
  // Of a border that leaves the plane: beyond it by `wave_mm` at `wave_around_deg` and `waves` - 1
  // more places of the turn, as far before it between them.
  double wave_mm = 0;
  int waves = 0;
  double wave_around_deg = 0;

  bool operator==(const EndEdge&) const = default;
};

// A place that was pressed in; its depth falls off like a gaussian on the unrolled surface.
struct PressedDent {
  double along_mm = 0;
  double around_deg = 0;
  double depth_mm = 0;
  double width_mm = 0;  // 1 sigma of the gaussian

  bool operator==(const PressedDent&) const = default;
};

struct TubeFeatures {
  std::vector<WallOpening> openings;
  EndCut first_end, last_end;
  std::vector<PressedDent> dents;
  EndEdge first_edge, last_edge;

  bool operator==(const TubeFeatures&) const = default;
};

// The frame of a place on the surface.
struct SurfaceFrame {
  Eigen::Vector3d spine_mm = Eigen::Vector3d::Zero();  // of the spine
  Eigen::Vector3d tangent = Eigen::Vector3d::UnitX();  // feed direction
  Eigen::Vector3d outward = Eigen::Vector3d::UnitZ();  // surface normal
  // Towards decreasing angles: seen from outside with the feed to the right, up.
  Eigen::Vector3d sideways() const { return outward.cross(tangent); }
};

// From where places around are counted on a segment at `along_mm` from its start. Unit.
// `segments`: line, bend, line, ..., each bend of `pieces` arcs.
Eigen::Vector3d AroundZero(std::span<const SpineSegment> segments, std::size_t segment,
                           std::size_t pieces = 1);
// Places beyond the ends are on the end straights, which go on.
SurfaceFrame FrameAt(std::span<const SpineSegment> segments, double along_mm, double around_deg,
                     std::size_t pieces = 1);
// The angle of direction `outward` around, at a place with this tangent.
double AroundDeg(const Eigen::Vector3d& zero, const Eigen::Vector3d& tangent,
                 const Eigen::Vector3d& outward);
// The segment that holds the place.
std::size_t SegmentAt(std::span<const SpineSegment> segments, double along_mm);

}  // namespace bendloop::hal
