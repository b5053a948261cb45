// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "firmware-host/result/run_result.h"

namespace bendloop::host {

// "Corrected program committed as sequence 102", or why it was not.
std::string OutcomeText(const RunResult& run);

// Nominal, measured, uncertainty, deviation, limit, commanded and corrected, row by row.
std::string RowsHtml(const RunResult& run);

// The verdict's reasons, the correction in words, the interlocks, tangent points and ends, fit and
// timing: the cards below the table.
std::string CardsHtml(const RunResult& run);

}  // namespace bendloop::host
