// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "config/cell_config.h"
#include "firmware-host/cell/service_times.h"
#include "firmware-host/ledger/tube_ledger.h"

namespace bendloop::host {

// How the cell file has tubes told apart, as the ledger takes it.
LedgerRules LedgerRulesOf(const config::CellConfig& cell);

// Empty, or why corrections stay off though the cell file asks for them, with the mend.
std::string WhyNothingIsCorrected(const config::CellConfig& cell);

// What a setter should know of a cell file that is right: what it asks for and does not get, each
// with the mend. `service`: what the service manager grants here.
std::vector<std::string> RemarksOn(const config::CellConfig& cell, const ServiceTimes& service);

}  // namespace bendloop::host
