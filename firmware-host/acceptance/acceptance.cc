// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/acceptance/acceptance.h"

#include <algorithm>

namespace bendloop::host {

const char* Name(Outcome outcome) {
  switch (outcome) {
    case Outcome::kPassed:
      return "pass";
    case Outcome::kFailed:
      return "FAIL";
    case Outcome::kNotTried:
      break;
  }
  return "not tried";
}

std::size_t Acceptance::Count(Outcome outcome) const {
  return static_cast<std::size_t>(
      std::count_if(rules.begin(), rules.end(),
                    [outcome](const RuleResult& rule) { return rule.outcome == outcome; }));
}

}  // namespace bendloop::host
