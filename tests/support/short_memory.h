// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

namespace bendloop::test {

// Want of memory in one thread, named as it names itself (pthread_setname_np): its allocation of
// that number from now on fails, by standing in front of the C library's in this test program. Of
// one at a time.
class ShortMemory {
 public:
  enum class Lasts { kOnce, kFromThenOn };
  ShortMemory(const char* thread, std::int64_t number, Lasts lasts = Lasts::kOnce);
  ShortMemory(const ShortMemory&) = delete;
  ShortMemory& operator=(const ShortMemory&) = delete;
  ~ShortMemory();

  // How many have failed.
  static std::int64_t failed();
};

}  // namespace bendloop::test
