// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>

namespace bendloop::host {

// What a PLC must do, by its number in drivers/README.md ("What the PLC must do").
enum class Rule : std::uint8_t {
  kHeartbeat = 1,
  kMode,
  kStores,
  kOnlyCommit,
  kIdle,
  kStagedNumber,
  kActiveNumber,
  kRowCount,
  kCrc,
  kLimits,
  kPart,
  kAccepts,
  kAtOnce,
  kUsedUp,
  kRejectedIsNothing,
  kReply,
  kPowerLoss,
  kPanel,
};

inline constexpr std::size_t kRuleCount = 18;

// "R9".
std::string RuleName(Rule rule);
// What the PLC does, as the table in drivers/README.md says it.
const char* RuleText(Rule rule);

}  // namespace bendloop::host
