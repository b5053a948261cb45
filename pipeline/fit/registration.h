// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <vector>

#include "pipeline/fit/surface_fit.h"
#include "pipeline/tube/measurement.h"
#include "pipeline/tube/pass_offsets.h"

namespace bendloop::pipeline {

// The passes of a scan brought together on the tube that they show.
struct Registration {
  std::vector<PassOffset> passes;  // none: one pass, or nothing says that they do not meet
  Eigen::Vector3d middle_mm = Eigen::Vector3d::Zero();  // that they turn about
  // What the offsets leave unknown of the parameters (TubeParameters), beside the fit's covariance.
  Eigen::MatrixXd covariance;
  std::vector<Eigen::Vector3d> points;  // all, moved: the blocks look at them

  // A point of a pass, where the tube is; of no pass that is known: where it was.
  Eigen::Vector3d Moved(const Eigen::Vector3d& point, SensorDirection to_sensor) const;
};

// Small rigid offsets of the passes and the tube's parameters together, by least squares with a
// prior for the offsets. `blocks`: of a scan whose points know their sensors; where the samples
// insist that the passes do not meet they come to look at the moved points.
Registration RegisterPasses(const SurfaceFit& fit, unsigned passes, const PassDrift& drift,
                            double reach_mm, std::vector<PointBlock>& blocks);

// The same of other blocks of the scan, which come to look at `moved`.
void MoveOntoTube(const Registration& registration, std::vector<PointBlock>& blocks,
                  std::vector<Eigen::Vector3d>& moved);

}  // namespace bendloop::pipeline
