// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "tests/bench/load/load_run.h"

namespace bendloop::bench {

struct PlotSeries {
  std::string name;
  LoadResult result;
};

// One row a run: histograms of the three latencies, and memory over the parts.
std::string PlotSvg(const std::vector<PlotSeries>& series);

}  // namespace bendloop::bench
