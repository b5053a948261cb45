// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "hal/register_map.h"

namespace bendloop::drivers {

constexpr std::size_t kAddressSpaceSize = 65536;

struct RegisterRange {
  hal::RegisterSpace space = hal::RegisterSpace::kHolding;
  std::uint32_t address = 0;  // zero-based
  std::uint32_t count = 0;    // address + count <= 65536

  bool operator==(const RegisterRange&) const = default;
};

// All registers of one Modbus unit, as the 16-bit words that go over the wire. The link keeps what
// it read in one, the simulated bender is one.
class RegisterImage {
 public:
  RegisterImage() : holding_(kAddressSpaceSize), input_(kAddressSpaceSize) {}

  // Data of a range's first register; valid for all that follow it in its space.
  std::uint16_t* At(hal::RegisterSpace space, std::uint16_t address) {
    return Space(space).data() + address;
  }
  const std::uint16_t* At(hal::RegisterSpace space, std::uint16_t address) const {
    return const_cast<RegisterImage*>(this)->At(space, address);
  }

 private:
  std::vector<std::uint16_t>& Space(hal::RegisterSpace space) {
    return space == hal::RegisterSpace::kHolding ? holding_ : input_;
  }

  std::vector<std::uint16_t> holding_;
  std::vector<std::uint16_t> input_;
};

}  // namespace bendloop::drivers
