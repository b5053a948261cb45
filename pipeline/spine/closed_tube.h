// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <span>

#include "pipeline/spine/spine_polygon.h"

namespace bendloop::pipeline {

// Whether the curve comes back to where it begins, as a ring and a frame do: its last node and the
// first are as near as nodes are, and the spine runs from one to the other.
bool IsLoop(const SpinePolygon& polygon, double pipe_radius_mm);

// What is said of a tube that is one.
inline constexpr char kClosedTube[] =
    "the tube is closed: it comes back to where it begins, without an end";

// A loop is to begin where its two ends nearly meet: where samples are missing along it, by far
// further than elsewhere. False: nowhere; the tube is closed, and the polygon stays as it is.
bool OpenAtGap(std::span<const Eigen::Vector3d> samples, double pipe_radius_mm,
               SpinePolygon& polygon);

}  // namespace bendloop::pipeline
