// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "firmware-host/result/run_result.h"
#include "pipeline/fit/correlations.h"

namespace bendloop::host {

// One sentence for each run of bends whose values are hardly told apart though it is known how the
// tube goes on behind them; rows as in the tables.
std::vector<std::string> TogetherLines(const pipeline::JointUncertainty& joint, std::size_t bends);
// The same of a run's rows, in the nominal's order.
std::vector<std::string> TogetherLines(const RunResult& result);

// pipeline::CorrectionFlag in words; empty when nobody needs to be told.
std::string FlagText(std::uint32_t flags);

// The measured rows with 1 sigma each, pipe radius, fit and warnings: what `reconstruct` prints.
std::string MeasurementText(const pipeline::Measurement& measurement, bool colour);

// Nominal, measured, uncertainty, deviation, tolerance, corrected and the change of command, one
// line for each number of each row. Without an inspection it is MeasurementText.
std::string ComparisonText(const RunResult& result, bool colour);

// "the next tube is in tolerance with 97.1 %, least sure: bend 2 angle, 98.0 %"; empty where
// nothing is forecast.
std::string ForecastLine(const RunResult& result);

// One line: the part, the verdict, what became of the correction.
std::string VerdictLine(const RunResult& result, bool colour);

// Everything for a person: the verdict, the table, the reasons, the interlocks that refused, the
// notices and the warnings. The sentences are broken to `columns`; 0: each is one line, as programs
// that read them want it.
std::string RunText(const RunResult& result, bool colour, std::size_t columns = 0);

}  // namespace bendloop::host
