// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>

#include "hal/result.h"

namespace bendloop::drivers {

// Which USB device.
struct UsbMatch {
  std::uint16_t vendor = 0x1209;
  std::uint16_t product = 0x0001;
  std::string serial;  // of the device descriptor; "": whatever it is, if there is one device only
};
// "USB scanner 1209:0001 A1234", for messages.
std::string NameOf(const UsbMatch& match);

// How a transfer ended.
enum class UsbEnd : std::uint8_t {
  kData,       // done; a short one, too
  kStall,      // the pipe is halted
  kError,      // the bus failed; the next one may be good
  kCancelled,  // by us
  kGone,       // the device is no longer there
};

struct UsbCompletion {
  static constexpr std::size_t kOut = ~std::size_t{0};
  std::size_t transfer = kOut;  // index of an IN transfer, or kOut
  std::size_t bytes = 0;
  UsbEnd end = UsbEnd::kData;
};

enum class UsbPipe : std::uint8_t { kIn, kOut };

// One open USB device with a bulk IN and a bulk OUT pipe, as the driver sees it: libusb's
// (libusb_port.h) or a test's. Open() and Close() come from one thread, Wake() from any, the rest
// from the thread that pumps in between. An IN transfer is the driver's until Submit(), then the
// port's until its completion.
class UsbPort {
 public:
  virtual ~UsbPort() = default;

  // Finds, opens and claims; one IN transfer for each of `transfers` buffers of `bytes`. Waits at
  // most `arrival_timeout` for a device that is not there. The device's serial number.
  virtual hal::Result<std::string> Open(const UsbMatch& match, std::size_t transfers,
                                        std::size_t bytes,
                                        std::chrono::nanoseconds arrival_timeout) = 0;
  // Ends all transfers and lets the device go.
  virtual void Close() = 0;

  // False: the device is no longer there.
  virtual bool Submit(std::size_t transfer) = 0;
  virtual std::span<const std::uint8_t> Buffer(std::size_t transfer) const = 0;
  // One at a time, ends with a completion of kOut. False as above.
  virtual bool SendOut(std::span<const std::uint8_t> bytes) = 0;
  // Asks all IN transfers to end; each completes as kCancelled unless it was quicker.
  virtual void CancelIn() = 0;
  // False as above. None of the pipe's transfers may be in flight.
  virtual bool ClearHalt(UsbPipe pipe) = 0;

  // Returns when a transfer has ended, Wake() was called, or the time is over.
  virtual void Wait(std::chrono::milliseconds timeout) = 0;
  // Takes no lock and allocates nothing.
  virtual void Wake() = 0;
  virtual std::optional<UsbCompletion> TakeEnded() = 0;
};

}  // namespace bendloop::drivers
