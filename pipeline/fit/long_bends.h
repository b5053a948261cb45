// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include "pipeline/fit/surface_sums.h"
#include "pipeline/tube/measurement.h"

namespace bendloop::pipeline {

// Place, direction, bow and S of a straight's spine, each in y and z; pipe radius, oval section.
constexpr int kBendNumbers = 11;
using BendNumbers = Eigen::Matrix<double, kBendNumbers, 1>;

// What a straight's points say of how it bows, by least squares.
class LongBends {
 public:
  // `points`: in the straight's frame. `low_mm`, `high_mm`: from where to where along it.
  LongBends(const SegmentPoints& points, double low_mm, double high_mm, double pipe_radius_mm,
            double noise_mm);

  // How far off the pipe's radius they are in the direction (oy, oz) from the line.
  double OffMm(double along_mm, double oy, double oz) const;
  // The spine beside its best-fit line, along its principal direction.
  StraightForm Form(double design_effect) const;

 private:
  using Matrix = Eigen::Matrix<double, kBendNumbers, kBendNumbers>;

  double middle_mm_, half_mm_;
  BendNumbers numbers_ = BendNumbers::Zero();
  Matrix covariance_ = Matrix::Zero();
};

}  // namespace bendloop::pipeline
