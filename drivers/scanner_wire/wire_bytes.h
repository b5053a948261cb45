// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>

// Little-endian numbers at any address, whatever this machine is. Written as shifts, which
// compilers turn into one load or store.
namespace bendloop::drivers {

template <class Unsigned>
Unsigned LoadLittle(const std::uint8_t* bytes) {
  Unsigned value = 0;
  for (std::size_t i = 0; i < sizeof(Unsigned); ++i) {
    value |= static_cast<Unsigned>(static_cast<Unsigned>(bytes[i]) << (8 * i));
  }
  return value;
}

template <class Unsigned>
void StoreLittle(Unsigned value, std::uint8_t* bytes) {
  for (std::size_t i = 0; i < sizeof(Unsigned); ++i) {
    bytes[i] = static_cast<std::uint8_t>(value >> (8 * i));
  }
}

inline double LoadFloat64Little(const std::uint8_t* bytes) {
  return std::bit_cast<double>(LoadLittle<std::uint64_t>(bytes));
}

inline void StoreFloat64Little(double value, std::uint8_t* bytes) {
  StoreLittle(std::bit_cast<std::uint64_t>(value), bytes);
}

}  // namespace bendloop::drivers
