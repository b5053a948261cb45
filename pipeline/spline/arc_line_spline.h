// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "hal/tube.h"
#include "pipeline/spline/shortcut_graph.h"

namespace bendloop::pipeline {

// The LRA representation of an arc-line spline with its start pose: lengths between touching
// points, rotations as signed angles of the bend normals about the feed (papers' r), angles beyond
// pi kept. Straights that would be negative become 0.
// Source: Bauer & Polthier 2009, section 5.3.
hal::Tube TubeFromSpline(const ArcLineSpline& spline, double pipe_radius_mm);

}  // namespace bendloop::pipeline
