// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/daemon/neighbour_watch.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

namespace bendloop::host {
namespace {

using namespace std::chrono_literals;

constexpr auto kPeriod = 5s;
// Of the kernel's mean.
constexpr double kMeanSeconds = 60;

double Seconds(std::chrono::nanoseconds time) {
  return std::chrono::duration<double>(time).count();
}

}  // namespace

bool NeighbourWatch::IsDue(std::chrono::nanoseconds now) const {
  return !looked_ || now - *looked_ >= kPeriod;
}

void NeighbourWatch::Look(std::chrono::nanoseconds now, const MachineLoad& load) {
  if (!looked_) {
    swapped_bytes_ = load.swapped_bytes;
    minute_began_ = now;
  } else if (now > *looked_) {
    const double seconds = Seconds(now - *looked_);
    const double taken = (load.own_cpu_s - own_cpu_s_) / seconds;
    own_ += (taken - own_) * (1 - std::exp(-seconds / kMeanSeconds));
  }
  looked_ = now;
  own_cpu_s_ = load.own_cpu_s;
  LookAtProcessors(now, load);
  LookAtSwap(now, load);
}

void NeighbourWatch::LookAtProcessors(std::chrono::nanoseconds now, const MachineLoad& load) {
  const double others = std::max(0.0, load.wanted - own_);
  const double share = others / load.processors;
  if (share < (crowded_ ? kRoomy : kCrowded)) {
    crowded_since_.reset();
    crowded_.reset();
    return;
  }
  if (!crowded_since_) crowded_since_ = now;
  if (now - *crowded_since_ < kLasting) return;
  char text[96];
  std::snprintf(text, sizeof text, "others want %.1f of %u processors", others, load.processors);
  crowded_ = text;
}

void NeighbourWatch::LookAtSwap(std::chrono::nanoseconds now, const MachineLoad& load) {
  const std::uint64_t grown =
      load.swapped_bytes > swapped_bytes_ ? load.swapped_bytes - swapped_bytes_ : 0;
  if (grown >= kSwappedBytes) {
    char text[96];
    std::snprintf(text, sizeof text, "%llu MB are swapped out, %llu MB of them this daemon's",
                  static_cast<unsigned long long>(load.swapped_bytes >> 20),
                  static_cast<unsigned long long>(load.own_swapped_bytes >> 20));
    swaps_ = text;
    swapped_at_ = now;
  } else if (swaps_ && now - swapped_at_ >= kLasting) {
    swaps_.reset();
  }
  if (grown < kSwappedBytes && load.swapped_bytes >= swapped_bytes_ &&
      now - minute_began_ < kLasting) {
    return;
  }
  swapped_bytes_ = load.swapped_bytes;
  minute_began_ = now;
}

}  // namespace bendloop::host
