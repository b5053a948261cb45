// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "drivers/scanner_wire/crc32c.h"
#include "drivers/session/session_source.h"
#include "drivers/simulated_scanner/simulate_session.h"
#include "hal/clock.h"
#include "hal/profile_source.h"

namespace bendloop::test {

// One scan, made once for the program, and its recording.
class ReferenceScan {
 public:
  static constexpr std::uint32_t kPoints = 200;

  static const ReferenceScan& Get() {
    static const ReferenceScan scan;
    return scan;
  }
  ReferenceScan(const ReferenceScan&) = delete;
  ReferenceScan& operator=(const ReferenceScan&) = delete;

  hal::Tube tube;
  drivers::VirtualScanOptions options;
  std::string session;

 private:
  ReferenceScan() {
    std::string pattern = (std::filesystem::temp_directory_path() / "bendloop-XXXXXX").string();
    folder_ = mkdtemp(pattern.data());
    session = (folder_ / "reference.session").string();
    options.path.profile_spacing_mm = 3;
    options.clutter.table = true;
    options.rays = kPoints;
    options.profiles_per_second = 4000;
    tube = drivers::LayOnTable(
        hal::Tube{8, {{{120, 0, 60, 25.0}, {80, 90, 45, 25.0}, {60, 0, 0, std::nullopt}}}, {}}, 1);
    drivers::SimulateSessionOptions recording;
    recording.scan = options;
    recording.lay_on_table = false;
    EXPECT_TRUE(drivers::SimulateSession(tube, recording, session));
  }
  ~ReferenceScan() { std::filesystem::remove_all(folder_); }

  std::filesystem::path folder_;
};

// A profile or event, in one comparable piece; every bit counts.
inline std::string Bits(const hal::LaserProfile& p) {
  std::vector<std::uint8_t> bits;
  const auto add = [&bits](const void* data, std::size_t size) {
    const auto* const bytes = static_cast<const std::uint8_t*>(data);
    bits.insert(bits.end(), bytes, bytes + size);
  };
  add(p.X_WS.position_mm.data(), 3 * sizeof(double));
  add(p.X_WS.orientation.coeffs().data(), 4 * sizeof(double));
  add(p.points.data(), p.points.size() * sizeof(hal::ProfilePoint));
  add(p.intensity.data(), p.intensity.size());
  return "profile " + std::to_string(p.sequence) + " at " + std::to_string(p.t_ns) + ", " +
         std::to_string(p.points.size()) + " points, bits " + std::to_string(drivers::Crc32c(bits));
}
inline std::string Bits(const hal::ScanEvent& event) {
  return "event " + std::string(hal::Name(event.kind)) + " " + std::to_string(event.t_ns) + " " +
         std::string(event.detail());
}

// Everything up to the scan's end (or an error, the recording's end, or `limit`), as Bits.
inline std::vector<std::string> ReadScan(hal::ProfileSource& source, std::size_t limit = SIZE_MAX,
                                         std::chrono::seconds patience = std::chrono::seconds(60)) {
  std::vector<std::string> items;
  hal::LaserProfile profile(ReferenceScan::kPoints);
  hal::ScanEvent event;
  const hal::SteadyClock clock;
  const auto deadline = clock.Now() + patience;
  while (items.size() < limit && clock.Now() < deadline) {
    const auto status = source.Read(profile, event, std::chrono::milliseconds(50));
    if (!status) {
      items.push_back("error " + status.error().message);
      break;
    }
    if (*status == hal::ReadStatus::kEnd) break;
    if (*status == hal::ReadStatus::kProfile) items.push_back(Bits(profile));
    if (*status == hal::ReadStatus::kEvent) {
      items.push_back(Bits(event));
      if (event.kind == hal::ScanEventKind::kScanEnd) break;
    }
  }
  return items;
}

// The reference scan as the session file holds it.
inline const std::vector<std::string>& ReferenceItems() {
  static const std::vector<std::string> items = [] {
    hal::SteadyClock clock;
    drivers::SessionSource session(ReferenceScan::Get().session, drivers::ReplayPace::kMax, clock);
    EXPECT_TRUE(session.Open());
    EXPECT_TRUE(session.Start());
    return ReadScan(session);
  }();
  return items;
}

}  // namespace bendloop::test
