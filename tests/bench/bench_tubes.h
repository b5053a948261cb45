// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "tests/bench/bench_cases.h"
#include "tests/bench/bench_table.h"
#include "tests/bench/comparison.h"

namespace bendloop::bench {

// Structure, errors and times over many tubes.
struct TubeResults {
  int tubes = 0;
  int right = 0;
  LraRatios over_sigma, over_bound, plain;
  Ratio ends;
  std::vector<double> ends_over_spacing;
  std::vector<double> distance_over_noise;
  std::vector<double> cpu_ms;
  std::vector<std::string> wrong;
  nlohmann::json list = nlohmann::json::array();
};

// Measures one more.
void RunTube(const Case& scan, TubeResults& results);

// All of them beside their targets.
std::vector<Row> TubeRows(const TubeResults& results);

}  // namespace bendloop::bench
