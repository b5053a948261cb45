// SPDX-License-Identifier: Apache-2.0
#include "drivers/scanner_wire/wire_encoder.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <string>
#include <string_view>

#include "drivers/scanner_wire/crc32c.h"
#include "drivers/scanner_wire/wire_bytes.h"

namespace bendloop::drivers {
namespace {

using hal::ErrorKind;
using hal::Fail;

void PutText(std::string_view text, std::vector<std::uint8_t>& out) {
  text = text.substr(0, kWireMaxText);
  out.push_back(static_cast<std::uint8_t>(text.size()));
  out.insert(out.end(), text.begin(), text.end());
}

template <class Unsigned>
void Put(Unsigned value, std::vector<std::uint8_t>& out) {
  out.resize(out.size() + sizeof(value));
  StoreLittle(value, out.data() + out.size() - sizeof(value));
}

bool FitsMicrometres(float coordinate_mm) {
  return std::abs(coordinate_mm) * 1000.0 <= double{std::numeric_limits<std::int32_t>::max()};
}

std::uint32_t ToMicrometres(float coordinate_mm) {
  return static_cast<std::uint32_t>(static_cast<std::int32_t>(std::lround(coordinate_mm * 1000.0)));
}

}  // namespace

void WireEncoder::Append(WireType type, std::span<const std::uint8_t> payload,
                         std::vector<std::uint8_t>& out) {
  const std::size_t begin = out.size();
  out.resize(begin + kWireHeaderBytes + payload.size() + kWireTrailerBytes);
  std::uint8_t* const header = out.data() + begin;
  std::copy(kWireMagic.begin(), kWireMagic.end(), header);
  header[4] = kWireVersion;
  header[5] = static_cast<std::uint8_t>(type);
  header[6] = 0;
  header[7] = 0;
  StoreLittle(static_cast<std::uint32_t>(payload.size()), header + 8);
  StoreLittle(sequence_++, header + 12);
  StoreLittle(Crc32c({header, 16}), header + 16);
  std::copy(payload.begin(), payload.end(), header + kWireHeaderBytes);
  StoreLittle(Crc32c(payload), header + kWireHeaderBytes + payload.size());
}

hal::Result<void> WireEncoder::Append(const hal::LaserProfile& profile,
                                      std::vector<std::uint8_t>& out) {
  const auto fail = [&](const std::string& why) {
    return Fail(ErrorKind::kBadInput, "profile " + std::to_string(profile.sequence) + ": " + why);
  };
  const std::size_t count = profile.points.size();
  if (count > kWireMaxPoints) {
    return fail(std::to_string(count) + " points; the wire carries at most " +
                std::to_string(kWireMaxPoints));
  }
  if (!profile.intensity.empty() && profile.intensity.size() != count) {
    return fail(std::to_string(profile.intensity.size()) + " intensities for " +
                std::to_string(count) + " points; expected one a point or none");
  }
  payload_.resize(kWireProfileHeadBytes + 8 * count);
  std::uint8_t* const head = payload_.data();
  StoreLittle(profile.sequence, head);
  StoreLittle(static_cast<std::uint64_t>(profile.t_ns), head + 8);
  const auto& X_WS = profile.X_WS;
  const std::array<double, 7> pose = {
      X_WS.position_mm.x(), X_WS.position_mm.y(), X_WS.position_mm.z(), X_WS.orientation.w(),
      X_WS.orientation.x(), X_WS.orientation.y(), X_WS.orientation.z()};
  for (std::size_t i = 0; i < pose.size(); ++i) StoreFloat64Little(pose[i], head + 16 + 8 * i);
  StoreLittle(static_cast<std::uint32_t>(count), head + 72);
  StoreLittle(std::uint32_t{profile.intensity.empty() ? 0U : 1U}, head + 76);
  std::uint8_t* at = head + kWireProfileHeadBytes;
  for (std::size_t i = 0; i < count; ++i, at += 8) {
    const hal::ProfilePoint& point = profile.points[i];
    if (!FitsMicrometres(point.x_mm) || !FitsMicrometres(point.z_mm)) {
      return fail("point " + std::to_string(i) + " does not fit 32 bits of micrometres");
    }
    StoreLittle(ToMicrometres(point.x_mm), at);
    StoreLittle(ToMicrometres(point.z_mm), at + 4);
  }
  payload_.insert(payload_.end(), profile.intensity.begin(), profile.intensity.end());
  Append(WireType::kProfile, payload_, out);
  return {};
}

void WireEncoder::Append(const hal::ScanEvent& event, std::vector<std::uint8_t>& out) {
  payload_.clear();
  Put(static_cast<std::uint64_t>(event.t_ns), payload_);
  Put(event.kind == hal::ScanEventKind::kOther ? std::uint8_t{0xFF}
                                               : static_cast<std::uint8_t>(event.kind),
      payload_);
  PutText(event.detail(), payload_);
  Append(WireType::kEvent, payload_, out);
}

void WireEncoder::Append(const WireIdentity& identity, std::vector<std::uint8_t>& out) {
  payload_.clear();
  Put(identity.max_points, payload_);
  PutText(identity.model, payload_);
  PutText(identity.serial, payload_);
  PutText(identity.firmware, payload_);
  PutText(identity.calibration, payload_);
  Append(WireType::kIdentity, payload_, out);
}

void WireEncoder::Append(const WireSettings& settings, std::vector<std::uint8_t>& out) {
  payload_.clear();
  Put(settings.profiles_per_second_milli, payload_);
  Put(settings.exposure_us, payload_);
  Put(std::uint32_t{settings.intensity ? 1U : 0U}, payload_);
  Append(WireType::kSettings, payload_, out);
}

void WireEncoder::Append(const WireReply& reply, std::vector<std::uint8_t>& out) {
  payload_.clear();
  Put(static_cast<std::uint8_t>(reply.request), payload_);
  Put(reply.status, payload_);
  Put(reply.request_sequence, payload_);
  PutText(reply.text, payload_);
  Append(WireType::kReply, payload_, out);
}

}  // namespace bendloop::drivers
