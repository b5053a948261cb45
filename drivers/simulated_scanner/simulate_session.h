// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <map>
#include <string>

#include "drivers/scanner_wire/wire_format.h"
#include "drivers/simulated_scanner/virtual_scan.h"
#include "hal/result.h"
#include "hal/tube.h"

namespace bendloop::drivers {

// What a number of VirtualScanOptions may be, both ends included.
struct Limits {
  double low;
  double high;

  bool Hold(double value) const { return value >= low && value <= high; }  // never a NaN
  std::string Text() const;                                                // "0 to 100"
};
inline constexpr Limits kNoiseMm = {0, 100};  // and jitter
inline constexpr Limits kNoiseGrowth = {0, 4};
inline constexpr Limits kFraction = {0, 1};
inline constexpr Limits kRays = {1, kWireMaxPoints};
inline constexpr Limits kSpacingMm = {0.01, 1000};
inline constexpr Limits kWallMm = {0, 1000};
inline constexpr Limits kTableGapMm = {0, 1000};
inline constexpr Limits kProfilesPerSecond = {0.1, 1e6};

struct SimulateSessionOptions {
  VirtualScanOptions scan;
  bool lay_on_table = true;        // in a seeded pose (LayOnTable); else the tube stays where it is
  std::string part = "simulated";  // meta "part"
  std::string start = "2000-01-01T00:00:00Z";    // meta "start", fixed so that files are the same
  std::string software = "bendloop simulate";    // meta "software"
  std::map<std::string, std::string> more_meta;  // e.g. the true program
};

struct SimulatedSession {
  hal::Tube tube;  // as it lay
  std::size_t profiles = 0;
  std::size_t points = 0;
};

// Scans `tube` as it truly is and records the scan at `path`, over a session that may be there.
// kUsage for options that make no sense (named in the message), kBadInput for a tube that has no
// surface, else the errors of SessionWriter.
hal::Result<SimulatedSession> SimulateSession(const hal::Tube& tube,
                                              const SimulateSessionOptions& options,
                                              const std::string& path);

// What is wrong with the options or the tube, as SimulateSession says it.
hal::Result<void> CheckScan(const hal::Tube& tube, const VirtualScanOptions& options);

}  // namespace bendloop::drivers
