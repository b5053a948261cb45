// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>
#include <ostream>
#include <vector>

#include "tests/bench/comparison.h"

namespace bendloop::bench {

// The same tubes at several noises.
struct NoiseSweep {
  struct Level {
    double noise_mm = 0;
    int right = 0;    // tubes with the right number of bends
    LraRatios error;  // rms, mm and degrees
    LraRatios bound;  // rms of the Cramer-Rao bounds of the same values
  };
  int tubes = 0;
  int compared = 0;  // right at every level: errors are of these tubes alone
  std::vector<Level> levels;
};

// Noises from 0.01 to 0.12 mm on every `stride`-th of the 30 tubes as in section 8 of the paper, of
// each set. A value that even the bound hardly determines at one level (comparison.h) is left out
// of all, so that each level is about the same values.
NoiseSweep SweepNoise(int stride, std::uint64_t sets);

void PrintNoise(std::ostream& out, const NoiseSweep& sweep);
nlohmann::json ToJson(const NoiseSweep& sweep);

}  // namespace bendloop::bench
