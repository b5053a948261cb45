// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <nlohmann/json.hpp>
#include <ostream>
#include <string>
#include <vector>

#include "tests/bench/load/load_run.h"

namespace bendloop::bench {

// How one value went over the parts of a soak, after a warm-up: a straight line through it.
struct Drift {
  std::string what;
  std::string unit;
  double first = 0;  // means of the first and of the last tenth
  double last = 0;
  double per_1000_parts = 0;  // slope
  double sigma = 0;           // 1 sigma of it, as from independent values
  double matters = 0;         // a change over the soak that would be worth a look
  bool drifts = false;        // the line rises or falls by more than that, and by 3 sigma
};

// The first part behind the warm-up: the reports kept for the operator are filling until then.
std::size_t WarmParts(std::size_t parts);

// Memory, latencies, and the error of each L, R, A.
std::vector<Drift> Drifts(const LoadResult& result);
void PrintDrifts(std::ostream& out, const LoadResult& result, const std::vector<Drift>& drifts);
nlohmann::json ToJson(const std::vector<Drift>& drifts);

}  // namespace bendloop::bench
