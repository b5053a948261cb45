// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/acceptance/timing.h"

#include <algorithm>
#include <cmath>

namespace bendloop::host {
namespace {

double PercentileMs(const std::vector<std::chrono::nanoseconds>& sorted, double part) {
  const auto rank = static_cast<std::size_t>(std::ceil(part * static_cast<double>(sorted.size())));
  return std::chrono::duration<double, std::milli>(sorted[rank == 0 ? 0 : rank - 1]).count();
}

}  // namespace

std::vector<TimingSummary> Timing::Summarise() const {
  std::vector<TimingSummary> summaries;
  for (const auto& [kind, samples] : samples_) {
    std::vector<std::chrono::nanoseconds> sorted = samples;
    std::sort(sorted.begin(), sorted.end());
    summaries.push_back({kind, sorted.size(), PercentileMs(sorted, 0.5), PercentileMs(sorted, 0.9),
                         PercentileMs(sorted, 0.99), PercentileMs(sorted, 1)});
  }
  return summaries;
}

}  // namespace bendloop::host
