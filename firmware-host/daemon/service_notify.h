// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <string>

#include "hal/clock.h"

namespace bendloop::host {

// Words with the service manager; all of them do nothing outside of systemd.
class ServiceNotify {
 public:
  explicit ServiceNotify(const hal::Clock& clock);

  std::chrono::nanoseconds period() const { return period_; }  // of the watchdog; 0: none
  void Ready();
  void Stopping();
  // Ready() ends it.
  void Reloading();
  // One line for `systemctl status`; sent only when it changes.
  void Status(const std::string& line);
  // Keeps the watchdog quiet: at most twice in its period.
  void Alive();

 private:
  const hal::Clock& clock_;
  std::chrono::nanoseconds period_{0};  // 0: no watchdog
  std::chrono::nanoseconds last_{0};
  std::string status_;
};

}  // namespace bendloop::host
