// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "drivers/register_bender/register_image.h"
#include "hal/bender_link.h"
#include "hal/register_map.h"
#include "hal/result.h"

namespace bendloop::drivers {

// Brings registers to a bender and back. Each call is one bounded exchange; errors are kDevice and
// name the bender. After one the next call may succeed.
class RegisterCarrier {
 public:
  // What the controller tells beside its registers.
  struct Signs {
    std::optional<std::uint32_t> heartbeat;   // messages so far, where the carrier has its own
    std::optional<std::uint32_t> fault_code;  // 0: none
  };

  virtual ~RegisterCarrier() = default;

  virtual std::string carrier() const = 0;  // "Modbus TCP"
  virtual std::string peer() const = 0;     // "127.0.0.1:502 unit 1"
  // Does nothing when connected.
  virtual hal::Result<void> Connect() = 0;
  // Whole fields and rows of the map, in as few requests as it allows.
  virtual hal::Result<void> Read(const std::vector<RegisterRange>& ranges,
                                 RegisterImage& image) = 0;
  virtual hal::Result<void> Write(const std::vector<RegisterRange>& ranges,
                                  const RegisterImage& image) = 0;
  virtual Signs signs() const { return {}; }
};

// A bender that shows itself as registers, whatever carries them: which are which, and the
// controller's conventions, come from `map`. drivers/README.md tells the controller's side. Not
// thread-safe: one thread talks to one bender.
std::unique_ptr<hal::BenderLink> MakeRegisterBender(hal::RegisterMap map,
                                                    std::unique_ptr<RegisterCarrier> carrier);

}  // namespace bendloop::drivers
