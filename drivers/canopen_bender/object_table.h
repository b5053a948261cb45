// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "drivers/register_bender/register_image.h"
#include "hal/register_map.h"

namespace bendloop::drivers {

// An object that a map names, and the registers in which it is kept here.
struct MappedObject {
  hal::ObjectAddress object;
  RegisterRange range;
  std::size_t bytes = 0;    // on the wire; rows: at most
  bool is_rows = false;     // a DOMAIN with the rows one after the other, or a text
  bool is_written = false;  // by us: staging, commit and report
};

// Every object of the map once, in the order in which they are read and written: the number of an
// answered commit before the answer, which the bender sets first, and rows before their head.
std::vector<MappedObject> ObjectsOf(const hal::RegisterMap& map);

// Registers as the bytes on the wire and back. `bytes` may be 1 for one register.
std::vector<std::uint8_t> ToBytes(const std::uint16_t* words, std::size_t bytes);
void FromBytes(std::span<const std::uint8_t> bytes, std::uint16_t* words);

}  // namespace bendloop::drivers
