// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

namespace bendloop::test {

// Counts what the calling thread does between construction and destruction, by standing in front of
// the C library's functions in this test program.
class CallGuard {
 public:
  CallGuard();
  ~CallGuard();

  static std::uint64_t allocations();       // malloc, calloc, realloc, aligned_alloc, operator new
  static std::uint64_t locks();             // pthread_mutex_lock, rwlocks
  static std::uint64_t wall_clock_waits();  // sem_timedwait
  // False in builds whose sanitizer owns malloc.
  static bool works();
};

}  // namespace bendloop::test
