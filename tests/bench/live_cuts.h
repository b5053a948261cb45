// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>

#include "tests/bench/cut_scan.h"

namespace bendloop::bench {

// A random tube as bending cells have them (pipe radius 3 to 30 mm, two or three bends), scanned by
// hand: lines 0.3 to 2 mm apart in two to eight passes, noise 0.01 to 0.1 mm. Every fourth is
// plain; the others have oblique ends, a hole in a straight and one in a bend, a slot and a dent.
CutScan ALiveTube(std::uint64_t seed);

// What of `count` such tubes is found, how far off, and what is found where nothing is. `wall_mm`:
// of their wall, at most 0.4 pipe radii; 0: it is not seen where it is cut. `told`: one line of
// each opening as well, and of what is more than 3 sigma off.
void PrintLive(std::uint64_t first_seed, int count, double wall_mm, bool told);

}  // namespace bendloop::bench
