// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

#include "firmware-host/result/run_result.h"

namespace bendloop::host {

// A made-up run of a four-bend tube in which every section is filled and consistent: the measured
// program is the nominal plus known deviations (bend 2 is `angle_error_deg` off; the others are a
// tenth of it off), surface samples lie on the measured tube with 0.03 mm noise, and their
// distances from the nominal's surface are exact. Part `index` counts from 1.
RunResult SampleRun(int index = 1, double angle_error_deg = 1.5, std::size_t surface_samples = 500);

// The nominal of SampleRun.
hal::BendProgram SampleNominal();

}  // namespace bendloop::host
