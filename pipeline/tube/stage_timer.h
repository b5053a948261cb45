// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <string>
#include <vector>

#include "hal/clock.h"
#include "pipeline/tube/measurement.h"

namespace bendloop::pipeline {

// What each stage of a measurement took.
class StageTimer {
 public:
  explicit StageTimer(const hal::Clock& clock) : clock_(clock), last_(clock.Now()) {}
  void Done(const std::string& stage) {
    const auto now = clock_.Now();
    times.push_back({stage, std::chrono::duration<double, std::milli>(now - last_).count()});
    last_ = now;
  }
  std::vector<StageTime> times;

 private:
  const hal::Clock& clock_;
  std::chrono::nanoseconds last_;
};

}  // namespace bendloop::pipeline
