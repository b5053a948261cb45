// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>

#include "hal/cell_report.h"
#include "hal/register_map.h"
#include "hal/result.h"

namespace bendloop::host {

// The lines of PlcOrderOf for a help text.
std::string_view PlcOrderHelp();

// "part_number 1002", "identity COIL 7/T-1": what the PLC is to say, one field as the register map
// calls it, with its value as drivers/README.md has it. kUsage for anything else, and where
// `fields` has no such field.
hal::Result<hal::PlcOrders> PlcOrderOf(std::string_view words, const hal::OrderFields& fields);

// "state 1 idle, alarm 0, ...": those of `fields`, as the register map calls them; one line.
std::string Told(const hal::CellReport& report, const hal::ReportFields& fields);

}  // namespace bendloop::host
