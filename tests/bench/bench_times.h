// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <nlohmann/json.hpp>
#include <ostream>
#include <string>
#include <vector>

#include "tests/bench/bench_cases.h"
#include "tests/bench/bench_table.h"
#include "tests/bench/straight_score.h"

namespace bendloop::bench {

// Runs from points in memory to LRA.
struct Series {
  std::vector<double> wall_ms, cpu_ms;
  std::vector<std::string> stages;  // in their order
  std::map<std::string, std::vector<double>> stage_ms;
  std::size_t bends = 0;  // found
  StraightScore score;
};

// Another library's runs on the same points.
struct RivalSeries {
  std::string name;
  std::vector<double> normals_ms, shapes_ms, together_ms;  // processor
  RivalRun last;
  StraightScore score;
};

struct SizedTimes {
  std::size_t points = 0;
  Series ours;
  std::vector<RivalSeries> rivals;
};

// bendloop `runs` times after one that warms up; each rival up to five times, as 15 s allow, but
// once at least. `threads`: bendloop's.
SizedTimes TimeAll(const Case& scan, int runs, bool with_rivals, std::size_t threads);

// bendloop's times and stages beside their targets.
std::vector<Row> PaperRows(const SizedTimes& times);
std::vector<Row> GrowthRows(const std::vector<SizedTimes>& sizes);

// Everybody on the same points: times and what was found.
void PrintSideBySide(std::ostream& out, const std::vector<SizedTimes>& sizes);
nlohmann::json ToJson(const std::vector<SizedTimes>& sizes);

}  // namespace bendloop::bench
