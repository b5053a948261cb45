// SPDX-License-Identifier: Apache-2.0
#pragma once

// The innermost loops are compiled twice, for any processor and for one with AVX2 and FMA, which
// works on four numbers at a time; the better one is chosen when it is called. One machine always
// chooses the same, so its results stay the same to the bit.
//
// Usage: write the loop as BENDLOOP_LOOP void NameBody(...), then
// BENDLOOP_WIDE(void, Name, (double a, int b), (a, b)) defines Name.
#if defined(__x86_64__)
namespace bendloop::pipeline {
inline const bool kWideProcessor =
    __builtin_cpu_supports("avx2") != 0 && __builtin_cpu_supports("fma") != 0;
}
#define BENDLOOP_LOOP inline __attribute__((always_inline))
#define BENDLOOP_WIDE(result, name, parameters, arguments)                                       \
  __attribute__((target("avx2,fma"))) result name##Wide parameters {                             \
    return name##Body arguments;                                                                 \
  }                                                                                              \
  __attribute__((noinline)) result name##Narrow parameters { return name##Body arguments; }      \
  result name parameters {                                                                       \
    return ::bendloop::pipeline::kWideProcessor ? name##Wide arguments : name##Narrow arguments; \
  }
#else
#define BENDLOOP_LOOP inline
#define BENDLOOP_WIDE(result, name, parameters, arguments) \
  result name parameters { return name##Body arguments; }
#endif
