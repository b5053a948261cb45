// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>

namespace bendloop::host {

// How fast a scanner's clock runs against ours. A profile's delay, arrival less exposure, is never
// below what the way takes at best; the floor of the delays climbs or falls as the clocks part. The
// slope of the floors of up to 32 equal stretches of time is the drift. Fixed memory; the more
// time, the longer the stretches.
class ClockDrift {
 public:
  // Begins anew if the scanner's clock has been set back.
  void Add(std::int64_t device_ns, std::int64_t host_ns);
  // [ppm], positive: the scanner's clock is fast. Empty before 5 s of profiles, and beyond 10 000
  // ppm, where it is no clock but a recording played at another pace.
  std::optional<double> Ppm() const;

 private:
  struct Floor {
    std::int64_t at_ns = 0;  // since the first profile, on the scanner's clock
    std::int64_t delay_ns = 0;
  };
  void Merge();

  std::array<Floor, 32> floors_{};
  std::size_t count_ = 0;
  std::int64_t stretch_ns_ = 0;
  std::int64_t stretch_end_ns_ = 0;  // of the last floor's
  std::int64_t first_device_ns_ = 0;
  std::int64_t first_host_ns_ = 0;
  std::int64_t last_device_ns_ = 0;
};

}  // namespace bendloop::host
