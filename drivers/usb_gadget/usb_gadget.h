// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <string>

#include "hal/result.h"

namespace bendloop::drivers {

struct UsbGadgetOptions {
  std::uint16_t vendor = 0x1209;
  std::uint16_t product = 0x0001;
  std::string maker = "bendloop";
  std::string model = "software scanner";
  std::string serial = "SOFT-0001";
  std::string udc;  // the device port, of /sys/class/udc; "": the first one
  std::filesystem::path configfs = "/sys/kernel/config";
  std::filesystem::path mounts = "/run";  // the pipes appear below it
};

// This machine as a USB device with one scanner interface (../scanner_wire, "On USB"), by Linux's
// configfs and FunctionFS. Needs root. Read() and Write() block, each from its own thread; the rest
// from any. Errors are kDevice.
class UsbGadget {
 public:
  enum class Event { kNone, kEnabled, kDisabled };

  // Not plugged in yet. Removes what an earlier one of the same serial number left behind.
  static hal::Result<std::unique_ptr<UsbGadget>> Create(const UsbGadgetOptions& options);
  // Unplugs and removes everything.
  ~UsbGadget();
  UsbGadget(const UsbGadget&) = delete;
  UsbGadget& operator=(const UsbGadget&) = delete;

  // As if by the cable.
  hal::Result<void> Plug();
  void Unplug();
  const std::string& udc() const { return udc_; }

  // What the host did, within `timeout`. `wake`: a descriptor that ends the wait as well.
  Event WaitForHost(std::chrono::milliseconds timeout, int wake);

  // The host's bytes; 0: unplugged, or not enabled by the host (returns at once then).
  std::size_t Read(std::span<std::uint8_t> bytes);
  // False: unplugged or not enabled.
  bool Write(std::span<const std::uint8_t> bytes);
  // The IN pipe stalls until the host clears it. Nothing may be being written.
  bool Halt();

 private:
  explicit UsbGadget(const UsbGadgetOptions& options);
  hal::Result<void> Make();
  hal::Result<void> OpenPipes();
  void Remove();

  const UsbGadgetOptions options_;
  std::string name_;
  std::string udc_;
  std::filesystem::path gadget_;
  std::filesystem::path mount_;
  bool mounted_ = false;
  int control_ = -1;
  int in_ = -1;
  int out_ = -1;
};

}  // namespace bendloop::drivers
