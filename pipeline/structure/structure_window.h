// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "hal/tube.h"
#include "pipeline/fit/surface_points.h"
#include "pipeline/spine/spine_polygon.h"
#include "pipeline/spline/arc_line_spline.h"

namespace bendloop::pipeline {

// Part of a spine: arcs [first, last) with the straights around them. A change of structure is
// tried on it first, which costs no more on a tube of many bends than on one of few.
struct StructureWindow {
  std::size_t first = 0, last = 0;

  std::size_t first_segment() const { return 2 * first; }
  std::size_t last_segment() const { return 2 * last; }
};

// With neighbours, until the straights at both ends are long enough to say where the tube goes on.
StructureWindow Widened(StructureWindow window, const ArcLineSpline& spline, double pipe_radius_mm);
ArcLineSpline PartOf(const ArcLineSpline& spline, StructureWindow window);
// The spline with `part` in place of the window.
ArcLineSpline WithPart(const ArcLineSpline& spline, StructureWindow window,
                       const ArcLineSpline& part);

// The nodes along a window of the tube.
SpinePolygon NodesAlong(const SpinePolygon& polygon, const hal::Tube& tube, StructureWindow window);

// Which segment of a tube each point is nearest to, however far it is.
class NearestSegments {
 public:
  // `blocks` must outlive this.
  NearestSegments(const hal::Tube& tube, std::span<const PointBlock> blocks);
  // Those of a window, thinned to about `enough`.
  OwnedBlocks Of(StructureWindow window, std::size_t enough) const;

 private:
  std::span<const PointBlock> blocks_;
  std::vector<std::int32_t> nearest_;  // point after point; -1: beyond the tube's ends
};

}  // namespace bendloop::pipeline
