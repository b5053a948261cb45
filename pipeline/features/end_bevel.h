// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "pipeline/features/end_samples.h"
#include "pipeline/tube/tube_features.h"

namespace bendloop::pipeline {

// A cone that samples beyond the border of the wall lie on.
struct EndBevel {
  double begins_mm = 0;  // on the wall, beyond the plane that was asked about
  double fall = 0;       // of the wall towards the axis, along it
  Eigen::Matrix2d covariance = Eigen::Matrix2d::Zero();  // of both
  std::vector<NearEnd> samples;                          // that lie on it
  std::optional<double> face_mm;  // beyond that plane, of the face that it ends at, if that is seen

  // How far a sample that lies so far beyond that plane, and inside, is from the cone.
  double SigmasOff(double beyond_mm, double in_mm, double noise_mm) const;
  // `ends_mm`: where the tube ends beyond that plane, with 1 sigma.
  BevelFound Found(double ends_mm, double sigma_mm) const;
};

struct BevelSearch {
  std::optional<EndBevel> bevel;
  // Where none is told, but a cone explains the samples better than chance: how far beyond the
  // plane they, and perhaps the tube, go on.
  double perhaps_mm = 0;
};
// `plane_mm`: of the border of the wall (EndSide). Its samples inside that lie beyond are a bevel's
// where they are seen on many sides and lie on one cone that begins there, and not all in the plane
// that the wall is cut by: those are of its own face. `noise_mm`: 1 sigma of the samples.
BevelSearch FindBevel(const SamplesNearEnd& near, const Eigen::Vector3d& plane_mm,
                      double pipe_radius_mm, double noise_mm);

}  // namespace bendloop::pipeline
