// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <optional>
#include <span>

#include "hal/spine.h"
#include "pipeline/fit/surface_points.h"

namespace bendloop::pipeline {

// How far before an end of the tube its other end lies, if it faces it as in a frame that nearly
// closes [mm]; below zero: they pass each other by so much. `segments`: of a tube of pipe radius
// `pipe_radius_mm`.
std::optional<double> ToFacingEndMm(std::span<const hal::SpineSegment> segments, bool at_start,
                                    double pipe_radius_mm);

// Parts the samples of two ends that face each other, in the middle of the widest gap about them.
class FacingEnds {
 public:
  // None: no end faces the other, or no gap is much wider than others. `reach_mm`: samples are so
  // near to the surface.
  static std::optional<FacingEnds> Find(std::span<const hal::SpineSegment> segments,
                                        double pipe_radius_mm, double reach_mm,
                                        std::span<const PointBlock> blocks);

  // Whether a point near the ends is one of the tube's start.
  bool IsOfStart(const Eigen::Vector3d& point_mm) const {
    return tangent_.dot(point_mm) > middle_mm_;
  }

 private:
  FacingEnds(const Eigen::Vector3d& tangent, double middle_mm)
      : tangent_(tangent), middle_mm_(middle_mm) {}

  Eigen::Vector3d tangent_;  // of the first straight
  double middle_mm_;         // of the gap, along it
};

}  // namespace bendloop::pipeline
