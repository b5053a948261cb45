// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <atomic>
#include <condition_variable>
#include <deque>
#include <functional>
#include <mutex>
#include <random>
#include <vector>

#include "drivers/simulated_scanner/scanner_device.h"
#include "drivers/usb_scanner/usb_port.h"

namespace bendloop::drivers {

// A bus with one scanner on it, and no hardware: the device's bytes come in transfers of odd sizes.
// It does what is asked of it after so many transfers, and counts what the driver does wrong.
class FakeBus {
 public:
  enum class Fault { kStall, kError, kGone, kEmpty };

  explicit FakeBus(hal::Clock& clock) : device({"fake", "F1", "1.0", "cal", 200}, clock) {}

  void WithDevice(const std::function<void(ScannerDevice&)>& action) {
    const std::lock_guard lock(mutex);
    action(device);
    changed.notify_all();
  }
  // From the `after`th filled transfer on, `times` times.
  void Plan(Fault fault, int after, int times = 1) {
    const std::lock_guard lock(mutex);
    for (int i = 0; i < times; ++i) plan.push_back({fault, filled + after});
  }

  std::mutex mutex;
  std::condition_variable changed;
  ScannerDevice device;
  bool plugged = true;
  bool replays_late = false;     // a new host first gets what the last one left
  bool stalls_all = false;       // a halt ends all transfers in flight, not one
  bool takes_requests = true;    // false: OUT transfers never end
  std::size_t most_bytes = 700;  // of a transfer
  std::vector<std::pair<Fault, int>> plan;
  int filled = 0;
  std::atomic<int> halts_cleared = 0;  // tests look at these while the carrier runs
  std::atomic<std::size_t> most_in_flight = 0;
  std::vector<std::string> wrong;  // what no driver may do
};

class FakeUsbPort final : public UsbPort {
 public:
  explicit FakeUsbPort(FakeBus& bus) : bus_(bus) { ended_.reserve(kMost); }

  hal::Result<std::string> Open(const UsbMatch&, std::size_t transfers, std::size_t bytes,
                                std::chrono::nanoseconds) override {
    const std::lock_guard lock(bus_.mutex);
    if (!bus_.plugged) return hal::Fail(hal::ErrorKind::kDevice, "fake: is not plugged in");
    buffers_.assign(transfers, std::vector<std::uint8_t>(std::min<std::size_t>(bytes, 4096)));
    submitted_.clear();
    ended_.clear();
    out_pending_ = false;
    halted_ = failed_ = false;
    return std::string("F1");
  }
  void Close() override {}
  bool Submit(std::size_t transfer) override {
    const std::lock_guard lock(bus_.mutex);
    if (!bus_.plugged) return false;
    if (std::count(submitted_.begin(), submitted_.end(), transfer) != 0) Wrong("submitted twice");
    submitted_.push_back(transfer);
    bus_.most_in_flight = std::max(bus_.most_in_flight.load(), submitted_.size());
    // What the device would write to from now on: a reader that still reads it must fail.
    std::fill(buffers_[transfer].begin(), buffers_[transfer].end(), std::uint8_t{0xEE});
    return true;
  }
  std::span<const std::uint8_t> Buffer(std::size_t transfer) const override {
    return buffers_[transfer];
  }
  bool SendOut(std::span<const std::uint8_t> bytes) override {
    const std::lock_guard lock(bus_.mutex);
    if (!bus_.plugged) return false;
    if (out_pending_) Wrong("two requests at once");
    out_pending_ = true;
    if (!bus_.takes_requests) return true;
    bus_.device.Receive(bytes);
    ended_.push_back({UsbCompletion::kOut, bytes.size(), UsbEnd::kData});
    out_pending_ = false;
    return true;
  }
  void CancelIn() override {
    const std::lock_guard lock(bus_.mutex);
    for (const std::size_t one : submitted_) ended_.push_back({one, 0, UsbEnd::kCancelled});
    submitted_.clear();
  }
  bool ClearHalt(UsbPipe) override {
    const std::lock_guard lock(bus_.mutex);
    if (!submitted_.empty()) Wrong("halt cleared with transfers in flight");
    if (!halted_ && !failed_) Wrong("nothing to clear");
    halted_ = failed_ = false;
    ++bus_.halts_cleared;
    return bus_.plugged;
  }
  void Wait(std::chrono::milliseconds timeout) override {
    std::unique_lock lock(bus_.mutex);
    const hal::SteadyClock clock;
    const auto deadline = clock.Now() + timeout;
    while (ended_.empty() && !woken_.exchange(false) && clock.Now() < deadline) {
      Fill();
      if (!ended_.empty()) break;
      const auto due = bus_.device.UntilDue();
      bus_.changed.wait_for(
          lock, std::clamp<std::chrono::nanoseconds>(due, std::chrono::microseconds(100),
                                                     std::chrono::milliseconds(1)));
    }
  }
  void Wake() override { woken_ = true; }  // within the millisecond
  std::optional<UsbCompletion> TakeEnded() override {
    const std::lock_guard lock(bus_.mutex);
    if (ended_.empty()) return std::nullopt;
    const UsbCompletion first = ended_.front();
    ended_.erase(ended_.begin());
    return first;
  }

 private:
  static constexpr std::size_t kMost = 256;

  void Wrong(const char* what) { bus_.wrong.emplace_back(what); }
  void End(std::size_t bytes, UsbEnd end) {
    ended_.push_back({submitted_.front(), bytes, end});
    submitted_.pop_front();
    ++bus_.filled;
  }
  void Fill() {
    if (!bus_.plugged) {
      while (!submitted_.empty()) End(0, UsbEnd::kGone);
      return;
    }
    if (halted_ || failed_) return;
    bus_.device.Work();
    while (!submitted_.empty() && !halted_ && !failed_) {
      const auto waiting = bus_.device.Waiting();
      const auto planned = std::find_if(bus_.plan.begin(), bus_.plan.end(),
                                        [&](const auto& p) { return p.second <= bus_.filled; });
      if (planned != bus_.plan.end()) {
        const FakeBus::Fault fault = planned->first;
        bus_.plan.erase(planned);
        if (fault == FakeBus::Fault::kGone) {
          bus_.plugged = false;
          bus_.device.HostWent();
          return Fill();
        }
        halted_ = fault == FakeBus::Fault::kStall;
        failed_ = failed_ || fault == FakeBus::Fault::kError;
        if (halted_ && bus_.stalls_all) {  // as some host controllers do
          while (!submitted_.empty()) End(0, UsbEnd::kStall);
        } else {
          End(0, halted_                           ? UsbEnd::kStall
                 : fault == FakeBus::Fault::kError ? UsbEnd::kError
                                                   : UsbEnd::kData);
        }
        continue;
      }
      if (waiting.empty()) return;
      std::vector<std::uint8_t>& buffer = buffers_[submitted_.front()];
      const std::size_t size =
          std::min({waiting.size(), buffer.size(),
                    1 + engine_() % std::max<std::size_t>(bus_.most_bytes, 1)});
      std::copy_n(waiting.begin(), size, buffer.begin());
      bus_.device.Sent(size);
      End(size, UsbEnd::kData);
    }
  }

  FakeBus& bus_;
  std::mt19937_64 engine_{1};
  std::vector<std::vector<std::uint8_t>> buffers_;
  std::deque<std::size_t> submitted_;
  std::vector<UsbCompletion> ended_;
  std::atomic<bool> woken_{false};
  bool out_pending_ = false;
  bool halted_ = false;
  bool failed_ = false;
};

}  // namespace bendloop::drivers
