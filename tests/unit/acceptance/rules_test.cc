// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/acceptance/rules.h"

#include <gtest/gtest.h>

#include <fstream>
#include <string>
#include <vector>

namespace bendloop::host {
namespace {

TEST(AcceptanceRules, AreThoseOfTheWiringGuide) {
  std::ifstream guide(BENDLOOP_SOURCE_DIR "/drivers/README.md");
  std::vector<std::string> told;
  for (std::string line; std::getline(guide, line);) {
    const bool is_rule =
        line.rfind("| R", 0) == 0 && line.size() > 3 && line[3] >= '1' && line[3] <= '9';
    if (is_rule) told.push_back(line);
  }
  ASSERT_EQ(told.size(), kRuleCount);
  for (std::size_t i = 0; i < kRuleCount; ++i) {
    const auto rule = static_cast<Rule>(i + 1);
    EXPECT_EQ(told[i], "| " + RuleName(rule) + " | " + RuleText(rule) + " |");
  }
}

}  // namespace
}  // namespace bendloop::host
