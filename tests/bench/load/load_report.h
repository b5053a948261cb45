// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <ostream>
#include <string>
#include <vector>

#include "tests/bench/bench_table.h"
#include "tests/bench/load/load_run.h"

namespace bendloop::bench {

struct LoadReport {
  LoadCase load;
  LoadResult result;
};

// One run's figures beside their targets.
std::vector<Row> LoadRows(const LoadCase& load, const LoadResult& result);

// One run's latencies, queue and lateness, counted by size, with p50, p99 and max.
void PrintHistograms(std::ostream& out, const LoadResult& result);

// All runs, a column each.
void PrintSideBySide(std::ostream& out, const std::vector<LoadReport>& reports);

}  // namespace bendloop::bench
