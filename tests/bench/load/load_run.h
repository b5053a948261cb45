// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "hal/result.h"

namespace bendloop::bench {

// What one run is to do: `parts` scans of `seconds` each, one after the other.
struct LoadCase {
  std::string name;
  double profiles_per_second = 600;
  double seconds = 3;
  std::uint64_t parts = 20;
  bool record = true;
};

// Every value is of one CPU, one machine, one run. Lists have their memory from the start, so that
// what the daemon needs more, part after part, is the daemon's.
struct LoadResult {
  std::string problem;  // "" or why there are no figures
  std::string realtime_note;
  std::uint64_t profiles = 0;
  std::uint64_t points = 0;
  std::uint64_t dropped = 0;           // the ring was full
  std::uint64_t recorder_dropped = 0;  // left out of the recording
  std::uint64_t parts = 0;
  std::uint64_t corrected = 0;
  std::uint64_t refused = 0;
  std::uint64_t failed = 0;
  std::uint64_t wrong_bends = 0;  // measured with another number of bends than are there
  std::string first_reason;       // of a part that was not corrected
  std::uint64_t queue_peak = 0;
  std::uint64_t queue_capacity = 0;
  double cpu_percent = 0;  // of one CPU
  double peak_mb = 0;      // resident, programs and libraries included
  double lateness_peak_ms = 0;
  // While scanning, one a sample_seconds: queue [profiles], lateness of the latest profile,
  // resident memory.
  double sample_seconds = 0;
  std::vector<double> queue, lateness_ms, memory_mb;
  std::vector<double> live_ms;       // profile to the live LRA that first holds it
  std::vector<double> lra_ms;        // last profile to final LRA, one a part
  std::vector<double> committed_ms;  // last profile to the bender's acknowledgement
  std::map<std::string, std::vector<double>> stage_ms;  // of the final LRA
  std::vector<double> part_memory_mb;                   // resident after each part
  // Measured less true, [row of the program][part with the right number of bends].
  std::vector<std::vector<double>> length_error_mm, rotation_error_deg, angle_error_deg;
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(LoadResult, problem, realtime_note, profiles, points, dropped,
                                   recorder_dropped, parts, corrected, refused, failed, wrong_bends,
                                   first_reason, queue_peak, queue_capacity, cpu_percent, peak_mb,
                                   lateness_peak_ms, sample_seconds, queue, lateness_ms, memory_mb,
                                   live_ms, lra_ms, committed_ms, stage_ms, part_memory_mb,
                                   length_error_mm, rotation_error_deg, angle_error_deg)

// Acquisition, ring, recorder, reconstruction, decision, journal and a simulated bender over
// loopback, as the daemon puts them together; sessions and state go below `directory`.
LoadResult RunLoad(const LoadCase& load, const std::filesystem::path& directory);

// The same in a process of its own, so that one run's memory is not the next one's.
LoadResult RunLoadApart(const LoadCase& load, const std::filesystem::path& directory);

}  // namespace bendloop::bench
