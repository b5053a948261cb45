// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>
#include <unistd.h>

#include <bit>
#include <cstring>
#include <filesystem>
#include <random>
#include <set>
#include <string>
#include <vector>

#include "drivers/session/session_database.h"
#include "drivers/session/session_reader.h"
#include "drivers/session/session_writer.h"

namespace bendloop::drivers {

// Makes a file as of before the checksums, and as others write them.
inline constexpr const char* kWithoutSums =
    "ALTER TABLE profile DROP COLUMN crc; DELETE FROM meta WHERE key='digest';"
    "PRAGMA user_version=1;";

// A folder of its own for each test.
class SessionTest : public ::testing::Test {
 protected:
  SessionTest() {
    std::string pattern = (std::filesystem::temp_directory_path() / "bendloop-XXXXXX").string();
    folder_ = mkdtemp(pattern.data());
  }
  ~SessionTest() override { std::filesystem::remove_all(folder_); }

  std::string Path(const std::string& name) const { return (folder_ / name).string(); }
  std::set<std::string> Files() const {
    std::set<std::string> names;
    for (const auto& entry : std::filesystem::directory_iterator(folder_)) {
      names.insert(entry.path().filename().string());
    }
    return names;
  }
  void Sql(const std::string& path, const std::string& sql) const {
    auto database = OpenSessionForWriting(path);
    ASSERT_TRUE(database);
    const auto done = database->Execute(sql);
    ASSERT_TRUE(done) << done.error().message;
  }

  std::filesystem::path folder_;
};

// Values that use every bit.
inline hal::LaserProfile RandomProfile(std::mt19937_64& engine, std::uint64_t sequence,
                                       std::size_t points) {
  std::uniform_real_distribution<double> number(-500, 500);
  hal::LaserProfile profile(points);
  profile.sequence = sequence;
  profile.t_ns = static_cast<std::int64_t>(sequence * 1'000'000U) + 7;
  profile.X_WS.position_mm = {number(engine), number(engine), number(engine)};
  profile.X_WS.orientation =
      Eigen::Quaterniond(number(engine), number(engine), number(engine), number(engine))
          .normalized();
  for (std::size_t i = 0; i < points; ++i) {
    profile.points.push_back(
        {static_cast<float>(number(engine)), static_cast<float>(number(engine))});
    profile.intensity.push_back(static_cast<std::uint8_t>(engine()));
  }
  return profile;
}

inline bool SameBits(const hal::LaserProfile& a, const hal::LaserProfile& b) {
  return a.sequence == b.sequence && a.t_ns == b.t_ns && a.intensity == b.intensity &&
         std::memcmp(a.X_WS.position_mm.data(), b.X_WS.position_mm.data(), 24) == 0 &&
         std::memcmp(a.X_WS.orientation.coeffs().data(), b.X_WS.orientation.coeffs().data(), 32) ==
             0 &&
         a.points.size() == b.points.size() &&
         (a.points.empty() ||
          std::memcmp(a.points.data(), b.points.data(), a.points.size() * 8) == 0);
}

inline hal::ScanEvent Event(hal::ScanEventKind kind, std::int64_t t_ns, const char* detail = "") {
  hal::ScanEvent event;
  event.kind = kind;
  event.t_ns = t_ns;
  event.set_detail(detail);
  return event;
}

}  // namespace bendloop::drivers
