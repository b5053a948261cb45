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

void WireDecoder::Feed(std::span<const std::uint8_t> bytes) {
  fed_ = bytes;
  counters_.bytes += bytes.size();
}

void WireDecoder::Append(std::span<const std::uint8_t> bytes) {
  const std::span<std::uint8_t> room = Writable();
  std::copy(bytes.begin(), bytes.end(), room.begin());
  end_ += bytes.size();
}

void WireDecoder::Skip(std::size_t count, std::span<const std::uint8_t>& bytes) {
  if (count == 0) return;
  if (in_sync_) ++counters_.resyncs;
  in_sync_ = false;
  counters_.skipped_bytes += count;
  bytes = bytes.subspan(count);
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

std::optional<WireMessage> WireDecoder::Cut(std::span<const std::uint8_t>& bytes) {
  while (!bytes.empty()) {
    // The first place that can be the begin of a message, perhaps cut off by the end.
    const auto found =
        std::search(bytes.begin(), bytes.end(), kWireMagic.begin(), kWireMagic.end());
    if (found == bytes.end()) {
      std::size_t keep = std::min(bytes.size(), kWireMagic.size() - 1);
      while (!std::equal(kWireMagic.begin(), kWireMagic.begin() + static_cast<long>(keep),
                         bytes.end() - static_cast<long>(keep))) {
        --keep;
      }
      Skip(bytes.size() - keep, bytes);
      missing_ = kWireHeaderBytes - keep;
      return std::nullopt;
    }
    Skip(static_cast<std::size_t>(found - bytes.begin()), bytes);
    if (bytes.size() < kWireHeaderBytes) {
      missing_ = kWireHeaderBytes - bytes.size();
      return std::nullopt;
    }

    const std::uint8_t* const header = bytes.data();
    const auto length = LoadLittle<std::uint32_t>(header + 8);
    if (LoadLittle<std::uint32_t>(header + 16) != Crc32c({header, 16}) ||
        length > kWireMaxPayload) {
      ++counters_.header_errors;
      Skip(kWireMagic.size(), bytes);
      continue;
    }
    const std::size_t message_bytes = kWireHeaderBytes + length + kWireTrailerBytes;
    if (bytes.size() < message_bytes) {
      missing_ = message_bytes - bytes.size();
      return std::nullopt;
    }
    const std::span<const std::uint8_t> payload(header + kWireHeaderBytes, length);
    if (LoadLittle<std::uint32_t>(payload.data() + length) != Crc32c(payload)) {
      // Perhaps bytes are missing in it: the next message may begin inside what seems this one.
      ++counters_.payload_errors;
      Skip(kWireMagic.size(), bytes);
      continue;
    }
    in_sync_ = true;
    bytes = bytes.subspan(message_bytes);
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

std::optional<WireMessage> WireDecoder::Next() {
  // What lies across two feeds: first the rest of the header, then that of the message.
  while (begin_ < end_) {
    std::span<const std::uint8_t> kept(buffer_.data() + begin_, end_ - begin_);
    const auto message = Cut(kept);
    begin_ = end_ - kept.size();
    if (message) return message;
    if (kept.empty()) break;
    if (fed_.empty()) return std::nullopt;
    const auto wanted = fed_.first(std::min(missing_, fed_.size()));
    fed_ = fed_.subspan(wanted.size());
    Append(wanted);
  }
  if (fed_.empty()) return std::nullopt;
  begin_ = end_ = 0;
  const auto message = Cut(fed_);
  if (!message) {
    Append(fed_);
    fed_ = {};
  }
  return message;
}

void WireDecoder::Reset() {
  begin_ = end_ = 0;
  fed_ = {};
  in_sync_ = true;
  expected_sequence_.reset();
  counters_ = {};
}

}  // namespace bendloop::drivers
