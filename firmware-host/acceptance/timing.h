// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstddef>
#include <map>
#include <string>
#include <vector>

namespace bendloop::host {

// How long the exchanges of one kind took.
struct TimingSummary {
  std::string kind;
  std::size_t count = 0;
  double p50_ms = 0;
  double p90_ms = 0;
  double p99_ms = 0;
  double max_ms = 0;
};

class Timing {
 public:
  void Add(const std::string& kind, std::chrono::nanoseconds took) {
    samples_[kind].push_back(took);
  }
  // Every kind, by its name. Percentiles are the smallest sample that so many are not above.
  std::vector<TimingSummary> Summarise() const;

 private:
  std::map<std::string, std::vector<std::chrono::nanoseconds>> samples_;
};

}  // namespace bendloop::host
