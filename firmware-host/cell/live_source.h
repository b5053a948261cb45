// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>

#include "config/cell_config.h"
#include "firmware-host/acquisition/realtime.h"
#include "hal/clock.h"
#include "hal/profile_source.h"
#include "hal/result.h"

namespace bendloop::host {

// The scanner that the cell file names. `clock` must outlive it. Threads that it needs run as
// `realtime` says, as far as that is granted.
hal::Result<std::unique_ptr<hal::ProfileSource>> MakeSource(const config::ScannerConfig& scanner,
                                                            hal::Clock& clock,
                                                            const RealtimePolicy& realtime = {});

}  // namespace bendloop::host
