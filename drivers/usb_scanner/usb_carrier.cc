// SPDX-License-Identifier: Apache-2.0
#include "drivers/usb_scanner/usb_carrier.h"

#include <algorithm>
#include <cstdio>
#include <utility>

#include "hal/clock.h"

namespace bendloop::drivers {
namespace {

using hal::ErrorKind;
using hal::Fail;
using hal::Result;
using std::chrono::nanoseconds;

// A device that fails so often without any data in between has failed. A cable that was pulled
// shows as errors until the kernel has noticed, which the pauses leave it time for.
constexpr std::uint32_t kMostInARow = 16;
constexpr std::chrono::milliseconds kPause{50};
constexpr std::chrono::milliseconds kPumpTurn{100};

}  // namespace

std::string NameOf(const UsbMatch& match) {
  char id[16];
  std::snprintf(id, sizeof id, "%04x:%04x", static_cast<unsigned>(match.vendor),
                static_cast<unsigned>(match.product));
  return std::string("USB scanner ") + id + (match.serial.empty() ? "" : " " + match.serial);
}

UsbCarrier::UsbCarrier(UsbScannerOptions options, std::unique_ptr<UsbPort> port)
    : options_(std::move(options)),
      port_(std::move(port)),
      filled_(options_.transfers + 1),  // and a fault
      returned_(options_.transfers) {
  resting_.reserve(options_.transfers);
}

std::string UsbCarrier::name() const {
  UsbMatch found = options_.match;
  if (!serial_.empty()) found.serial = serial_;
  return NameOf(found);
}

std::string UsbCarrier::Remarks() const {
  std::string words;
  if (stalls_ > 0) words += std::to_string(stalls_) + " stalls";
  if (errors_ > 0) words += (words.empty() ? "" : ", ") + std::to_string(errors_) + " USB errors";
  return words;
}

hal::Error UsbCarrier::Failure(Fault fault) const {
  std::string what = "was unplugged";
  if (fault == Fault::kStalls) what = "stalls again and again; switch it off and on";
  if (fault == Fault::kErrors) what = "transfers fail again and again; try another cable or port";
  return {ErrorKind::kDevice, name() + ": " + what};
}

Result<void> UsbCarrier::Open() {
  Close();
  serial_.clear();
  auto opened = port_->Open(options_.match, options_.transfers, options_.transfer_bytes,
                            options_.arrival_timeout);
  if (!opened) return Fail(opened.error());
  serial_ = std::move(*opened);
  Filled old;
  while (filled_.TryTake(old)) {
  }
  std::uint32_t index = 0;
  while (returned_.TryTake(index)) {
  }
  while (request_ended_.try_acquire()) {
  }
  reading_.reset();
  request_state_ = Request::kNone;
  request_failed_ = false;
  in_flight_ = 0;
  halted_ = broken_ = false;
  resting_.clear();
  failures_in_a_row_ = 0;
  stalls_ = errors_ = 0;
  transfers_ = 0;
  stop_ = false;
  pump_ = options_.start_thread([this] { Pump(); });
  return {};
}

void UsbCarrier::Close() {
  if (!pump_.joinable()) return;
  stop_ = true;
  port_->Wake();
  pump_.join();
  port_->Close();
}

Result<void> UsbCarrier::Send(std::span<const std::uint8_t> bytes, nanoseconds timeout) {
  if (bytes.size() > request_.size()) {
    return Fail(ErrorKind::kInternal, name() + ": a request of " + std::to_string(bytes.size()) +
                                          " bytes, at most " + std::to_string(request_.size()));
  }
  if (request_state_.load() != Request::kNone) {
    return Fail(ErrorKind::kDevice, name() + ": takes no requests");
  }
  while (request_ended_.try_acquire()) {  // of requests that nobody waited for
  }
  std::copy(bytes.begin(), bytes.end(), request_.begin());
  request_bytes_ = bytes.size();
  request_failed_ = false;
  request_state_ = Request::kPosted;
  port_->Wake();
  if (timeout <= nanoseconds(0)) return {};
  if (!request_ended_.try_acquire_for(timeout)) {
    return Fail(ErrorKind::kDevice, name() + ": takes no requests");
  }
  if (request_failed_) return Fail(ErrorKind::kDevice, name() + ": does not take a request");
  return {};
}

Result<bool> UsbCarrier::Receive(WireDecoder& decoder, nanoseconds timeout) {
  if (reading_) {
    returned_.TryPut(*reading_);  // never full: there is room for all
    reading_.reset();
    port_->Wake();
  }
  Filled filled;
  if (!filled_.TakeWithin(filled, timeout)) return false;
  if (filled.fault != Fault::kNone) return Fail(Failure(filled.fault));
  reading_ = filled.transfer;
  decoder.Feed(port_->Buffer(filled.transfer).first(filled.bytes));
  return true;
}

void UsbCarrier::Pump() {
  for (std::uint32_t i = 0; i < options_.transfers; ++i) Submit(i);
  const hal::SteadyClock clock;
  while (!stop_) {
    port_->Wait(halted_ && in_flight_ == 0 ? kPause : kPumpTurn);
    while (const auto completion = port_->TakeEnded()) {
      if (completion->transfer == UsbCompletion::kOut) {
        RequestEnded(*completion);
      } else {
        Ended(*completion);
      }
    }
    for (std::uint32_t index = 0; returned_.TryTake(index);) Submit(index);
    if (halted_ && in_flight_ == 0 && clock.Now() >= recover_at_) Recover();
    if (request_state_ == Request::kPosted) {
      request_state_ = Request::kSending;
      if (broken_ || !port_->SendOut({request_.data(), request_bytes_})) {
        RequestEnded({UsbCompletion::kOut, 0, UsbEnd::kGone});
      }
    }
  }
}

void UsbCarrier::Submit(std::uint32_t transfer) {
  if (broken_) return;
  if (halted_) {
    resting_.push_back(transfer);
  } else if (port_->Submit(transfer)) {
    ++in_flight_;
  } else {
    Break(Fault::kGone);
  }
}

void UsbCarrier::Deliver(const UsbCompletion& completion) {
  transfers_.fetch_add(1, std::memory_order_relaxed);
  filled_.TryPut({static_cast<std::uint32_t>(completion.transfer),
                  static_cast<std::uint32_t>(completion.bytes), Fault::kNone});
}

// All that is in flight may end so; it is one failure, mended when nothing is in flight any more.
void UsbCarrier::Halt(UsbEnd end) {
  if (halted_) return;
  const bool is_stall = end == UsbEnd::kStall;
  ++(is_stall ? stalls_ : errors_);
  if (++failures_in_a_row_ > kMostInARow) return Break(is_stall ? Fault::kStalls : Fault::kErrors);
  recover_at_ = failures_in_a_row_ > 1 ? hal::SteadyClock().Now() + kPause : nanoseconds(0);
  halted_ = true;
  port_->CancelIn();
}

void UsbCarrier::Ended(const UsbCompletion& completion) {
  --in_flight_;
  if (broken_) return;
  if (completion.end == UsbEnd::kGone) return Break(Fault::kGone);
  if (completion.end == UsbEnd::kStall || completion.end == UsbEnd::kError) Halt(completion.end);
  if (broken_) return;
  if (completion.bytes > 0) {
    if (completion.end == UsbEnd::kData) failures_in_a_row_ = 0;
    Deliver(completion);  // what came before a failure is good, or the decoder finds out
  } else {
    Submit(static_cast<std::uint32_t>(completion.transfer));
  }
}

void UsbCarrier::RequestEnded(const UsbCompletion& completion) {
  if (completion.end != UsbEnd::kData) request_failed_ = true;
  if (completion.end == UsbEnd::kStall && !port_->ClearHalt(UsbPipe::kOut)) Break(Fault::kGone);
  request_state_ = Request::kNone;
  request_ended_.release();
}

void UsbCarrier::Recover() {
  if (broken_) return;
  if (!port_->ClearHalt(UsbPipe::kIn)) return Break(Fault::kGone);
  halted_ = false;
  std::vector<std::uint32_t> waiting;
  waiting.swap(resting_);
  for (const std::uint32_t index : waiting) Submit(index);
  waiting.clear();
  resting_.swap(waiting);  // keeps its memory
}

void UsbCarrier::Break(Fault fault) {
  if (broken_) return;
  broken_ = true;
  port_->CancelIn();
  filled_.TryPut({0, 0, fault});
}

}  // namespace bendloop::drivers
