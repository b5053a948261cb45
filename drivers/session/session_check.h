// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "hal/result.h"

namespace bendloop::drivers {

struct SessionSummary {
  std::map<std::string, std::string> meta;
  std::size_t profiles = 0;  // readable ones
  std::size_t points = 0;
  std::size_t max_points = 0;
  std::size_t events = 0;
  std::int64_t first_t_ns = 0;  // of the profiles
  std::int64_t last_t_ns = 0;
  std::vector<std::string> problems;  // each makes the session unfit for replay
  std::size_t problems_left_out = 0;  // beyond the first 100
  std::vector<std::string> warnings;  // replay works, but somebody should know

  bool ok() const { return problems.empty(); }
};

// Reads a whole session and says everything that is wrong with it, not only the first thing. An
// error only if the file cannot be opened as a session at all.
hal::Result<SessionSummary> CheckSession(const std::string& path);

}  // namespace bendloop::drivers
