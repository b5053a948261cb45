// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <vector>

#include "pipeline/fit/surface_fit.h"
#include "pipeline/tube/measurement.h"

namespace bendloop::pipeline {

// By how much a pass of the scan may lie beside the others: 1 sigma of each axis. Arms with
// scanners drift by 0.02 to 0.1 mm between passes.
struct PassDrift {
  double move_mm = 0.05;
  double turn_deg = 0.02;
};

// The passes of a scan brought together on the tube that they show.
struct Registration {
  std::vector<PassOffset> passes;  // none: one pass, or nothing says that they do not meet
  Eigen::Vector3d middle_mm = Eigen::Vector3d::Zero();  // that they turn about
  // What the offsets leave unknown of the parameters (TubeParameters), beside the fit's covariance.
  Eigen::MatrixXd covariance;
  std::vector<Eigen::Vector3d> points;  // all, moved: the blocks look at them
};

// Small rigid offsets of the passes and the tube's parameters together, by least squares with a
// prior for the offsets. `blocks`: of a scan whose points know their sensors; where the samples
// insist that the passes do not meet they come to look at the moved points.
Registration RegisterPasses(const SurfaceFit& fit, unsigned passes, const PassDrift& drift,
                            double reach_mm, std::vector<PointBlock>& blocks);

}  // namespace bendloop::pipeline
