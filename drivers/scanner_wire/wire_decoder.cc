// SPDX-License-Identifier: Apache-2.0
#include "drivers/scanner_wire/wire_decoder.h"

#include <algorithm>
#include <cstring>

#include "drivers/scanner_wire/crc32c.h"
#include "drivers/scanner_wire/wire_bytes.h"

namespace bendloop::drivers {
namespace {

bool IsKnown(std::uint8_t type) {
  switch (static_cast<WireType>(type)) {
    case WireType::kIdentify:
    case WireType::kSettings:
    case WireType::kStart:
    case WireType::kStop:
    case WireType::kIdentity:
    case WireType::kReply:
    case WireType::kProfile:
    case WireType::kEvent:
      return true;
  }
  return false;
}

}  // namespace

std::span<std::uint8_t> WireDecoder::Writable() {
  if (begin_ > 0 && buffer_.size() - end_ < kWireMaxMessage) {
    std::memmove(buffer_.data(), buffer_.data() + begin_, end_ - begin_);
    end_ -= begin_;
    begin_ = 0;
  }
  return {buffer_.data() + end_, buffer_.size() - end_};
}

void WireDecoder::Commit(std::size_t bytes) {
  bytes = std::min(bytes, buffer_.size() - end_);
  end_ += bytes;
  counters_.bytes += bytes;
}

std::size_t WireDecoder::Push(std::span<const std::uint8_t> bytes) {
  const std::span<std::uint8_t> room = Writable();
  const std::size_t taken = std::min(room.size(), bytes.size());
  std::copy_n(bytes.begin(), taken, room.begin());
  Commit(taken);
  return taken;
}

void WireDecoder::Skip(std::size_t bytes) {
  if (bytes == 0) return;
  if (in_sync_) ++counters_.resyncs;
  in_sync_ = false;
  counters_.skipped_bytes += bytes;
  begin_ += bytes;
}

void WireDecoder::CountSequence(std::uint32_t sequence) {
  if (expected_sequence_) {
    const std::uint32_t ahead = sequence - *expected_sequence_;  // wraps as the numbers do
    if (ahead < 0x80000000U) {
      counters_.lost_messages += ahead;
    } else {
      ++counters_.repeated_sequences;
    }
  }
  expected_sequence_ = sequence + 1;
}

std::optional<WireMessage> WireDecoder::Next() {
  while (begin_ < end_) {
    const std::uint8_t* const data = buffer_.data();
    // The first place that can be the begin of a message, perhaps cut off by the buffer's end.
    const auto* const found =
        std::search(data + begin_, data + end_, kWireMagic.begin(), kWireMagic.end());
    if (found == data + end_) {
      std::size_t keep = std::min(end_ - begin_, kWireMagic.size() - 1);
      while (!std::equal(kWireMagic.begin(), kWireMagic.begin() + static_cast<long>(keep),
                         data + end_ - keep)) {
        --keep;
      }
      Skip(end_ - begin_ - keep);
      return std::nullopt;
    }
    Skip(static_cast<std::size_t>(found - data) - begin_);
    if (end_ - begin_ < kWireHeaderBytes) return std::nullopt;

    const std::uint8_t* const header = data + begin_;
    const auto length = LoadLittle<std::uint32_t>(header + 8);
    if (LoadLittle<std::uint32_t>(header + 16) != Crc32c({header, 16}) ||
        length > kWireMaxPayload) {
      ++counters_.header_errors;
      Skip(kWireMagic.size());
      continue;
    }
    const std::size_t message_bytes = kWireHeaderBytes + length + kWireTrailerBytes;
    if (end_ - begin_ < message_bytes) return std::nullopt;
    const std::span<const std::uint8_t> payload(header + kWireHeaderBytes, length);
    if (LoadLittle<std::uint32_t>(payload.data() + length) != Crc32c(payload)) {
      // Perhaps bytes are missing in it: the next message may begin inside what seems this one.
      ++counters_.payload_errors;
      Skip(kWireMagic.size());
      continue;
    }
    in_sync_ = true;
    begin_ += message_bytes;
    const auto sequence = LoadLittle<std::uint32_t>(header + 12);
    CountSequence(sequence);
    if (header[4] != kWireVersion) {
      ++counters_.unknown_versions;
      continue;
    }
    if (!IsKnown(header[5])) {
      ++counters_.unknown_types;
      continue;
    }
    ++counters_.messages;
    return WireMessage{static_cast<WireType>(header[5]), sequence, payload};
  }
  return std::nullopt;
}

void WireDecoder::Reset() {
  begin_ = end_ = 0;
  in_sync_ = true;
  expected_sequence_.reset();
  counters_ = {};
}

}  // namespace bendloop::drivers
