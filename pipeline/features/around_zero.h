// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "hal/spine.h"
#include "hal/tube.h"
#include "pipeline/fit/surface_fit.h"
#include "pipeline/tube/measurement.h"

namespace bendloop::pipeline {

// How sure that is from where places around a tube are counted: the plane of the bend that is there
// or was the last before, which is known less than where the samples lie.
class AroundZeroSigma {
 public:
  // `tube`: that of the fit, but for where its ends are.
  AroundZeroSigma(const SurfaceFit& fit, const hal::Tube& tube);

  double DegAt(double along_mm) const;  // 1 sigma

 private:
  std::vector<hal::SpineSegment> segments_;
  // Of the segment by which places on each are counted: 1 sigma squared of its turn [rad^2] about
  // its tangent at its start and about the normal's cross product with that.
  std::vector<Eigen::Matrix2d> turn_;
};

// Adds it to the sigmas of all that is told around the tube.
void AddAroundZero(const AroundZeroSigma& zero, Measurement& measurement);

}  // namespace bendloop::pipeline
