// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "pipeline/features/end_samples.h"
#include "pipeline/tube/tube_features.h"

namespace bendloop::pipeline {

// Samples that stand out of the wall right before the plane (EndSide) and beyond it, and no farther
// in. Empty: too few, or more than a burr is. `noise_mm`: 1 sigma of the samples.
std::vector<NearEnd> StandingOut(const SamplesNearEnd& near, const Eigen::Vector3d& plane_mm,
                                 double pipe_radius_mm, double noise_mm);

// Where what stands out ends, by its samples, too: the plane, and 1 sigma of where it meets the
// axis and of its slopes.
struct RimTip {
  Eigen::Vector3d plane_mm = Eigen::Vector3d::Zero();
  double at_sigma_mm = 0, slope_sigma = 0;
};
// What stands out at an end that is the tube's end, too: a burr, or a small flare without one.
struct EndRim {
  std::optional<BurrFound> burr;
};
// None: its samples go on beyond the tip, no height is certain, or it is more than a burr is.
std::optional<EndRim> FindRim(const SamplesNearEnd& near, const RimTip& tip, double pipe_radius_mm,
                              double noise_mm);

}  // namespace bendloop::pipeline
