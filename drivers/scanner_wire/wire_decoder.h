// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "drivers/scanner_wire/wire_format.h"

namespace bendloop::drivers {

// One message that passed its checks. `payload` points into the decoder or into the bytes that it
// was fed with, and is valid until the next call of the decoder.
struct WireMessage {
  WireType type = WireType::kIdentify;
  std::uint32_t sequence = 0;
  std::span<const std::uint8_t> payload;
};

// What went by since the decoder was made.
struct WireCounters {
  std::uint64_t bytes = 0;
  std::uint64_t messages = 0;            // delivered
  std::uint64_t header_errors = 0;       // magic with a wrong header CRC or an impossible length
  std::uint64_t payload_errors = 0;      // wrong payload CRC
  std::uint64_t resyncs = 0;             // times that bytes had to be skipped
  std::uint64_t skipped_bytes = 0;       // in all of them
  std::uint64_t unknown_types = 0;       // whole messages skipped
  std::uint64_t unknown_versions = 0;    // whole messages skipped
  std::uint64_t lost_messages = 0;       // by their sequence numbers
  std::uint64_t repeated_sequences = 0;  // sequence numbers that went back

  bool operator==(const WireCounters&) const = default;
};

// Cuts a stream of bytes into messages. Any chunking gives the same messages; after garbage or
// damage it goes on with the next whole message. Has one buffer of fixed size, allocates nothing
// after its construction.
class WireDecoder {
 public:
  WireDecoder() : buffer_(2 * kWireMaxMessage) {}

  // Where the next bytes can be received to, at least kWireMaxMessage of room once Next() has
  // returned nothing; then say with Commit() how many came. Ends the life of the last message.
  std::span<std::uint8_t> Writable();
  void Commit(std::size_t bytes);
  // Copies as much as there is room for and says how much that was.
  std::size_t Push(std::span<const std::uint8_t> bytes);
  // Reads `bytes` where they are, once Next() has returned nothing; they must stay until it does so
  // again. Only what lies across the ends of two feeds is copied.
  void Feed(std::span<const std::uint8_t> bytes);

  // The next message, or nothing if more bytes are needed.
  std::optional<WireMessage> Next();

  const WireCounters& counters() const { return counters_; }
  // Forgets what is buffered, counters too; for a new connection.
  void Reset();

 private:
  // The next message at the front of `bytes`, which is moved on past it and past all that is none.
  // Nothing: `bytes` is empty or the begin of a message of which `missing_` bytes are not there.
  std::optional<WireMessage> Cut(std::span<const std::uint8_t>& bytes);
  void Skip(std::size_t count, std::span<const std::uint8_t>& bytes);
  void Append(std::span<const std::uint8_t> bytes);
  void CountSequence(std::uint32_t sequence);

  std::span<const std::uint8_t> fed_;
  std::size_t missing_ = 0;
  std::vector<std::uint8_t> buffer_;
  std::size_t begin_ = 0;
  std::size_t end_ = 0;
  bool in_sync_ = true;
  std::optional<std::uint32_t> expected_sequence_;
  WireCounters counters_;
};

}  // namespace bendloop::drivers
