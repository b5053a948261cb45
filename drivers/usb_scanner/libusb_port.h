// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <poll.h>

#include <deque>
#include <memory>
#include <vector>

#include "drivers/usb_scanner/usb_port.h"

struct libusb_context;
struct libusb_device;
struct libusb_device_handle;
struct libusb_transfer;

namespace bendloop::drivers {

// The real thing, by libusb-1.0. Open() takes a fresh look at the bus each time; where udev runs it
// is told of arrivals.
class LibusbPort final : public UsbPort {
 public:
  LibusbPort();
  ~LibusbPort() override;
  LibusbPort(const LibusbPort&) = delete;
  LibusbPort& operator=(const LibusbPort&) = delete;

  hal::Result<std::string> Open(const UsbMatch& match, std::size_t transfers, std::size_t bytes,
                                std::chrono::nanoseconds arrival_timeout) override;
  void Close() override;
  bool Submit(std::size_t transfer) override;
  std::span<const std::uint8_t> Buffer(std::size_t transfer) const override;
  bool SendOut(std::span<const std::uint8_t> bytes) override;
  void CancelIn() override;
  bool ClearHalt(UsbPipe pipe) override;
  void Wait(std::chrono::milliseconds timeout) override;
  void Wake() override;
  std::optional<UsbCompletion> TakeEnded() override;

 private:
  struct Pipes {
    int interface_number = -1;
    std::uint8_t in = 0;
    std::uint8_t out = 0;
  };
  struct Transfer {
    LibusbPort* port = nullptr;
    std::size_t index = 0;
    libusb_transfer* usb = nullptr;
    bool in_flight = false;
    std::vector<std::uint8_t> buffer;
  };

  // One look at the bus.
  hal::Result<std::string> OpenOnce(const UsbMatch& match, const std::string& name);
  hal::Result<void> Take(libusb_device* device, libusb_device_handle* handle,
                         const std::string& name);
  hal::Result<void> Prepare(std::size_t transfers, std::size_t bytes, const std::string& name);
  void AwaitArrival(const UsbMatch& match, std::chrono::nanoseconds timeout);
  bool Start(Transfer& transfer);
  static void OnEnded(libusb_transfer* usb);

  libusb_context* context_ = nullptr;
  libusb_device_handle* handle_ = nullptr;
  Pipes pipes_;
  int wake_ = -1;
  bool gone_ = false;
  std::vector<pollfd> waiting_;
  std::vector<std::unique_ptr<Transfer>> in_;
  Transfer out_;
  std::deque<UsbCompletion> ended_;
};

}  // namespace bendloop::drivers
