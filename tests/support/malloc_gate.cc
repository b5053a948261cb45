// SPDX-License-Identifier: Apache-2.0
#include "tests/support/malloc_gate.h"

#include <cstddef>

#include "tests/support/sanitized.h"

#ifndef BENDLOOP_SANITIZED
using bendloop::test::MayAllocate;

extern "C" {
void* __libc_malloc(std::size_t);                 // NOLINT
void* __libc_calloc(std::size_t, std::size_t);    // NOLINT
void* __libc_realloc(void*, std::size_t);         // NOLINT
void* __libc_memalign(std::size_t, std::size_t);  // NOLINT

void* malloc(std::size_t size) noexcept { return MayAllocate() ? __libc_malloc(size) : nullptr; }
void* calloc(std::size_t count, std::size_t size) noexcept {
  return MayAllocate() ? __libc_calloc(count, size) : nullptr;
}
void* realloc(void* old, std::size_t size) noexcept {
  return MayAllocate() ? __libc_realloc(old, size) : nullptr;
}
void* aligned_alloc(std::size_t alignment, std::size_t size) noexcept {
  return MayAllocate() ? __libc_memalign(alignment, size) : nullptr;
}
}
#endif
