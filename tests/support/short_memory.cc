// SPDX-License-Identifier: Apache-2.0
#include "tests/support/short_memory.h"

#include <sys/prctl.h>

#include <atomic>
#include <cerrno>
#include <cstddef>
#include <cstdio>
#include <cstring>

#include "tests/support/malloc_gate.h"

namespace {

constexpr std::size_t kNameBytes = 16;  // of a thread, prctl(2)

std::atomic<bool> g_armed{false};
std::atomic<std::int64_t> g_left{0}, g_failed{0};
char g_thread[kNameBytes];
bool g_once = true;

}  // namespace

namespace bendloop::test {

bool MayAllocate() noexcept {
  if (!g_armed.load(std::memory_order_acquire)) return true;
  char name[kNameBytes] = {};
  prctl(PR_GET_NAME, name);
  if (std::strcmp(name, g_thread) != 0) return true;
  const std::int64_t left = --g_left;
  if (g_once ? left != 0 : left > 0) return true;
  ++g_failed;
  errno = ENOMEM;
  return false;
}

ShortMemory::ShortMemory(const char* thread, std::int64_t number, Lasts lasts) {
  std::snprintf(g_thread, sizeof g_thread, "%s", thread);
  g_once = lasts == Lasts::kOnce;
  g_left = number;
  g_failed = 0;
  g_armed.store(true, std::memory_order_release);
}

ShortMemory::~ShortMemory() { g_armed = false; }

std::int64_t ShortMemory::failed() { return g_failed; }

}  // namespace bendloop::test
