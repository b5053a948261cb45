// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <condition_variable>
#include <fstream>
#include <functional>
#include <mutex>
#include <string>
#include <thread>

#include "drivers/simulated_scanner/scanner_device.h"
#include "drivers/usb_gadget/usb_gadget.h"

namespace bendloop::host {

// Carries a scanner device's bytes over a USB gadget: one thread for each pipe and one for what the
// host and the cable do.
class GadgetService {
 public:
  // Both outlive the service. What goes to the host is kept in the file `capture` as well, unless
  // it is "".
  GadgetService(drivers::UsbGadget& gadget, drivers::ScannerDevice& device,
                const std::string& capture);
  ~GadgetService();
  GadgetService(const GadgetService&) = delete;
  GadgetService& operator=(const GadgetService&) = delete;

  // Runs `action` while nobody else touches the device.
  void WithDevice(const std::function<void(drivers::ScannerDevice&)>& action);
  hal::Result<void> Plug();
  void Unplug();

 private:
  void Watch();
  void Receive();
  void Send();
  void Do(const drivers::ScannerFault& fault);

  drivers::UsbGadget& gadget_;
  drivers::ScannerDevice& device_;
  const int wake_;
  std::ofstream capture_;
  std::atomic<bool> stop_{false};
  std::mutex mutex_;
  std::condition_variable changed_;
  bool enabled_ = false;  // by the host
  std::thread watch_;
  std::thread receive_;
  std::thread send_;
};

}  // namespace bendloop::host
