// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <functional>
#include <optional>

#include "pipeline/features/posterior.h"

namespace bendloop::pipeline {

// Independent draws, and what they tell.
class WeighedDraws {
 public:
  WeighedDraws(Eigen::VectorXd about, Eigen::MatrixXd off, Eigen::VectorXd weight);

  // Its mean logarithm is left out.
  Posterior Told() const { return Sum(weight_); }
  // What they tell where the density is so many times what it was, by its logarithm; none: too few
  // of them count then.
  std::optional<Posterior> ToldTimes(
      const std::function<double(const Eigen::VectorXd&)>& log_factor) const;

 private:
  Posterior Sum(const Eigen::VectorXd& weight) const;

  Eigen::VectorXd about_;
  Eigen::MatrixXd off_;  // a draw a column, from there
  Eigen::VectorXd weight_;
};

// The same as SamplePosterior, for a density that is one hill of a few numbers, whose edges may be
// sharp, but which is no needle: by importance sampling, whose draws are independent, where of a
// walk's thirty steps one is. A normal density, with a wider one that catches tails, learns the
// hill's mean and shape in a few rounds; each takes the weights' power that leaves a quarter of its
// draws effective, so that a hill that is far narrower or wider than `rough` is come near to by and
// by (adaptive importance sampling, Cappe et al. 2004; tempered, Koblents and Miguez 2015).
// `draws`: of the last round, which alone is told; one that few draws carry is drawn once more.
WeighedDraws WeighPosterior(const Posterior& rough, int draws, WalkDice& dice,
                            const std::function<double(const Eigen::VectorXd&)>& log_density);

}  // namespace bendloop::pipeline
