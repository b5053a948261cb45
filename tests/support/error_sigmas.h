// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cmath>

namespace bendloop::tests {

// Errors of measured values, each over the 1 sigma that was told with it.
class ErrorSigmas {
 public:
  void Add(double error, double sigma) { Add(error / sigma); }
  void Add(double sigmas) {
    sum_ += sigmas;
    squares_ += sigmas * sigmas;
    greatest_ = std::max(greatest_, std::abs(sigmas));
    beyond_4_ += std::abs(sigmas) > 4 ? 1 : 0;
    ++count_;
  }

  // NaN of none, which no bound of a test holds for.
  double mean() const { return sum_ / count_; }
  double rms() const { return std::sqrt(squares_ / count_); }
  double greatest() const { return greatest_; }
  int beyond_4() const { return beyond_4_; }
  int count() const { return count_; }

 private:
  double sum_ = 0, squares_ = 0, greatest_ = 0;
  int beyond_4_ = 0, count_ = 0;
};

}  // namespace bendloop::tests
