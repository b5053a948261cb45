// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

namespace bendloop::pipeline {

// The value below which `part` (0..1) of the values lie; 0 for none.
inline double Quantile(std::vector<double> values, double part) {
  if (values.empty()) return 0.0;
  const auto index = std::lround(part * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), values.begin() + index, values.end());
  return values[static_cast<std::size_t>(index)];
}

inline double Median(std::vector<double> values) { return Quantile(std::move(values), 0.5); }

// Standard deviation of the normal distribution with the same median absolute deviation.
inline double RobustSigma(std::vector<double> values) {
  const double center = Median(values);
  for (double& value : values) value = std::abs(value - center);
  return 1.4826 * Median(std::move(values));
}

}  // namespace bendloop::pipeline
