// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <string>

#include "firmware-host/result/run_result.h"

namespace bendloop::host {

// Charts of the deviations of angles, lengths and rotations from part to part, with tolerance band
// and bars of 1 sigma. Empty when no run was compared with a nominal.
std::string TrendSvg(std::span<const RunResult> runs);

}  // namespace bendloop::host
