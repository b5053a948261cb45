// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <functional>

#include "pipeline/features/posterior.h"

namespace bendloop::pipeline {

// The same as SamplePosterior, for a density that is one hill of a few numbers, whose edges may be
// sharp, but which is no needle: by importance sampling, whose draws are independent, where of a
// walk's thirty steps one is. A normal density, with a wider one that catches tails, learns the
// hill's mean and shape in a few rounds; each takes the weights' power that leaves a quarter of its
// draws effective, so that a hill that is far narrower or wider than `rough` is come near to by and
// by (adaptive importance sampling, Cappe et al. 2004; tempered, Koblents and Miguez 2015).
// `draws`: of the last round, which alone is told; one that few draws carry is drawn once more.
Posterior WeighPosterior(const Posterior& rough, int draws, WalkDice& dice,
                         const std::function<double(const Eigen::VectorXd&)>& log_density);

}  // namespace bendloop::pipeline
