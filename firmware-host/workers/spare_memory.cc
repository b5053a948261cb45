// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/workers/spare_memory.h"

#include <atomic>
#include <cstddef>
#include <cstdlib>
#include <new>

namespace bendloop::host {
namespace {

// A status page and a result are trees of some tens of kB each; two threads may be at them.
constexpr std::size_t kSpareBytes = 256 << 10;

std::atomic<void*> g_spare{nullptr};
std::atomic<bool> g_is_kept{false};

// Called by operator new, which then tries again.
void Give() {
  void* const spare = g_spare.exchange(nullptr);
  if (spare == nullptr) throw std::bad_alloc();
  std::free(spare);
}

}  // namespace

SpareMemory::SpareMemory() {
  g_is_kept = true;
  Refill();
  std::set_new_handler(Give);
}

SpareMemory::~SpareMemory() {
  std::set_new_handler(nullptr);
  g_is_kept = false;
  std::free(g_spare.exchange(nullptr));
}

bool SpareMemory::Refill() noexcept {
  if (!g_is_kept || g_spare.load() != nullptr) return true;
  void* none = nullptr;
  void* const spare = std::malloc(kSpareBytes);
  if (!g_spare.compare_exchange_strong(none, spare)) std::free(spare);
  return false;
}

}  // namespace bendloop::host
