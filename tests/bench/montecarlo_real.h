// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "hal/bend_program.h"
#include "tests/support/real_tube.h"

namespace bendloop::bench {

// A random scan of a tube as benders make them: bowed, eased, dented, drifting, thin in places.
struct RealCase {
  std::string kind;
  std::uint64_t seed = 0;
  tests::RealCloud cloud;
  tests::Form form;          // what of it is no line and no arc
  hal::BendProgram nominal;  // the truth, bent a little off
};

const std::vector<std::string>& RealKinds();
// Where none is asked for: one after the other.
const std::string& RealKindOf(std::uint64_t seed);

// `kind`: one of them.
RealCase DrawRealCase(std::uint64_t seed, const std::string& kind);

struct RealRun {
  std::vector<std::uint64_t> seeds;
  std::string kind;  // of all of them; none: that of each seed
  unsigned threads = 1;
  bool with_nominal = false;
  bool verbose = false;  // every tube with what was found and what is true
  std::string json_path;
};

// Measures them and prints a table. 0: done.
int RunReal(const RealRun& run);

}  // namespace bendloop::bench
