// SPDX-License-Identifier: Apache-2.0
#include "drivers/simulated_scanner/simulate_session.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <cstring>
#include <filesystem>
#include <fstream>
#include <limits>
#include <sstream>

#include "drivers/session/session_check.h"
#include "drivers/session/session_source.h"

namespace bendloop::drivers {
namespace {

class SimulateSessionTest : public ::testing::Test {
 protected:
  SimulateSessionTest() {
    std::string pattern = (std::filesystem::temp_directory_path() / "bendloop-XXXXXX").string();
    folder_ = mkdtemp(pattern.data());
    options_.scan.path.profile_spacing_mm = 10;
    options_.scan.path.views_deg = SpreadViewsDeg(2);
  }
  ~SimulateSessionTest() override { std::filesystem::remove_all(folder_); }
  std::string Path(const std::string& name) const { return (folder_ / name).string(); }
  static std::string Bytes(const std::string& path) {
    std::ostringstream bytes;
    bytes << std::ifstream(path, std::ios::binary).rdbuf();
    return bytes.str();
  }

  std::filesystem::path folder_;
  hal::Tube tube_{8, {{{120, 0, 60, 25.0}, {80, 90, 45, 25.0}, {60, 0, 0, std::nullopt}}}, {}};
  SimulateSessionOptions options_;
};

TEST_F(SimulateSessionTest, RecordsWhatTheVirtualScanSees) {
  options_.more_meta["bends"] = "2";
  const auto made = SimulateSession(tube_, options_, Path("a"));
  ASSERT_TRUE(made) << made.error().message;
  const auto summary = CheckSession(Path("a"));
  ASSERT_TRUE(summary && summary->ok());
  EXPECT_TRUE(summary->warnings.empty());
  EXPECT_EQ(summary->profiles, made->profiles);
  EXPECT_EQ(summary->points, made->points);
  EXPECT_EQ(summary->meta.at("bends"), "2");
  EXPECT_EQ(summary->meta.at("part"), "simulated");

  hal::ManualClock clock;
  SessionSource source(Path("a"), ReplayPace::kMax, clock);
  const auto info = source.Open();
  ASSERT_TRUE(info && source.Start());
  const VirtualScan scan(made->tube, options_.scan);
  hal::LaserProfile replayed(info->max_points);
  hal::LaserProfile made_again(scan.max_points());
  hal::ScanEvent event;
  ASSERT_EQ(*source.Read(replayed, event, {}), hal::ReadStatus::kEvent);
  EXPECT_EQ(event.kind, hal::ScanEventKind::kScanStart);
  for (std::size_t i = 0; i < scan.profile_count(); ++i) {
    ASSERT_EQ(*source.Read(replayed, event, {}), hal::ReadStatus::kProfile);
    scan.Make(i, made_again);
    EXPECT_EQ(replayed.sequence, made_again.sequence);
    EXPECT_EQ(replayed.t_ns, made_again.t_ns);
    EXPECT_EQ(replayed.X_WS.position_mm, made_again.X_WS.position_mm);
    EXPECT_EQ(replayed.X_WS.orientation.coeffs(), made_again.X_WS.orientation.coeffs());
    EXPECT_EQ(replayed.intensity, made_again.intensity);
    ASSERT_EQ(replayed.points.size(), made_again.points.size());
    EXPECT_TRUE(replayed.points.empty() ||
                std::memcmp(replayed.points.data(), made_again.points.data(),
                            replayed.points.size() * sizeof(hal::ProfilePoint)) == 0);
  }
  ASSERT_EQ(*source.Read(replayed, event, {}), hal::ReadStatus::kEvent);
  EXPECT_EQ(event.kind, hal::ScanEventKind::kScanEnd);
  EXPECT_EQ(*source.Read(replayed, event, {}), hal::ReadStatus::kEnd);
}

TEST_F(SimulateSessionTest, TheSameOptionsGiveTheSameFile) {
  ASSERT_TRUE(SimulateSession(tube_, options_, Path("a")));
  ASSERT_TRUE(SimulateSession(tube_, options_, Path("b")));
  EXPECT_EQ(Bytes(Path("a")), Bytes(Path("b")));
  options_.scan.seed = 9;
  ASSERT_TRUE(SimulateSession(tube_, options_, Path("b")));
  EXPECT_NE(Bytes(Path("a")), Bytes(Path("b")));
}

TEST_F(SimulateSessionTest, SaysWhichOptionMakesNoSense) {
  const auto expect = [&](const char* words) {
    const auto made = SimulateSession(tube_, options_, Path("a"));
    ASSERT_FALSE(made);
    EXPECT_NE(made.error().message.find(words), std::string::npos) << made.error().message;
    options_ = SimulateSessionOptions();
  };
  options_.scan.noise_mm = std::numeric_limits<double>::quiet_NaN();
  expect("noise_mm is nan, expected 0 to 100");
  options_.scan.rays = 0;
  expect("rays is 0, expected 1 to 16384");
  options_.scan.path.profile_spacing_mm = 0;
  expect("profile_spacing_mm is 0");
  tube_.program.rows[1].bend_radius_mm = 3;
  expect("row 2: the bend radius is 3 mm, expected at least the pipe radius, 8 mm");
  tube_.program.rows.clear();
  expect("the tube has no rows");
}

}  // namespace
}  // namespace bendloop::drivers
