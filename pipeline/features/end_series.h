// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

namespace bendloop::pipeline {

// A border's place along the tube as a series of how far around it is: 1, cos, sin, cos 2, sin 2
// and so on, up to `order` turns. The first three are a plane.
Eigen::VectorXd SeriesAt(double cosine, double sine, int order);

inline int OrderOf(const Eigen::VectorXd& series) {
  return static_cast<int>(series.size() - 1) / 2;
}

// Where such a border lies.
double SeriesOf(const Eigen::VectorXd& series, double cosine, double sine);

// 1 / 1 sigma of each number of such a series before the scan [1/mm].
Eigen::VectorXd SeriesCertainties(int order, double pipe_radius_mm);

}  // namespace bendloop::pipeline
