// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "hal/result.h"

namespace bendloop::host {

// What the acquisition thread asks of the kernel.
struct RealtimePolicy {
  bool enabled = false;   // ask for SCHED_FIFO and locked memory
  bool required = false;  // refuse to start without them
  int priority = 50;      // SCHED_FIFO, 1..99
  int cpu = -1;           // pin the thread to this CPU; -1: anywhere
};

// Applies `policy` to the calling thread (memory lock: to the process). The note says in one line
// what was not granted and how to grant it, "" if nothing is missing. kDevice when it is required.
hal::Result<std::string> ApplyRealtime(const RealtimePolicy& policy);

// How far the thread that reconstructs goes before ordinary ones; it stays an ordinary one, because
// it may use a whole CPU for a while.
inline constexpr int kPipelineNice = -10;

// The same for that thread: lets it go before what else runs on the machine.
hal::Result<std::string> FavourPipeline(const RealtimePolicy& policy);

// Lets the process keep the memory that it has had: to give it back after each scan and to get it
// again, page by page, would cost the final fit a third of its time. Once, before any thread.
void KeepMemory();

}  // namespace bendloop::host
