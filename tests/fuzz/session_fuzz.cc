// SPDX-License-Identifier: Apache-2.0
// Links: bendloop_drivers_session
#include <sys/mman.h>
#include <unistd.h>

#include <cstddef>
#include <cstdint>
#include <string>

#include "drivers/session/session_check.h"
#include "drivers/session/session_source.h"

// Any bytes as a session file: checked and replayed without a crash.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace bendloop;
  const int file = memfd_create("session", 0);
  if (file < 0 || write(file, data, size) != static_cast<ssize_t>(size)) __builtin_trap();
  const std::string path = "/proc/self/fd/" + std::to_string(file);
  (void)drivers::CheckSession(path);
  hal::ManualClock clock;
  drivers::SessionSource source(path, drivers::ReplayPace::kRecorded, clock);
  if (const auto info = source.Open(); info && source.Start()) {
    hal::LaserProfile profile(info->max_points);
    hal::ScanEvent event;
    while (true) {
      const auto status = source.Read(profile, event, std::chrono::hours(1'000'000));
      if (!status || *status == hal::ReadStatus::kEnd) break;
      if (profile.points.size() > info->max_points) __builtin_trap();
    }
  }
  close(file);
  return 0;
}
