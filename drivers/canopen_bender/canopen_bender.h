// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <string>

#include "drivers/canopen_bender/canopen_node.h"
#include "drivers/register_bender/register_bender.h"
#include "hal/bender_link.h"
#include "hal/clock.h"
#include "hal/register_map.h"

namespace bendloop::drivers {

struct CanopenBenderOptions {
  std::string interface = "can0";  // , up and at the bus's bit rate
  std::uint8_t node_id = 1;        // 1 to 127
  // Who must answer there, as object 1018 says it; 0: whoever.
  std::uint32_t vendor_id = 0;
  std::uint32_t product_code = 0;
  std::chrono::milliseconds response_timeout{500};  // from one frame of a transfer to the next
  // The longest that the node's heartbeat may stay away, once it was seen; 0: it sends none.
  std::chrono::milliseconds heartbeat_timeout{2000};
};

// A bender as a CANopen node; which objects are which comes from `map`, which must be one of
// objects. drivers/README.md tells the controller's side. bendloop is an SDO client and nothing
// else: no NMT master, no PDOs. Not thread-safe: one thread talks to one bender.
std::unique_ptr<hal::BenderLink> MakeCanopenBender(hal::RegisterMap map,
                                                   const CanopenBenderOptions& options,
                                                   hal::Clock& clock);

// The same with another way onto the bus.
std::unique_ptr<hal::BenderLink> MakeCanopenBender(hal::RegisterMap map,
                                                   const CanopenBenderOptions& options,
                                                   hal::Clock& clock, CanPortOpener open);

// Its objects alone, as registers.
std::unique_ptr<RegisterCarrier> MakeCanopenCarrier(const hal::RegisterMap& map,
                                                    const CanopenBenderOptions& options,
                                                    hal::Clock& clock);
std::unique_ptr<RegisterCarrier> MakeCanopenCarrier(const hal::RegisterMap& map,
                                                    const CanopenBenderOptions& options,
                                                    hal::Clock& clock, CanPortOpener open);

}  // namespace bendloop::drivers
