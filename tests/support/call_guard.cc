// SPDX-License-Identifier: Apache-2.0
#include "tests/support/call_guard.h"

#include <dlfcn.h>
#include <pthread.h>
#include <semaphore.h>

#include "tests/support/malloc_gate.h"
#include "tests/support/sanitized.h"

namespace {

thread_local bool g_watching = false;
thread_local std::uint64_t g_allocations = 0;
thread_local std::uint64_t g_locks = 0;
thread_local std::uint64_t g_wall_clock_waits = 0;

}  // namespace

#ifndef BENDLOOP_SANITIZED
extern "C" {
int pthread_mutex_lock(pthread_mutex_t* mutex) noexcept {
  using Function = int (*)(pthread_mutex_t*);
  static const auto real = reinterpret_cast<Function>(dlsym(RTLD_NEXT, "pthread_mutex_lock"));
  if (g_watching) ++g_locks;
  return real(mutex);
}
int pthread_rwlock_wrlock(pthread_rwlock_t* lock) noexcept {
  using Function = int (*)(pthread_rwlock_t*);
  static const auto real = reinterpret_cast<Function>(dlsym(RTLD_NEXT, "pthread_rwlock_wrlock"));
  if (g_watching) ++g_locks;
  return real(lock);
}
int sem_timedwait(sem_t* semaphore, const timespec* until) {
  using Function = int (*)(sem_t*, const timespec*);
  static const auto real = reinterpret_cast<Function>(dlsym(RTLD_NEXT, "sem_timedwait"));
  if (g_watching) ++g_wall_clock_waits;
  return real(semaphore, until);
}
}
#endif

namespace bendloop::test {

bool MayAllocate() noexcept {
  if (g_watching) ++g_allocations;
  return true;
}

CallGuard::CallGuard() {
  g_allocations = 0;
  g_locks = 0;
  g_wall_clock_waits = 0;
  g_watching = true;
}
CallGuard::~CallGuard() { g_watching = false; }

std::uint64_t CallGuard::allocations() { return g_allocations; }
std::uint64_t CallGuard::locks() { return g_locks; }
std::uint64_t CallGuard::wall_clock_waits() { return g_wall_clock_waits; }

bool CallGuard::works() {
#ifdef BENDLOOP_SANITIZED
  return false;
#else
  return true;
#endif
}

}  // namespace bendloop::test
