// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <optional>
#include <span>
#include <vector>

#include "pipeline/fit/end_forms.h"
#include "pipeline/fit/surface_fit.h"
#include "pipeline/fit/surface_points.h"
#include "pipeline/spine/spine_polygon.h"

namespace bendloop::pipeline {

// Where the plain tube goes into a cap or a sleeve. One that is hardly thicker than the tube lies
// within reach of its fit, and where views see it from some sides only it moves the axis to them:
// the last bends of `fit` lead there, and so do the nodes; or they will, where all points are
// fitted. They are none where the points beyond them lie all round the axis of the straight before
// them as on a wider pipe, and certainly not on these bends, nor on the tube going straight on.
// `blocks`: points near the tube.
std::optional<PlainEnd> FindEndSleeve(const SurfaceFit& fit, bool at_start,
                                      std::span<const PointBlock> blocks);

// The nodes before a sleeve that begins there. False: they would be none to follow, and all stay.
bool CutAt(const PlainEnd& begin, bool at_start, SpinePolygon& polygon);

// What blocks that are parted hold of themselves.
struct PartedBlock {
  std::vector<Eigen::Vector3d> points;
  std::vector<SensorDirection> to_sensor;
};
// Without the points beyond where a sleeve begins. `parted`: blocks look at it from then on.
void LeaveOut(const PlainEnd& begin, double pipe_radius_mm, std::vector<PointBlock>& blocks,
              std::vector<PartedBlock>& parted);

}  // namespace bendloop::pipeline
