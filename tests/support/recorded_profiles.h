// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <string>

#include "hal/laser_profile.h"

namespace bendloop::test {

// An empty folder for recordings, which goes with it.
class RecordingFolder {
 public:
  RecordingFolder() {
    std::string name = (std::filesystem::temp_directory_path() / "recorder-XXXXXX").string();
    path_ = mkdtemp(name.data());
  }
  ~RecordingFolder() { std::filesystem::remove_all(path_); }
  RecordingFolder(const RecordingFolder&) = delete;
  RecordingFolder& operator=(const RecordingFolder&) = delete;

  const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

// The one of that number of a scan, at its microsecond.
inline hal::LaserProfile NumberedProfile(std::uint64_t sequence, std::size_t points = 10) {
  hal::LaserProfile profile(points);
  profile.sequence = sequence;
  profile.t_ns = static_cast<std::int64_t>(sequence) * 1000;
  for (std::size_t i = 0; i < points; ++i) profile.points.push_back({static_cast<float>(i), 1});
  return profile;
}

}  // namespace bendloop::test
