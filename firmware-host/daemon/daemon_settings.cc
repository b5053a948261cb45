// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/daemon/daemon_settings.h"

#include <cstdlib>
#include <utility>

#include "config/load.h"
#include "firmware-host/cell/service_needs.h"
#include "firmware-host/cell/tube_rules.h"

namespace bendloop::host {

hal::Result<DaemonSettings> LoadDaemonSettings(const DaemonOptions& options) {
  auto cell = config::LoadCell(options.config);
  if (!cell) return hal::Fail(cell.error());
  ApplyOverrides(options, *cell);
  if (auto granted = CheckGranted(NeedsOf(*cell), std::getenv(kGrantedVariable)); !granted) {
    return hal::Fail(granted.error());
  }
  auto plan = MakePartPlan(*cell);
  if (!plan) return hal::Fail(plan.error());
  if (!WhyNothingIsCorrected(*cell).empty()) plan->corrects = false;
  return DaemonSettings{std::move(*cell), std::move(*plan)};
}

}  // namespace bendloop::host
