// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstring>
#include <random>
#include <string>
#include <vector>

#include "drivers/scanner_wire/wire_decoder.h"
#include "drivers/scanner_wire/wire_encoder.h"

namespace bendloop::drivers {

using Bytes = std::vector<std::uint8_t>;

inline hal::LaserProfile WireProfile(std::mt19937_64& engine, std::uint64_t sequence,
                                     std::size_t points) {
  std::uniform_real_distribution<double> number(-500, 500);
  hal::LaserProfile profile(points);
  profile.sequence = sequence;
  profile.t_ns = static_cast<std::int64_t>(engine() >> 2U);
  profile.X_WS.position_mm = {number(engine), number(engine), number(engine)};
  profile.X_WS.orientation =
      Eigen::Quaterniond(number(engine), number(engine), number(engine), number(engine))
          .normalized();
  for (std::size_t i = 0; i < points; ++i) {
    profile.points.push_back({RoundToWire(number(engine)), RoundToWire(number(engine))});
    if (sequence % 2 == 0) profile.intensity.push_back(static_cast<std::uint8_t>(engine()));
  }
  return profile;
}

inline bool SameBits(const hal::LaserProfile& a, const hal::LaserProfile& b) {
  return a.sequence == b.sequence && a.t_ns == b.t_ns && a.intensity == b.intensity &&
         a.X_WS.position_mm == b.X_WS.position_mm &&
         a.X_WS.orientation.coeffs() == b.X_WS.orientation.coeffs() &&
         a.points.size() == b.points.size() &&
         (a.points.empty() ||
          std::memcmp(a.points.data(), b.points.data(), a.points.size() * 8) == 0);
}

// Type, sequence and payload, in one comparable piece.
inline std::string Describe(const WireMessage& message) {
  return std::to_string(static_cast<int>(message.type)) + " " + std::to_string(message.sequence) +
         " " + std::string(message.payload.begin(), message.payload.end());
}

inline std::vector<std::string> Drain(WireDecoder& decoder) {
  std::vector<std::string> messages;
  while (const auto message = decoder.Next()) messages.push_back(Describe(*message));
  return messages;
}

inline std::vector<std::string> Decode(const Bytes& bytes, WireDecoder& decoder) {
  std::vector<std::string> messages;
  std::size_t at = 0;
  while (at < bytes.size()) {
    at += decoder.Push(std::span(bytes).subspan(at));
    for (auto& message : Drain(decoder)) messages.push_back(std::move(message));
  }
  return messages;
}

}  // namespace bendloop::drivers
