// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

namespace bendloop::drivers {

// One whole request, of whatever function, header and crc included; it has a function. libmodbus
// knows the lengths of a few functions only, and a server must answer all.

// By the length in its header. nullopt: the client is gone, sent no Modbus, or half of it.
std::optional<std::vector<std::uint8_t>> ReadTcpRequest(int socket,
                                                        std::chrono::milliseconds timeout);
// One message, one request. nullopt: it is none.
std::optional<std::vector<std::uint8_t>> ReadCanRequest(int socket);
// By the lengths of the functions that are known, and else by the silence after it. nullopt: its
// crc is wrong; what came is thrown away until the line is silent.
std::optional<std::vector<std::uint8_t>> ReadRtuRequest(int line,
                                                        std::chrono::milliseconds timeout);

// The number of Modbus at `at`: high byte first.
std::uint16_t Load16(const std::vector<std::uint8_t>& bytes, std::size_t at);

// The two bytes that end a frame on a serial line, low byte first on the wire.
std::uint16_t RtuCrc(const std::uint8_t* bytes, std::size_t count);

}  // namespace bendloop::drivers
