// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <random>

namespace bendloop::tests {

inline double Uniform(std::mt19937_64& random, double low, double high) {
  return std::uniform_real_distribution<double>(low, high)(random);
}
// The logarithm is even.
inline double LogUniform(std::mt19937_64& random, double low, double high) {
  return std::exp(Uniform(random, std::log(low), std::log(high)));
}

}  // namespace bendloop::tests
