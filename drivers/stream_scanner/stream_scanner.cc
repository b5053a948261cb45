// SPDX-License-Identifier: Apache-2.0
#include "drivers/stream_scanner/stream_scanner.h"

#include <algorithm>
#include <array>
#include <cstdio>

#include "drivers/scanner_wire/wire_bytes.h"
#include "hal/clock.h"

namespace bendloop::drivers {
namespace {

using hal::ErrorKind;
using hal::Fail;
using hal::ReadStatus;
using hal::Result;
using std::chrono::nanoseconds;

// Without allocating.
void FillGap(std::uint64_t expected, std::uint64_t found, std::int64_t t_ns,
             hal::ScanEvent& event) {
  std::array<char, 100> text{};
  const int size = std::snprintf(
      text.data(), text.size(), "%llu profiles lost, sequence %llu to %llu",
      static_cast<unsigned long long>(found - expected), static_cast<unsigned long long>(expected),
      static_cast<unsigned long long>(found - 1));
  event.kind = hal::ScanEventKind::kGap;
  event.t_ns = t_ns;
  event.set_detail({text.data(), static_cast<std::size_t>(std::max(size, 0))});
}

}  // namespace

StreamScannerCounters StreamScanner::counters() const {
  StreamScannerCounters counters = counters_;
  counters.wire = decoder_.counters();
  return counters;
}

hal::Error StreamScanner::FailForGood(hal::Error error) {
  failed_ = error;
  connection_.Close();
  started_ = false;
  after_gap_.reset();
  return error;
}

Result<bool> StreamScanner::ReceiveMore(nanoseconds timeout) {
  const auto received = connection_.Receive(decoder_.Writable(), timeout);
  if (!received) return Fail(received.error());
  decoder_.Commit(*received);
  return *received > 0;
}

Result<WireIdentity> StreamScanner::Identify() {
  const hal::SteadyClock clock;
  const nanoseconds deadline = clock.Now() + options_.connect_timeout;
  std::vector<std::uint8_t> request;
  encoder_.Append(WireType::kIdentify, {}, request);
  if (auto sent = connection_.Send(request, options_.connect_timeout); !sent) {
    return Fail(sent.error());
  }
  while (true) {
    while (const auto message = decoder_.Next()) {
      if (message->type != WireType::kIdentity) continue;
      WireIdentity identity;
      if (DecodeIdentity(message->payload, identity)) return identity;
      return Fail(ErrorKind::kDevice,
                  "scanner at " + connection_.peer() + ": its identity is malformed (" +
                      std::to_string(message->payload.size()) + " bytes, expected 1 to " +
                      std::to_string(kWireMaxPoints) + " points and four texts)");
    }
    const nanoseconds left = deadline - clock.Now();
    if (left <= nanoseconds(0)) {
      const WireCounters& seen = decoder_.counters();
      return Fail(ErrorKind::kDevice,
                  "scanner at " + connection_.peer() + ": no identity in time (" +
                      std::to_string(seen.bytes) + " bytes came, " +
                      std::to_string(seen.unknown_versions) +
                      " messages of another version); is this a scanner's port, protocol version " +
                      std::to_string(kWireVersion) + "?");
    }
    if (auto more = ReceiveMore(left); !more) return Fail(more.error());
  }
}

Result<hal::SourceInfo> StreamScanner::Open() {
  failed_.reset();
  started_ = false;
  last_sequence_.reset();
  after_gap_.reset();
  counters_ = {};
  decoder_.Reset();
  encoder_ = {};
  connection_.Close();  // a scanner serves one host at a time
  auto connection = TcpConnection::Connect(options_.host, options_.port, options_.connect_timeout);
  if (!connection) return Fail(FailForGood(connection.error()));
  connection_ = std::move(*connection);
  auto identity = Identify();
  if (!identity) return Fail(FailForGood(identity.error()));
  identity_ = std::move(*identity);
  hal::SourceInfo info;
  info.model = identity_.model;
  info.serial = identity_.serial;
  info.firmware = identity_.firmware;
  info.is_live = true;
  info.max_points = identity_.max_points;
  return info;
}

Result<void> StreamScanner::Start() {
  if (failed_) return Fail(*failed_);
  if (!connection_.is_open()) {
    return Fail(ErrorKind::kInternal, "scanner at " + options_.host + ": start before open");
  }
  std::vector<std::uint8_t> request;
  if (options_.settings) encoder_.Append(*options_.settings, request);
  encoder_.Append(WireType::kStart, {}, request);
  if (auto sent = connection_.Send(request, options_.connect_timeout); !sent) {
    return Fail(FailForGood(sent.error()));
  }
  started_ = true;
  return {};
}

std::optional<ReadStatus> StreamScanner::TakeProfile(const WireMessage& message,
                                                     hal::LaserProfile& profile,
                                                     hal::ScanEvent& event) {
  if (message.payload.size() < kWireProfileHeadBytes ||
      LoadLittle<std::uint32_t>(message.payload.data() + 72) > identity_.max_points) {
    ++counters_.bad_messages;
    return std::nullopt;
  }
  const auto sequence = LoadLittle<std::uint64_t>(message.payload.data());
  const bool is_announced = after_gap_.has_value();
  after_gap_.reset();
  if (last_sequence_ && sequence <= *last_sequence_) {
    ++counters_.repeated_profiles;
    return std::nullopt;
  }
  if (!DecodeProfile(message.payload, profile)) {
    ++counters_.bad_messages;
    return std::nullopt;
  }
  if (last_sequence_ && sequence - *last_sequence_ > 1 && !is_announced) {
    counters_.lost_profiles += sequence - *last_sequence_ - 1;
    FillGap(*last_sequence_ + 1, sequence, profile.t_ns, event);
    after_gap_ = message;  // its bytes stay until more are received
    return ReadStatus::kEvent;
  }
  last_sequence_ = sequence;
  return ReadStatus::kProfile;
}

Result<ReadStatus> StreamScanner::Read(hal::LaserProfile& profile, hal::ScanEvent& event,
                                       nanoseconds timeout) {
  if (failed_) return Fail(*failed_);
  if (!started_) {
    return Fail(ErrorKind::kInternal, "scanner at " + options_.host + ": read before start");
  }
  const hal::SteadyClock clock;
  const nanoseconds deadline = clock.Now() + timeout;
  while (true) {
    while (const auto message = after_gap_ ? after_gap_ : decoder_.Next()) {
      if (message->type == WireType::kProfile) {
        if (const auto status = TakeProfile(*message, profile, event)) return *status;
      } else if (message->type == WireType::kEvent) {
        if (!DecodeEvent(message->payload, event)) {
          ++counters_.bad_messages;
          continue;
        }
        // A new scan may count from 0 again.
        if (event.kind == hal::ScanEventKind::kScanStart) last_sequence_.reset();
        return ReadStatus::kEvent;
      } else if (message->type == WireType::kReply) {
        WireReply reply;
        if (!DecodeReply(message->payload, reply)) {
          ++counters_.bad_messages;
        } else if (reply.status != 0) {
          return Fail(FailForGood(
              {ErrorKind::kDevice,
               "scanner at " + connection_.peer() + ": refused " +
                   (reply.request == WireType::kSettings ? "the settings" : "to start") +
                   " (status " + std::to_string(reply.status) + "): " + reply.text}));
        }
      }
    }
    const nanoseconds left = deadline - clock.Now();
    const auto more = ReceiveMore(std::max(left, nanoseconds(0)));
    if (!more) return Fail(FailForGood(more.error()));
    // Even while garbage keeps coming the caller gets its turn.
    if (!*more || (left <= nanoseconds(0))) return ReadStatus::kTimeout;
  }
}

void StreamScanner::Stop() {
  if (!started_ || !connection_.is_open()) return;
  std::vector<std::uint8_t> request;
  encoder_.Append(WireType::kStop, {}, request);
  (void)connection_.Send(request, std::chrono::milliseconds(100));
  started_ = false;
}

}  // namespace bendloop::drivers
