// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <unistd.h>

#include <cstdint>
#include <cstdio>
#include <cstdlib>

namespace bendloop {

// A place that a fuzz target must come to: what lies behind it is what is fuzzed. A target that its
// parser refuses everything from, or that opens no file, looks as green as a good one; so at the
// end of a run over the seeds (BENDLOOP_FUZZ_MUST_REACH is set: ctest does) it fails when one of
// its places was never reached.
class Reached {
 public:
  explicit Reached(const char* what) : what_(what) {}
  Reached(const Reached&) = delete;
  Reached& operator=(const Reached&) = delete;
  ~Reached() {
    if (count_ > 0 || std::getenv("BENDLOOP_FUZZ_MUST_REACH") == nullptr) return;
    std::fprintf(stderr, "fuzz target: no input reached \"%s\"; give it a seed that does\n", what_);
    std::fflush(nullptr);
    _exit(EXIT_FAILURE);  // among the last things of the process: exit() is under way
  }

  void Mark() { ++count_; }

 private:
  const char* what_;
  std::uint64_t count_ = 0;
};

}  // namespace bendloop
