// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <string>

#include "firmware-host/result/run_result.h"

namespace bendloop::host {

// What the part is called: the number at the end of its session's name ("part-0006" is part 6), so
// that a page of the last twenty parts names them as the cell does; else its place on the page.
std::string PartNumber(const RunResult& run, std::size_t index);

// "Corrected program committed as sequence 102", or why it was not.
std::string OutcomeText(const RunResult& run);

// Nominal, measured, uncertainty, deviation, limit, commanded and corrected, row by row.
std::string RowsHtml(const RunResult& run);

// The verdict's reasons, the correction in words, the interlocks, tangent points and ends and the
// fit: the cards below the table. How long each step took is folded away, for developers.
std::string CardsHtml(const RunResult& run);

}  // namespace bendloop::host
