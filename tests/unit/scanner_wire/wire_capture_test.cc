// SPDX-License-Identifier: Apache-2.0
//
// What a scanner once sent over USB (tests/data/scanner_wire) still means the same.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <fstream>
#include <iterator>

#include "drivers/scanner_wire/crc32c.h"
#include "wire_fixture.h"

namespace bendloop::drivers {
namespace {

std::string ReadFile(const std::string& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

std::string InWords(const WireMessage& message) {
  const std::string number = std::to_string(message.sequence) + " ";
  hal::LaserProfile profile(kWireMaxPoints);
  hal::ScanEvent event;
  WireIdentity identity;
  WireReply reply;
  switch (message.type) {
    case WireType::kProfile:
      if (!DecodeProfile(message.payload, profile)) break;
      return number + "profile " + std::to_string(profile.sequence) + " at " +
             std::to_string(profile.t_ns) + ", " + std::to_string(profile.points.size()) +
             " points, crc " + std::to_string(Crc32c(message.payload));
    case WireType::kEvent:
      if (!DecodeEvent(message.payload, event)) break;
      return number + "event " + std::string(hal::Name(event.kind)) + " at " +
             std::to_string(event.t_ns) + " '" + std::string(event.detail()) + "'";
    case WireType::kIdentity:
      if (!DecodeIdentity(message.payload, identity)) break;
      return number + "identity " + identity.model + ", " + identity.serial + ", " +
             identity.firmware + ", " + identity.calibration + ", " +
             std::to_string(identity.max_points) + " points";
    case WireType::kReply:
      if (!DecodeReply(message.payload, reply)) break;
      return number + "reply to " + std::to_string(static_cast<int>(reply.request)) + ", status " +
             std::to_string(reply.status) + " '" + reply.text + "'";
    default:
      return number + "a host's message";
  }
  return number + "malformed, type " + std::to_string(static_cast<int>(message.type));
}

std::string InWords(const WireCounters& c) {
  char text[200];
  std::snprintf(
      text, sizeof text,
      "%d bytes, %d messages, %d + %d damaged, %d bytes skipped in %d places, %d lost, %d "
      "repeated",
      static_cast<int>(c.bytes), static_cast<int>(c.messages), static_cast<int>(c.header_errors),
      static_cast<int>(c.payload_errors), static_cast<int>(c.skipped_bytes),
      static_cast<int>(c.resyncs), static_cast<int>(c.lost_messages),
      static_cast<int>(c.repeated_sequences));
  return text;
}

TEST(WireCapture, MeansWhatItMeant) {
  const std::string folder = std::string(BENDLOOP_SOURCE_DIR) + "/tests/data/scanner_wire/";
  for (const std::string name : {"clean", "faults"}) {
    const std::string capture = ReadFile(folder + name + ".wire");
    ASSERT_FALSE(capture.empty()) << name;
    const Bytes bytes(capture.begin(), capture.end());
    for (const std::size_t transfer : {std::size_t{1}, std::size_t{512}, bytes.size()}) {
      WireDecoder decoder;
      std::string words;
      for (std::size_t at = 0; at < bytes.size(); at += transfer) {
        decoder.Feed(std::span(bytes).subspan(at, std::min(transfer, bytes.size() - at)));
        while (const auto message = decoder.Next()) words += InWords(*message) + "\n";
      }
      words += InWords(decoder.counters()) + "\n";
      EXPECT_EQ(words, ReadFile(folder + name + ".txt")) << name << ", " << transfer;
    }
  }
}

}  // namespace
}  // namespace bendloop::drivers
