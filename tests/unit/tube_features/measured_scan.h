// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <cstddef>

#include "drivers/simulated_scanner/virtual_scan.h"
#include "hal/clock.h"
#include "hal/tube.h"
#include "pipeline/reconstruction.h"

namespace bendloop::pipeline {

// What all profiles of a virtual scan tell; a test that has none fails.
inline Measurement MeasureScan(const hal::Tube& tube, const drivers::VirtualScanOptions& options,
                               const ReconstructionOptions& kept = {}) {
  const drivers::VirtualScan scan(tube, options);
  const hal::ManualClock clock;
  Reconstruction reconstruction(kept, clock);
  hal::LaserProfile profile(scan.max_points());
  for (std::size_t i = 0; i < scan.profile_count(); ++i) {
    scan.Make(i, profile);
    reconstruction.Add(profile);
  }
  auto measurement = reconstruction.Finish();
  EXPECT_TRUE(measurement) << (measurement ? "" : measurement.error().message);
  return measurement ? *measurement : Measurement{};
}

}  // namespace bendloop::pipeline
