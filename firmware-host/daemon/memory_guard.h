// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <string>

#include "firmware-host/workers/want_of_memory.h"
#include "hal/result.h"

namespace bendloop::host {

// For work beside the cell loop that the cell can do without: where memory is short, `what` was not
// done, which is told, and done again when it is due next. Its exception would end the daemon, or
// be lost with its future.
inline hal::Result<void> OrOutOfMemory(const std::string& what,
                                       const std::function<hal::Result<void>()>& work) {
  hal::Result<void> done;
  if (HasMemoryFor([&] { done = work(); })) return done;
  return hal::Fail(hal::ErrorKind::kDevice, what + ": " + kNoMemory);
}

}  // namespace bendloop::host
