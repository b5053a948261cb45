// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string_view>

namespace bendloop::pipeline {

enum class ToleranceState : std::uint8_t { kIn, kOut, kUndecided, kNotJudged };
std::string_view Name(ToleranceState state);  // "in", "out", "undecided", "not judged"

// One number of the part. Unit by context: mm or degrees.
struct Deviation {
  double nominal = 0;
  double measured = 0;   // a rotation is given on the turn nearest to the nominal
  double deviation = 0;  // measured - nominal
  double sigma = 0;
  std::optional<double> tolerance;
  ToleranceState state = ToleranceState::kNotJudged;
};

// State of |deviation| against `tolerance` when 1 `sigma` is known: undecided within
// `decision_sigmas` of the limit. What is not finite is undecided; no tolerance is not judged.
ToleranceState Judge(double deviation, double sigma, std::optional<double> tolerance,
                     double decision_sigmas);

}  // namespace bendloop::pipeline
