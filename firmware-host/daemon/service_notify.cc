// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/daemon/service_notify.h"

#include <systemd/sd-daemon.h>
#include <time.h>

#include <cinttypes>
#include <cstdint>
#include <cstdio>

namespace bendloop::host {

ServiceNotify::ServiceNotify(const hal::Clock& clock) : clock_(clock) {
  std::uint64_t microseconds = 0;
  if (sd_watchdog_enabled(0, &microseconds) > 0) period_ = std::chrono::microseconds(microseconds);
}

void ServiceNotify::Ready() { sd_notify(0, "READY=1"); }

void ServiceNotify::Stopping() { sd_notify(0, "STOPPING=1"); }

void ServiceNotify::Reloading() {
  timespec now{};
  clock_gettime(CLOCK_MONOTONIC, &now);
  const auto microseconds = std::int64_t{1'000'000} * now.tv_sec + now.tv_nsec / 1000;
  char words[64];  // by the stack: there may be no other memory
  std::snprintf(words, sizeof words, "RELOADING=1\nMONOTONIC_USEC=%" PRId64, microseconds);
  sd_notify(0, words);
}

void ServiceNotify::Status(const std::string& line) {
  if (line == status_) return;
  status_ = line;
  sd_notify(0, ("STATUS=" + line).c_str());
}

void ServiceNotify::Alive() {
  if (period_.count() == 0) return;
  const auto now = clock_.Now();
  if (last_.count() != 0 && now - last_ < period_ / 4) return;
  last_ = now;
  sd_notify(0, "WATCHDOG=1");
}

}  // namespace bendloop::host
