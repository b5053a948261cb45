// SPDX-License-Identifier: Apache-2.0
#include "drivers/scanner_wire/wire_messages.h"

#include <array>
#include <cmath>
#include <string_view>

#include "drivers/scanner_wire/wire_bytes.h"

namespace bendloop::drivers {
namespace {

constexpr double kUnitTolerance = 1e-6;
constexpr double kMicrometresPerMillimetre = 1000.0;

float FromMicrometres(std::uint32_t raw) {
  return static_cast<float>(static_cast<std::int32_t>(raw) / kMicrometresPerMillimetre);
}

std::string_view AsText(std::span<const std::uint8_t> bytes) {
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

// Takes a text (its length in one byte, then the bytes) off the front.
bool TakeText(std::span<const std::uint8_t>& payload, std::string& text) {
  if (payload.empty() || payload[0] > kWireMaxText || payload.size() < 1U + payload[0]) {
    return false;
  }
  text = AsText(payload.subspan(1, payload[0]));
  payload = payload.subspan(1U + payload[0]);
  return true;
}

}  // namespace

float RoundToWire(double coordinate_mm) {
  return static_cast<float>(std::round(coordinate_mm * kMicrometresPerMillimetre) /
                            kMicrometresPerMillimetre);
}

bool DecodeProfile(std::span<const std::uint8_t> payload, hal::LaserProfile& profile) {
  if (payload.size() < kWireProfileHeadBytes) return false;
  const std::uint8_t* const head = payload.data();
  const auto count = LoadLittle<std::uint32_t>(head + 72);
  const std::uint8_t has_intensity = head[76];
  if (count > kWireMaxPoints || has_intensity > 1 ||
      payload.size() != kWireProfileHeadBytes + std::size_t{count} * (8U + has_intensity)) {
    return false;
  }
  std::array<double, 7> pose{};
  for (std::size_t i = 0; i < pose.size(); ++i) {
    pose[i] = LoadFloat64Little(head + 16 + 8 * i);
    if (!std::isfinite(pose[i])) return false;
  }
  const Eigen::Quaterniond orientation(pose[3], pose[4], pose[5], pose[6]);
  if (!(std::abs(orientation.norm() - 1.0) <= kUnitTolerance)) return false;
  profile.sequence = LoadLittle<std::uint64_t>(head);
  profile.t_ns = static_cast<std::int64_t>(LoadLittle<std::uint64_t>(head + 8));
  profile.X_WS.position_mm = {pose[0], pose[1], pose[2]};
  profile.X_WS.orientation = orientation;
  profile.points.resize(count);
  const std::uint8_t* at = head + kWireProfileHeadBytes;
  for (hal::ProfilePoint& point : profile.points) {
    point = {FromMicrometres(LoadLittle<std::uint32_t>(at)),
             FromMicrometres(LoadLittle<std::uint32_t>(at + 4))};
    at += 8;
  }
  if (has_intensity == 1) {
    profile.intensity.assign(at, at + count);
  } else {
    profile.intensity.clear();
  }
  return true;
}

bool DecodeEvent(std::span<const std::uint8_t> payload, hal::ScanEvent& event) {
  if (payload.size() < 10 || payload.size() != 10U + payload[9]) return false;
  event.t_ns = static_cast<std::int64_t>(LoadLittle<std::uint64_t>(payload.data()));
  event.kind = payload[8] < static_cast<std::uint8_t>(hal::ScanEventKind::kOther)
                   ? static_cast<hal::ScanEventKind>(payload[8])
                   : hal::ScanEventKind::kOther;
  event.set_detail(AsText(payload.subspan(10)));
  return true;
}

bool DecodeIdentity(std::span<const std::uint8_t> payload, WireIdentity& identity) {
  if (payload.size() < 4) return false;
  identity.max_points = LoadLittle<std::uint32_t>(payload.data());
  payload = payload.subspan(4);
  return identity.max_points > 0 && identity.max_points <= kWireMaxPoints &&
         TakeText(payload, identity.model) && TakeText(payload, identity.serial) &&
         TakeText(payload, identity.firmware) && TakeText(payload, identity.calibration);
}

bool DecodeSettings(std::span<const std::uint8_t> payload, WireSettings& settings) {
  if (payload.size() < 12 || payload[8] > 1) return false;
  settings.profiles_per_second_milli = LoadLittle<std::uint32_t>(payload.data());
  settings.exposure_us = LoadLittle<std::uint32_t>(payload.data() + 4);
  settings.intensity = payload[8] == 1;
  return true;
}

bool DecodeReply(std::span<const std::uint8_t> payload, WireReply& reply) {
  if (payload.size() < 6) return false;
  reply.request = static_cast<WireType>(payload[0]);
  reply.status = payload[1];
  reply.request_sequence = LoadLittle<std::uint32_t>(payload.data() + 2);
  payload = payload.subspan(6);
  return TakeText(payload, reply.text);
}

}  // namespace bendloop::drivers
