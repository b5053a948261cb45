// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "tests/bench/load/load_report.h"

namespace bendloop::bench {

// A row of latency histograms for each run; below, queue, lateness and memory of all runs over the
// time of scanning.
std::string LoadSvg(const std::vector<LoadReport>& reports);

// Memory, latencies and the errors of each L, R, A over the parts.
std::string SoakSvg(const LoadReport& report);

}  // namespace bendloop::bench
