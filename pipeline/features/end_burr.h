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

// Where a burr ends, by its samples, too: the plane, and 1 sigma of where it meets the axis and of
// its slopes.
struct BurrTip {
  Eigen::Vector3d plane_mm = Eigen::Vector3d::Zero();
  double at_sigma_mm = 0, slope_sigma = 0;
};
// None: its samples go on beyond the tip, or no height is certain.
std::optional<BurrFound> FindBurr(const SamplesNearEnd& near, const BurrTip& tip,
                                  double pipe_radius_mm, double noise_mm);

}  // namespace bendloop::pipeline
