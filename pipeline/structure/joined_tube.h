// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "hal/tube.h"
#include "pipeline/spline/shortcut_graph.h"

namespace bendloop::pipeline {

// The tube of a spline whose parts were fitted by themselves. Where two of them meet at a straight
// too short to tell its direction, each has its own there, and a tube that takes one after the
// other (TubeFromSpline()) leaves all that comes behind beside its samples. This one's straights
// begin and end as near to the spline's as a tube's can, in the sense of least squares.
hal::Tube JoinedTube(const ArcLineSpline& spline, double pipe_radius_mm);

}  // namespace bendloop::pipeline
