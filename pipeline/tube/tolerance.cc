// SPDX-License-Identifier: Apache-2.0
#include "pipeline/tube/tolerance.h"

#include <cmath>

namespace bendloop::pipeline {

std::string_view Name(ToleranceState state) {
  switch (state) {
    case ToleranceState::kIn:
      return "in";
    case ToleranceState::kOut:
      return "out";
    case ToleranceState::kUndecided:
      return "undecided";
    case ToleranceState::kNotJudged:
      return "not judged";
  }
  return "unknown";
}

ToleranceState Judge(double deviation, double sigma, std::optional<double> tolerance,
                     double decision_sigmas) {
  if (!tolerance) return ToleranceState::kNotJudged;
  const double band = decision_sigmas * std::abs(sigma);
  if (!std::isfinite(deviation) || !std::isfinite(band)) return ToleranceState::kUndecided;
  const double distance = std::abs(deviation);
  if (distance + band <= *tolerance) return ToleranceState::kIn;
  if (distance - band > *tolerance) return ToleranceState::kOut;
  return ToleranceState::kUndecided;
}

}  // namespace bendloop::pipeline
