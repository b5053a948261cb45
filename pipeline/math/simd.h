// SPDX-License-Identifier: Apache-2.0
#pragma once

// The innermost loops are compiled twice (function multiversioning): for any processor, and for one
// with AVX2 and FMA, which works on four numbers at a time. The better one is chosen when it is
// called. One machine always chooses the same, so its results stay the same to the bit; by how much
// those of another may differ: README.md.
//
// Usage: write the loop as BENDLOOP_LOOP void NameBody(...), then
// BENDLOOP_MULTIVERSION(void, Name, (double a, int b), (a, b)) defines Name.
#if defined(__x86_64__)
namespace bendloop::pipeline {
// Whether the loops for AVX2 and FMA run. Only a test writes it, to compare them with the others.
inline bool uses_avx2 = __builtin_cpu_supports("avx2") != 0 && __builtin_cpu_supports("fma") != 0;
}  // namespace bendloop::pipeline
#define BENDLOOP_LOOP inline __attribute__((always_inline))
#define BENDLOOP_MULTIVERSION(result, name, parameters, arguments)                            \
  __attribute__((target("avx2,fma"))) result name##Avx2 parameters {                          \
    return name##Body arguments;                                                              \
  }                                                                                           \
  __attribute__((noinline)) result name##Portable parameters { return name##Body arguments; } \
  result name parameters {                                                                    \
    return ::bendloop::pipeline::uses_avx2 ? name##Avx2 arguments : name##Portable arguments; \
  }
#else
namespace bendloop::pipeline {
inline bool uses_avx2 = false;
}  // namespace bendloop::pipeline
#define BENDLOOP_LOOP inline
#define BENDLOOP_MULTIVERSION(result, name, parameters, arguments) \
  result name parameters { return name##Body arguments; }
#endif
