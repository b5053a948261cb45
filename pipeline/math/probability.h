// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace bendloop::pipeline {

// That a normal number of this mean and 1 sigma lies within -half_width and half_width. Sigma 0: it
// is its mean; what is not finite gives 0.
double ProbabilityWithin(double mean, double sigma, double half_width);

}  // namespace bendloop::pipeline
