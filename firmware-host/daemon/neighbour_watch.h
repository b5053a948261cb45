// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <string>

#include "firmware-host/daemon/machine_load.h"

namespace bendloop::host {

// Sees when others on this machine take what the daemon may need: its processors, its memory. Real
// time and locked memory keep them from it for long, so that nothing else would tell. By a clock
// that nobody sets; from one thread.
class NeighbourWatch {
 public:
  // How long others must want nearly all processors; how long nothing must be swapped out until
  // that is over.
  static constexpr std::chrono::seconds kLasting{60};
  // Of all processors, where it begins, and where it is over.
  static constexpr double kCrowded = 0.9;
  static constexpr double kRoomy = 0.7;
  // In a minute; less is what a kernel puts away that nobody has asked for in days.
  static constexpr std::uint64_t kSwappedBytes = 16u << 20;

  bool IsDue(std::chrono::nanoseconds now) const;
  void Look(std::chrono::nanoseconds now, const MachineLoad& load);

  // What is the matter, for an alarm; empty: nothing.
  const std::optional<std::string>& crowded() const { return crowded_; }
  const std::optional<std::string>& swaps() const { return swaps_; }

 private:
  void LookAtProcessors(std::chrono::nanoseconds now, const MachineLoad& load);
  void LookAtSwap(std::chrono::nanoseconds now, const MachineLoad& load);

  std::optional<std::chrono::nanoseconds> looked_;
  double own_cpu_s_ = 0;
  double own_ = 0;  // processors that this process takes, as the kernel's mean of a minute
  std::optional<std::chrono::nanoseconds> crowded_since_;
  std::optional<std::string> crowded_;
  std::uint64_t swapped_bytes_ = 0;  // when the minute began
  std::chrono::nanoseconds minute_began_{0};
  std::chrono::nanoseconds swapped_at_{0};
  std::optional<std::string> swaps_;
};

}  // namespace bendloop::host
