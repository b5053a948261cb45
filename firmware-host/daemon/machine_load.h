// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

namespace bendloop::host {

// How much this machine has to do, the daemon aside or not.
struct MachineLoad {
  // Threads of everybody that run, want to run, or wait for a disk: mean of the last minute.
  double wanted = 0;
  unsigned processors = 1;
  double own_cpu_s = 0;  // processor time of this process since its start
  std::uint64_t swapped_bytes = 0;
  std::uint64_t own_swapped_bytes = 0;  // of this process
};

// As the kernel tells it to a service that sees no process but its own (ProcSubset=pid).
MachineLoad LookAtMachine();

}  // namespace bendloop::host
