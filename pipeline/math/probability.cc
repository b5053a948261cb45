// SPDX-License-Identifier: Apache-2.0
#include "pipeline/math/probability.h"

#include <cmath>
#include <numbers>

namespace bendloop::pipeline {

double ProbabilityWithin(double mean, double sigma, double half_width) {
  if (!std::isfinite(mean) || !std::isfinite(sigma)) return 0;
  if (!(sigma > 0)) return std::abs(mean) <= half_width ? 1 : 0;
  const double scale = 1 / (std::abs(sigma) * std::numbers::sqrt2);
  // Tails from the complementary function, so that what is nearly certain keeps its digits.
  const double above = 0.5 * std::erfc((half_width - mean) * scale);
  const double below = 0.5 * std::erfc((half_width + mean) * scale);
  return 1 - above - below;
}

}  // namespace bendloop::pipeline
