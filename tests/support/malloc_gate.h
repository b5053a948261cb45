// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace bendloop::test {

// A test program with malloc_gate.cc allocates through it: asked in the thread that allocates, each
// time; where the answer is no there is no memory. Whoever watches defines it (call_guard.cc,
// short_memory.cc), and allocates nothing there.
bool MayAllocate() noexcept;

}  // namespace bendloop::test
