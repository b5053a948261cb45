// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "tests/bench/bench_noise.h"
#include "tests/bench/bench_times.h"

namespace bendloop::bench {

// Processor time over points, ours and each rival's, with linear growth and the targets.
std::string TimeSvg(const std::vector<SizedTimes>& sizes);

// Errors of L, R and A over the noise beside the Cramer-Rao bound.
std::string NoiseSvg(const NoiseSweep& sweep);

}  // namespace bendloop::bench
