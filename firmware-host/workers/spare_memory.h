// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace bendloop::host {

// Memory that is kept aside and given to whoever asks first where there is no other, so that what
// is at hand can be ended or undone. Without it the process would end where a destructor wants
// some: that of a JSON tree does (nlohmann's takes it down by a stack on the heap). What asks after
// that is told std::bad_alloc (want_of_memory.h). One in a process, while it lives.
class SpareMemory {
 public:
  SpareMemory();
  ~SpareMemory();
  SpareMemory(const SpareMemory&) = delete;
  SpareMemory& operator=(const SpareMemory&) = delete;

  // Keeps it aside again, if there is so much; false: it had been given since it was asked last.
  static bool Refill() noexcept;
};

}  // namespace bendloop::host
