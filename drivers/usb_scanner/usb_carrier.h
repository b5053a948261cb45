// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <semaphore>
#include <string>
#include <thread>
#include <vector>

#include "drivers/scanner_wire/byte_carrier.h"
#include "drivers/usb_scanner/usb_port.h"
#include "drivers/usb_scanner/usb_scanner.h"
#include "hal/bounded_queue.h"

namespace bendloop::drivers {

// Carries the scanner's messages over a pair of bulk pipes. One thread, the pump, does all that
// concerns USB: it keeps the IN transfers in flight, clears halts and sends requests. The reader
// gets finished transfers through a bounded queue without locks, reads them where they are, and
// gives them back at its next call. A reader that is slow keeps transfers from the pump and so
// makes the device wait.
class UsbCarrier final : public ByteCarrier {
 public:
  UsbCarrier(UsbScannerOptions options, std::unique_ptr<UsbPort> port);
  ~UsbCarrier() override { Close(); }

  std::string name() const override;
  hal::Result<void> Open() override;
  void Close() override;
  bool is_open() const override { return pump_.joinable(); }
  hal::Result<void> Send(std::span<const std::uint8_t> bytes,
                         std::chrono::nanoseconds timeout) override;
  hal::Result<bool> Receive(WireDecoder& decoder, std::chrono::nanoseconds timeout) override;
  std::string Remarks() const override;

 private:
  enum class Fault : std::uint8_t { kNone, kGone, kStalls, kErrors };
  struct Filled {
    std::uint32_t transfer = 0;
    std::uint32_t bytes = 0;
    Fault fault = Fault::kNone;
  };
  template <class T>
  using Queue = hal::BoundedQueue<T>;

  static constexpr std::size_t kMostRequestBytes = 256;

  hal::Error Failure(Fault fault) const;

  // Of the pump.
  void Pump();
  void Submit(std::uint32_t transfer);
  void Ended(const UsbCompletion& completion);
  void RequestEnded(const UsbCompletion& completion);
  void Deliver(const UsbCompletion& completion);
  void Halt(UsbEnd end);
  void Recover();
  void Break(Fault fault);

  const UsbScannerOptions options_;
  const std::unique_ptr<UsbPort> port_;
  std::string serial_;
  std::thread pump_;
  std::atomic<bool> stop_{false};

  Queue<Filled> filled_;
  Queue<std::uint32_t> returned_;
  std::optional<std::uint32_t> reading_;  // the reader's at the moment

  std::array<std::uint8_t, kMostRequestBytes> request_{};
  std::size_t request_bytes_ = 0;
  enum class Request : std::uint8_t { kNone, kPosted, kSending };
  std::atomic<Request> request_state_{Request::kNone};
  std::atomic<bool> request_failed_{false};
  std::counting_semaphore<> request_ended_{0};

  // Of the pump alone.
  std::size_t in_flight_ = 0;
  bool halted_ = false;
  bool broken_ = false;
  std::vector<std::uint32_t> resting_;  // until the pipe is mended
  std::uint32_t failures_in_a_row_ = 0;
  std::chrono::nanoseconds recover_at_{0};

  std::atomic<std::uint64_t> stalls_{0};
  std::atomic<std::uint64_t> errors_{0};
  std::atomic<std::uint64_t> transfers_{0};
};

}  // namespace bendloop::drivers
