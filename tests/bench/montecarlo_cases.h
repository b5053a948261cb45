// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "hal/bend_program.h"
#include "tests/bench/bench_cases.h"

namespace bendloop::bench {

// A random scan of a random tube, of one of the kinds that the Monte Carlo goes through.
struct MonteCarloCase : Case {
  // Given to the reconstruction where the kind says so: the truth, bent a little off.
  std::optional<hal::BendProgram> nominal;
  double ovality = 0;
  double systematic_mm = 0;  // how far ovality and pose errors move a point
};

// What the reconstruction is told of the tube.
enum class Drawing {
  kOfKind,     // what the kind says
  kPart,       // the tube, bent a little off
  kBendMore,   // the same with a slight bend that the part does not have
  kBendFewer,  // the same without the part's slightest bend
};

// The names of the kinds, in the order of the seeds: seed modulo their number is the kind.
const std::vector<std::string>& MonteCarloKinds();

// The tube and the scan depend on the seed alone.
MonteCarloCase DrawMonteCarloCase(std::uint64_t seed, Drawing drawing = Drawing::kOfKind);

}  // namespace bendloop::bench
