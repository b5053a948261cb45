// SPDX-License-Identifier: Apache-2.0
// Links: bendloop_drivers_scanner_wire
// Seeds: tests/data/scanner_wire
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "drivers/scanner_wire/wire_decoder.h"
#include "drivers/scanner_wire/wire_encoder.h"
#include "tests/fuzz/reached.h"

// Any bytes from a scanner, in chunks that the first byte chooses: no crash, the same messages and
// counters as in one piece and as when read in place, and every value that decodes can be encoded
// again. A first byte of 255: the rest is the payload of one message, which no checksum that
// an altered byte makes wrong then keeps from its decoders.
namespace {

using namespace bendloop;
using namespace bendloop::drivers;

Reached reached_profile("a profile");
Reached reached_event("an event");
Reached reached_identity("an identity");
Reached reached_settings("settings");
Reached reached_reply("a reply");
Reached reached_garbage("bytes that were skipped");

struct Outcome {
  std::vector<std::uint8_t> types;
  WireCounters counters;
  bool operator==(const Outcome&) const = default;
};

void Decode(std::span<const std::uint8_t> payload) {
  static hal::LaserProfile profile(kWireMaxPoints);
  WireEncoder encoder;
  std::vector<std::uint8_t> out;
  if (DecodeProfile(payload, profile)) {
    reached_profile.Mark();
    if (profile.points.size() > kWireMaxPoints || !encoder.Append(profile, out)) __builtin_trap();
  }
  hal::ScanEvent event;
  if (DecodeEvent(payload, event)) {
    reached_event.Mark();
    encoder.Append(event, out);
  }
  WireIdentity identity;
  if (DecodeIdentity(payload, identity)) {
    reached_identity.Mark();
    encoder.Append(identity, out);
  }
  WireSettings settings;
  if (DecodeSettings(payload, settings)) {
    reached_settings.Mark();
    encoder.Append(settings, out);
  }
  WireReply reply;
  if (DecodeReply(payload, reply)) {
    reached_reply.Mark();
    encoder.Append(reply, out);
  }
}

// A decoder is a third of a megabyte: made once, as a new one for each input takes most of the
// time.
WireDecoder& Fresh() {
  static WireDecoder decoder;
  decoder.Reset();
  return decoder;
}

Outcome Run(std::span<const std::uint8_t> bytes, std::size_t chunk) {
  WireDecoder& decoder = Fresh();
  Outcome outcome;
  while (!bytes.empty()) {
    bytes = bytes.subspan(decoder.Push(bytes.first(std::min(chunk, bytes.size()))));
    while (const auto message = decoder.Next()) {
      outcome.types.push_back(static_cast<std::uint8_t>(message->type));
      Decode(message->payload);
    }
  }
  outcome.counters = decoder.counters();
  return outcome;
}

// Read where they are, as from a USB transfer.
Outcome RunInPlace(std::span<const std::uint8_t> bytes, std::size_t chunk) {
  WireDecoder& decoder = Fresh();
  Outcome outcome;
  while (!bytes.empty()) {
    // A copy of its own, so that the sanitizer sees what is read too late or beyond.
    const auto size = static_cast<std::ptrdiff_t>(std::min(chunk, bytes.size()));
    const std::vector<std::uint8_t> transfer(bytes.begin(), bytes.begin() + size);
    bytes = bytes.subspan(transfer.size());
    decoder.Feed(transfer);
    while (const auto message = decoder.Next()) {
      outcome.types.push_back(static_cast<std::uint8_t>(message->type));
      Decode(message->payload);
    }
  }
  outcome.counters = decoder.counters();
  return outcome;
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  const std::span<const std::uint8_t> bytes(data + 1, size - 1);
  if (data[0] == 0xFF) {
    Decode(bytes);
    return 0;
  }
  const Outcome whole = Run(bytes, 1U << 20U);
  if (whole.counters.skipped_bytes > 0) reached_garbage.Mark();
  if (!(Run(bytes, 1U + data[0]) == whole)) __builtin_trap();
  if (!(RunInPlace(bytes, 1U + data[0]) == whole)) __builtin_trap();
  return 0;
}
