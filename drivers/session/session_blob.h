// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>

// Little-endian numbers in blobs, whatever this machine is.
namespace bendloop::drivers {

template <class Unsigned>
Unsigned LittleEndian(Unsigned value) {
  if constexpr (std::endian::native == std::endian::little) {
    return value;
  } else {
    Unsigned swapped = 0;
    for (std::size_t i = 0; i < sizeof(value); ++i) {
      swapped = static_cast<Unsigned>(swapped << 8U) | ((value >> (8 * i)) & 0xffU);
    }
    return swapped;
  }
}

inline double LoadFloat64(const unsigned char* bytes) {
  std::uint64_t raw = 0;
  std::memcpy(&raw, bytes, sizeof(raw));
  return std::bit_cast<double>(LittleEndian(raw));
}

inline float LoadFloat32(const unsigned char* bytes) {
  std::uint32_t raw = 0;
  std::memcpy(&raw, bytes, sizeof(raw));
  return std::bit_cast<float>(LittleEndian(raw));
}

inline void StoreFloat64(double value, unsigned char* bytes) {
  const auto raw = LittleEndian(std::bit_cast<std::uint64_t>(value));
  std::memcpy(bytes, &raw, sizeof(raw));
}

inline void StoreFloat32(float value, unsigned char* bytes) {
  const auto raw = LittleEndian(std::bit_cast<std::uint32_t>(value));
  std::memcpy(bytes, &raw, sizeof(raw));
}

}  // namespace bendloop::drivers
