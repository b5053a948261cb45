// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <new>
#include <system_error>

namespace bendloop::host {

// What is told of it, and where to look.
inline constexpr const char* kNoMemory = "out of memory; see what else runs on this machine";

// Does `work`; false where there was no memory for it, or for a thread that it begins. What it had
// changed until then stays: for work that may be left off anywhere.
template <class Work>
bool HasMemoryFor(Work&& work) {
  try {
    work();
    return true;
  } catch (const std::bad_alloc&) {
    return false;
  } catch (const std::system_error& error) {
    // What a thread's beginning throws where its stack finds no room.
    const std::error_code why = error.code();
    if (why != std::errc::resource_unavailable_try_again && why != std::errc::not_enough_memory) {
      throw;
    }
    return false;
  }
}

}  // namespace bendloop::host
