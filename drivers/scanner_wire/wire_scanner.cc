// SPDX-License-Identifier: Apache-2.0
#include "drivers/scanner_wire/wire_scanner.h"

#include <algorithm>
#include <array>
#include <cstdio>
#include <utility>

#include "drivers/scanner_wire/wire_bytes.h"
#include "hal/clock.h"

namespace bendloop::drivers {
namespace {

using hal::ErrorKind;
using hal::Fail;
using hal::ReadStatus;
using hal::Result;
using std::chrono::nanoseconds;

constexpr std::size_t kRequestBytes = 128;

nanoseconds Now() { return hal::SteadyClock().Now(); }

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

WireScanner::WireScanner(std::unique_ptr<ByteCarrier> carrier, WireScannerOptions options)
    : options_(std::move(options)), carrier_(std::move(carrier)) {
  request_.reserve(kRequestBytes);
  // Numbers that no host before us has used: a late reply to it is not taken for ours.
  encoder_.Skip(static_cast<std::uint32_t>(Now().count() / 1000));
}

WireScannerCounters WireScanner::counters() const {
  WireScannerCounters counters = counters_;
  counters.wire = decoder_.counters();
  return counters;
}

std::string WireScanner::Remarks() const {
  const WireScannerCounters seen = counters();
  std::string words = carrier_->Remarks();
  const auto say = [&words](std::uint64_t count, const char* what) {
    if (count == 0) return;
    if (!words.empty()) words += ", ";
    words += std::to_string(count) + " " + what;
  };
  say(seen.lost_profiles, "profiles lost");
  say(seen.repeated_profiles, "profiles repeated");
  say(seen.bad_messages, "malformed messages");
  say(seen.wire.header_errors + seen.wire.payload_errors, "messages damaged");
  say(seen.wire.skipped_bytes, "bytes skipped");
  say(seen.wire.unknown_types + seen.wire.unknown_versions, "messages unknown");
  return words;
}

hal::Error WireScanner::Failure(const std::string& what) const {
  return {ErrorKind::kDevice, carrier_->name() + ": " + what};
}

tl::unexpected<hal::Error> WireScanner::FailForGood(hal::Error error) {
  failed_ = error;
  carrier_->Close();
  started_ = false;
  after_gap_.reset();
  return Fail(std::move(error));
}

void WireScanner::CountStale(const WireMessage& message) {
  const bool is_stale = message.type == WireType::kProfile || message.type == WireType::kEvent;
  counters_.stale_messages += is_stale ? 1 : 0;
}

Result<WireIdentity> WireScanner::Identify() {
  const nanoseconds deadline = Now() + options_.answer_timeout;
  request_.clear();
  encoder_.Append(WireType::kIdentify, {}, request_);
  if (auto sent = carrier_->Send(request_, options_.answer_timeout); !sent) {
    return Fail(sent.error());
  }
  while (true) {
    while (const auto message = decoder_.Next()) {
      CountStale(*message);
      if (message->type != WireType::kIdentity) continue;
      WireIdentity identity;
      if (DecodeIdentity(message->payload, identity)) return identity;
      return Fail(Failure("its identity is malformed (" + std::to_string(message->payload.size()) +
                          " bytes, expected 1 to " + std::to_string(kWireMaxPoints) +
                          " points and four texts)"));
    }
    const nanoseconds left = deadline - Now();
    if (left <= nanoseconds(0)) {
      const WireCounters& seen = decoder_.counters();
      return Fail(Failure("no identity in time (" + std::to_string(seen.bytes) + " bytes came, " +
                          std::to_string(seen.unknown_versions) +
                          " messages of another version); is this a scanner, protocol version " +
                          std::to_string(kWireVersion) + "?"));
    }
    if (auto more = carrier_->Receive(decoder_, left); !more) return Fail(more.error());
  }
}

Result<hal::SourceInfo> WireScanner::Open() {
  failed_.reset();
  started_ = false;
  last_sequence_.reset();
  after_gap_.reset();
  counters_ = {};
  decoder_.Reset();
  if (auto opened = carrier_->Open(); !opened) return FailForGood(opened.error());
  auto identity = Identify();
  if (!identity) return FailForGood(identity.error());
  identity_ = std::move(*identity);
  hal::SourceInfo info;
  info.model = identity_.model;
  info.serial = identity_.serial;
  info.firmware = identity_.firmware;
  info.is_live = true;
  info.max_points = identity_.max_points;
  return info;
}

Result<void> WireScanner::AwaitStart(std::uint32_t settings_sequence,
                                     std::uint32_t start_sequence) {
  const nanoseconds deadline = Now() + options_.answer_timeout;
  while (true) {
    // What was on its way before the reply belongs to an earlier start.
    while (const auto message = decoder_.Next()) {
      CountStale(*message);
      if (message->type != WireType::kReply) continue;
      WireReply reply;
      if (!DecodeReply(message->payload, reply)) {
        ++counters_.bad_messages;
        continue;
      }
      const bool settings = options_.settings && reply.request == WireType::kSettings &&
                            reply.request_sequence == settings_sequence;
      const bool start =
          reply.request == WireType::kStart && reply.request_sequence == start_sequence;
      if ((settings || start) && reply.status != 0) {
        return Fail(Failure(std::string("refused ") + (settings ? "the settings" : "to start") +
                            " (status " + std::to_string(reply.status) + "): " + reply.text));
      }
      if (start) return {};
    }
    const nanoseconds left = deadline - Now();
    if (left <= nanoseconds(0)) return Fail(Failure("does not answer when asked to start"));
    if (auto more = carrier_->Receive(decoder_, left); !more) return Fail(more.error());
  }
}

Result<void> WireScanner::Start() {
  if (failed_) return Fail(*failed_);
  if (!carrier_->is_open()) {
    return Fail(ErrorKind::kInternal, carrier_->name() + ": start before open");
  }
  request_.clear();
  const std::uint32_t settings_sequence = encoder_.sequence();
  if (options_.settings) encoder_.Append(*options_.settings, request_);
  const std::uint32_t start_sequence = encoder_.sequence();
  encoder_.Append(WireType::kStart, {}, request_);
  if (auto sent = carrier_->Send(request_, options_.answer_timeout); !sent) {
    return FailForGood(sent.error());
  }
  after_gap_.reset();
  if (auto started = AwaitStart(settings_sequence, start_sequence); !started) {
    return FailForGood(started.error());
  }
  last_sequence_.reset();
  heard_at_ = Now();
  asked_at_.reset();
  started_ = true;
  return {};
}

std::optional<ReadStatus> WireScanner::TakeProfile(const WireMessage& message,
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
    after_gap_ = message;  // its bytes stay until the decoder is called again
    return ReadStatus::kEvent;
  }
  last_sequence_ = sequence;
  return ReadStatus::kProfile;
}

std::optional<ReadStatus> WireScanner::Take(const WireMessage& message, hal::LaserProfile& profile,
                                            hal::ScanEvent& event) {
  if (message.type == WireType::kProfile) return TakeProfile(message, profile, event);
  if (message.type != WireType::kEvent) return std::nullopt;
  if (!DecodeEvent(message.payload, event)) {
    ++counters_.bad_messages;
    return std::nullopt;
  }
  // A new scan may count from 0 again.
  if (event.kind == hal::ScanEventKind::kScanStart) last_sequence_.reset();
  return ReadStatus::kEvent;
}

Result<void> WireScanner::WatchSilence(nanoseconds now, bool heard) {
  if (heard) {
    heard_at_ = now;
    asked_at_.reset();
    return {};
  }
  if (options_.patience <= nanoseconds(0)) return {};
  if (!asked_at_) {
    if (now - heard_at_ < options_.patience) return {};
    asked_at_ = now;
    request_.clear();
    encoder_.Append(WireType::kIdentify, {}, request_);
    return carrier_->Send(request_, nanoseconds(0));
  }
  if (now - *asked_at_ < options_.patience) return {};
  const auto seconds = std::chrono::duration_cast<std::chrono::seconds>(now - heard_at_).count();
  return Fail(Failure("has said nothing for " + std::to_string(seconds) +
                      " s, not even when asked who it is; switch it off and on"));
}

Result<ReadStatus> WireScanner::Read(hal::LaserProfile& profile, hal::ScanEvent& event,
                                     nanoseconds timeout) {
  if (failed_) return Fail(*failed_);
  if (!started_) return Fail(ErrorKind::kInternal, carrier_->name() + ": read before start");
  const nanoseconds deadline = Now() + timeout;
  while (true) {
    while (const auto message = after_gap_ ? after_gap_ : decoder_.Next()) {
      if (const auto status = Take(*message, profile, event)) return *status;
    }
    const nanoseconds left = deadline - Now();
    const auto more = carrier_->Receive(decoder_, std::max(left, nanoseconds(0)));
    if (!more) return FailForGood(more.error());
    if (auto alive = WatchSilence(Now(), *more); !alive) return FailForGood(alive.error());
    // Even while garbage keeps coming the caller gets its turn.
    if (!*more || left <= nanoseconds(0)) return ReadStatus::kTimeout;
  }
}

void WireScanner::Stop() {
  if (!started_ || !carrier_->is_open()) return;
  request_.clear();
  encoder_.Append(WireType::kStop, {}, request_);
  (void)carrier_->Send(request_, std::chrono::milliseconds(100));
  started_ = false;
}

}  // namespace bendloop::drivers
