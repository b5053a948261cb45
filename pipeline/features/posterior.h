// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <vector>

namespace bendloop::pipeline {

// What is known of a few numbers when their likelihood is.
struct Posterior {
  Eigen::VectorXd mean;
  Eigen::MatrixXd covariance;
  double mean_log_density = 0;

  // The logarithm of the integral over the density, as near as one that spreads so may be: its mean
  // logarithm and the entropy of a normal one with this covariance. Compares models whose densities
  // are of the same data, each with what was known before.
  double LogEvidence() const;
  double Sigma(Eigen::Index i) const { return std::sqrt(std::max(0.0, covariance(i, i))); }
};

// What chance says to the steps of a walk: the same each time, so that several walks over as many
// numbers share it.
class WalkDice {
 public:
  explicit WalkDice(Eigen::Index numbers) : numbers_(static_cast<std::size_t>(numbers)) {}
  // Of a step, counted from the first: as many normal numbers, and the logarithm of an even one.
  const double* Of(std::size_t step) {
    while (thrown_.size() <= step * (numbers_ + 1)) Throw();
    return thrown_.data() + step * (numbers_ + 1);
  }

 private:
  void Throw();
  double Uniform();  // (0, 1)

  std::size_t numbers_;
  std::uint64_t state_ = 0x62656E646C6F6F70U;
  std::vector<double> thrown_;
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
// `dice`: of so many numbers.
Posterior SamplePosterior(const Posterior& rough, int walk, WalkDice& dice,
                          const std::function<double(const Eigen::VectorXd&)>& log_density);

}  // namespace bendloop::pipeline
