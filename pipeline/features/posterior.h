// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <functional>

namespace bendloop::pipeline {

// What is known of a few numbers when their likelihood is.
struct Posterior {
  Eigen::VectorXd mean;
  Eigen::MatrixXd covariance;

  double Sigma(Eigen::Index i) const { return std::sqrt(std::max(0.0, covariance(i, i))); }
};

// Means over the density by Metropolis' walk, whose steps learn its shape first. Where points stop
// at a border the likelihood has edges: its maximum lies on one, beside the truth, and no curvature
// says how sure it is; the mean is the best estimate there is (Pitman 1939), and the spread is its
// 1 sigma. `start`: where the density is not nothing; `scale`: about how far it reaches from there.
// `walk`: steps that are counted; the mean is 1 sigma / sqrt(walk / 30) or so beside the true one.
// The same numbers each time.
Posterior SamplePosterior(const Eigen::VectorXd& start, const Eigen::VectorXd& scale, int walk,
                          const std::function<double(const Eigen::VectorXd&)>& log_density);

// The same from what is roughly known: another density's mean and covariance.
Posterior SamplePosterior(const Posterior& rough, int walk,
                          const std::function<double(const Eigen::VectorXd&)>& log_density);

}  // namespace bendloop::pipeline
