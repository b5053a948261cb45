// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "config/cell_config.h"
#include "firmware-host/cell/part_plan.h"
#include "firmware-host/daemon/daemon_options.h"
#include "hal/result.h"

namespace bendloop::host {

// What the daemon goes by: the cell file with all that it names, as the command line changes it.
struct DaemonSettings {
  config::CellConfig cell;
  PartPlan plan;  // of the cell's own part
};

// Reads it all; kBadInput says which file, where, and what is wrong, or what of it the service that
// runs us does not grant. Nothing is changed.
hal::Result<DaemonSettings> LoadDaemonSettings(const DaemonOptions& options);

}  // namespace bendloop::host
