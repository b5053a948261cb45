// SPDX-License-Identifier: Apache-2.0
#include "tests/support/call_guard.h"

#include <dlfcn.h>
#include <pthread.h>
#include <semaphore.h>

#include <cstdlib>

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define BENDLOOP_SANITIZED 1
#elif defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer)
#define BENDLOOP_SANITIZED 1
#endif
#endif

namespace {

thread_local bool g_watching = false;
thread_local std::uint64_t g_allocations = 0;
thread_local std::uint64_t g_locks = 0;
thread_local std::uint64_t g_wall_clock_waits = 0;

}  // namespace

#ifndef BENDLOOP_SANITIZED
extern "C" {
void* __libc_malloc(std::size_t);                 // NOLINT
void* __libc_calloc(std::size_t, std::size_t);    // NOLINT
void* __libc_realloc(void*, std::size_t);         // NOLINT
void* __libc_memalign(std::size_t, std::size_t);  // NOLINT

void* malloc(std::size_t size) noexcept {
  if (g_watching) ++g_allocations;
  return __libc_malloc(size);
}
void* calloc(std::size_t count, std::size_t size) noexcept {
  if (g_watching) ++g_allocations;
  return __libc_calloc(count, size);
}
void* realloc(void* old, std::size_t size) noexcept {
  if (g_watching) ++g_allocations;
  return __libc_realloc(old, size);
}
void* aligned_alloc(std::size_t alignment, std::size_t size) noexcept {
  if (g_watching) ++g_allocations;
  return __libc_memalign(alignment, size);
}
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
