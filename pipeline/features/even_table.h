// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <vector>

namespace bendloop::pipeline {

// A table of even steps.
struct EvenTable {
  double from = 0, per_step = 1;  // where it begins, and 1 / step
  std::vector<double> at;         // with its last number twice

  // The sum of what it says at `places`: straight between two steps, at its ends as there.
  double Sum(std::span<const double> places) const;
};

}  // namespace bendloop::pipeline
