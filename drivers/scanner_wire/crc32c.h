// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace bendloop::drivers {

// CRC-32C (Castagnoli, reflected polynomial 0x82F63B78, initial value and final XOR 0xFFFFFFFF) as
// in iSCSI (RFC 3720) and ext4; "123456789" gives 0xE3069283. Uses the CPU's instruction if there
// is one. `before` is the sum of what stood before these bytes, so that a text may come in pieces.
std::uint32_t Crc32c(std::span<const std::uint8_t> bytes, std::uint32_t before = 0);

// The same from a table, on any CPU.
std::uint32_t Crc32cPortable(std::span<const std::uint8_t> bytes, std::uint32_t before = 0);

}  // namespace bendloop::drivers
