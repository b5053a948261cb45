// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "drivers/register_bender/register_image.h"
#include "hal/cell_report.h"
#include "hal/register_map.h"
#include "hal/result.h"

namespace bendloop::drivers {

// What a PLC reads of the cell and says to it, from and to registers. All fields may be left out.

// Of what the PLC says.
std::vector<RegisterRange> OrderRanges(const hal::OrderFields& fields);
hal::Result<hal::PlcOrders> DecodeOrders(const hal::RegisterMap& map, const RegisterImage& image);
// Of the PLC's side: fields that are empty are left as they are.
void EncodeOrders(const hal::RegisterMap& map, const hal::PlcOrders& orders, RegisterImage& image);

// Of what the PLC reads: the sequence of the last tube, which is written after the rest, by itself.
std::vector<RegisterRange> ReportRanges(const hal::ReportFields& fields);
std::vector<RegisterRange> ReportSequenceRanges(const hal::ReportFields& fields);
// Counts go on from 0 beyond what their register holds, percents stop there. kBadInput when a part
// number does not fit.
hal::Result<void> EncodeReport(const hal::RegisterMap& map, const hal::CellReport& report,
                               RegisterImage& image);
// Of the PLC's side.
hal::Result<hal::CellReport> DecodeReport(const hal::RegisterMap& map, const RegisterImage& image);

}  // namespace bendloop::drivers
