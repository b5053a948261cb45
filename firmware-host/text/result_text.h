// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "firmware-host/result/run_result.h"

namespace bendloop::host {

// The measured rows with 1 sigma each, pipe radius, fit and warnings: what `reconstruct` prints.
std::string MeasurementText(const pipeline::Measurement& measurement, bool colour);

// Nominal, measured, uncertainty, deviation, tolerance, corrected and the change of command, one
// line for each number of each row. Without an inspection it is MeasurementText.
std::string ComparisonText(const RunResult& result, bool colour);

// One line: the part, the verdict, what became of the correction.
std::string VerdictLine(const RunResult& result, bool colour);

// Everything for a person: the verdict, the table, the reasons, the interlocks that refused, the
// notices and the warnings.
std::string RunText(const RunResult& result, bool colour);

}  // namespace bendloop::host
