// SPDX-License-Identifier: Apache-2.0
#include "tests/support/short_memory.h"

#include <sys/prctl.h>

#include <atomic>
#include <cerrno>
#include <cstddef>
#include <cstdio>
#include <cstring>

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define BENDLOOP_SANITIZED 1
#elif defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer)
#define BENDLOOP_SANITIZED 1
#endif
#endif

namespace {

constexpr std::size_t kNameBytes = 16;  // of a thread, prctl(2)

std::atomic<bool> g_armed{false};
std::atomic<std::int64_t> g_left{0}, g_failed{0};
char g_thread[kNameBytes];
bool g_once = true;

}  // namespace

#ifndef BENDLOOP_SANITIZED
namespace {

bool Fails() {
  if (!g_armed.load(std::memory_order_acquire)) return false;
  char name[kNameBytes] = {};
  prctl(PR_GET_NAME, name);
  if (std::strcmp(name, g_thread) != 0) return false;
  const std::int64_t left = --g_left;
  if (g_once ? left != 0 : left > 0) return false;
  ++g_failed;
  errno = ENOMEM;
  return true;
}

}  // namespace

extern "C" {
void* __libc_malloc(std::size_t);                 // NOLINT
void* __libc_calloc(std::size_t, std::size_t);    // NOLINT
void* __libc_realloc(void*, std::size_t);         // NOLINT
void* __libc_memalign(std::size_t, std::size_t);  // NOLINT

void* malloc(std::size_t size) noexcept { return Fails() ? nullptr : __libc_malloc(size); }
void* calloc(std::size_t count, std::size_t size) noexcept {
  return Fails() ? nullptr : __libc_calloc(count, size);
}
void* realloc(void* old, std::size_t size) noexcept {
  return Fails() ? nullptr : __libc_realloc(old, size);
}
void* aligned_alloc(std::size_t alignment, std::size_t size) noexcept {
  return Fails() ? nullptr : __libc_memalign(alignment, size);
}
}
#endif

namespace bendloop::test {

ShortMemory::ShortMemory(const char* thread, std::int64_t number, Lasts lasts) {
  std::snprintf(g_thread, sizeof g_thread, "%s", thread);
  g_once = lasts == Lasts::kOnce;
  g_left = number;
  g_failed = 0;
  g_armed.store(true, std::memory_order_release);
}

ShortMemory::~ShortMemory() { g_armed = false; }

std::int64_t ShortMemory::failed() { return g_failed; }

bool ShortMemory::works() {
#ifdef BENDLOOP_SANITIZED
  return false;
#else
  return true;
#endif
}

}  // namespace bendloop::test
