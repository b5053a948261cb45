// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <string>

#include "config/cell_config.h"
#include "drivers/register_bender/register_bender.h"
#include "hal/clock.h"

namespace bendloop::host {

// The way to the bender that the cell file names, which must be a real one (config::IsReal).
// `clock` must outlive it.
std::unique_ptr<drivers::RegisterCarrier> MakeBenderCarrier(const config::BenderConfig& bender,
                                                            hal::Clock& clock);

// The same in words, for the log: "modbus 192.168.10.5:502".
std::string BenderCarrierName(const config::BenderConfig& bender);

}  // namespace bendloop::host
