// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <filesystem>
#include <memory>
#include <string>
#include <utility>

#include "firmware-host/acceptance/robot.h"
#include "tests/support/canopen_bender_under_test.h"
#include "tests/support/isotp_bender_under_test.h"
#include "tests/support/modbus_bender_under_test.h"

namespace bendloop::test {

// What the robot asks for is done to the simulated bender, which may break a rule meanwhile.
class SimulatedHands final : public host::HandSteps {
 public:
  explicit SimulatedHands(drivers::SimulatedBender& bender, std::string mutant = "")
      : bender_(bender), mutant_(std::move(mutant)) {
    Break();
  }

  bool Do(host::HandStep step) override {
    using host::HandStep;
    switch (step) {
      case HandStep::kStartCycle:
        return Misbehave("mode bending");
      case HandStep::kOpenGuard:
        return Misbehave("mode not-ready");
      case HandStep::kFault:
        return Misbehave("mode fault");
      case HandStep::kMakeIdle:
        return Misbehave("mode idle");
      case HandStep::kPowerCycle:
        return Misbehave("reboot");
      case HandStep::kEditAtPanel:
        return Misbehave("edit 0.5");
      case HandStep::kStopProgram:
        return Misbehave("freeze");
      case HandStep::kStartProgram:
        return Misbehave("behave") && Break();
    }
    return false;
  }

 private:
  bool Break() { return mutant_.empty() || Misbehave("break " + mutant_); }
  bool Misbehave(const std::string& command) {
    const auto done = bender_.Misbehave(command);
    EXPECT_TRUE(done) << done.error().message;
    return done.has_value();
  }

  drivers::SimulatedBender& bender_;
  const std::string mutant_;
};

// A folder of its own, gone at the end.
class TemporaryFolder {
 public:
  TemporaryFolder() {
    std::string name = testing::TempDir() + "acceptance-XXXXXX";
    path_ = mkdtemp(name.data());
  }
  ~TemporaryFolder() { std::filesystem::remove_all(path_); }
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;
  const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

inline host::BenchOptions QuickBench() {
  host::BenchOptions options;
  options.reply_timeout = std::chrono::milliseconds(500);
  options.poll_period = std::chrono::milliseconds(5);
  options.watch = std::chrono::milliseconds(20);
  options.quiet = options.late = std::chrono::milliseconds(10);
  options.standstill = std::chrono::milliseconds(100);
  return options;
}

// "R4: the active program changed ...", one line a rule that is broken.
inline std::string Broken(const host::Acceptance& result) {
  std::string text;
  for (std::size_t i = 0; i < host::kRuleCount; ++i) {
    if (result.rules[i].outcome != host::Outcome::kFailed) continue;
    text += host::RuleName(static_cast<host::Rule>(i + 1)) + ": " + result.rules[i].detail + "\n";
  }
  return text + result.trouble;
}

inline std::string Untried(const host::Acceptance& result) {
  std::string text;
  for (std::size_t i = 0; i < host::kRuleCount; ++i) {
    if (result.rules[i].outcome != host::Outcome::kNotTried) continue;
    text += host::RuleName(static_cast<host::Rule>(i + 1)) + " ";
  }
  return text;
}

}  // namespace bendloop::test
