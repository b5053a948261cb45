// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "config/cell_config.h"
#include "firmware-host/ledger/tube_ledger.h"

namespace bendloop::host {

// How the cell file has tubes told apart, as the ledger takes it.
LedgerRules LedgerRulesOf(const config::CellConfig& cell);

// Empty, or why corrections stay off though the cell file asks for them, with the mend.
std::string WhyNothingIsCorrected(const config::CellConfig& cell);

}  // namespace bendloop::host
