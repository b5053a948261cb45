// SPDX-License-Identifier: Apache-2.0
#include "pipeline/points/kept_lines.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <map>

namespace bendloop::pipeline {
namespace {

// Lines along x in W, of rays that are `pitch_mm` apart, at `y_mm`.
class Stripes {
 public:
  Stripes(std::size_t rays, double pitch_mm, std::size_t room)
      : rays_(rays), pitch_mm_(pitch_mm), lines_(room) {}

  void Add(double y_mm) {
    hal::LaserProfile profile(rays_);
    profile.X_WS = {{0.0, y_mm, 100.0}, Eigen::Quaterniond(0, 1, 0, 0)};
    for (std::size_t i = 0; i < rays_; ++i) {
      profile.points.push_back({static_cast<float>(pitch_mm_ * static_cast<double>(i)), 100.0F});
    }
    lines_.Add(profile, 0);
  }

  const KeptLines& kept() const { return lines_; }
  // Numbers of rays by where their lines are.
  std::map<double, std::vector<std::size_t>> RaysOfLines() const {
    std::map<double, std::vector<std::size_t>> rays;
    for (const Eigen::Vector3d& point : lines_.Points().points_mm) {
      rays[point.y()].push_back(static_cast<std::size_t>(std::lround(point.x() / pitch_mm_)));
    }
    return rays;
  }

 private:
  std::size_t rays_;
  double pitch_mm_;
  KeptLines lines_;
};

std::vector<double> GapsMm(const Stripes& stripes) {
  std::vector<double> gaps_mm;
  double last_mm = std::numeric_limits<double>::quiet_NaN();
  for (const auto& [y_mm, rays] : stripes.RaysOfLines()) {
    if (!std::isnan(last_mm)) gaps_mm.push_back(y_mm - last_mm);
    last_mm = y_mm;
  }
  return gaps_mm;
}

TEST(KeptLines, AreAllThereWhileThereIsRoom) {
  Stripes stripes(100, 0.1, 12'000);
  for (int i = 0; i < 100; ++i) stripes.Add(0.5 * i);
  EXPECT_EQ(stripes.kept().point_count(), 10'000U);
  const DirectedPoints all = stripes.kept().Points();
  ASSERT_EQ(all.to_sensor.size(), 10'000U);
  EXPECT_LT((all.points_mm[101] - Eigen::Vector3d(0.1, 0.5, 0.0)).norm(), 1e-6);
  const UnpackedDirection towards = UnpackDirection(all.to_sensor[0]);
  EXPECT_NEAR(towards.z, 1.0, 1e-3);
}

TEST(KeptLines, LoseRaysWhereRaysLieCloserThanLines) {
  Stripes stripes(400, 0.05, 12'000);
  for (int i = 0; i < 100; ++i) stripes.Add(0.8 * i);
  const auto lines = stripes.RaysOfLines();
  EXPECT_EQ(lines.size(), 100U);
  for (const auto& [y_mm, rays] : lines) {
    ASSERT_EQ(rays.size(), 100U) << y_mm;
    for (std::size_t i = 0; i < rays.size(); ++i) ASSERT_EQ(rays[i], 4 * i) << y_mm;
  }
}

TEST(KeptLines, LoseLinesWhereLinesLieCloserThanRays) {
  Stripes stripes(20, 0.4, 1'900);
  for (int i = 0; i < 400; ++i) stripes.Add(0.1 * i);
  for (const auto& [y_mm, rays] : stripes.RaysOfLines()) EXPECT_EQ(rays.size(), 20U) << y_mm;
  EXPECT_LE(stripes.kept().point_count(), 1'100U);
  EXPECT_THAT(GapsMm(stripes), testing::Each(testing::DoubleNear(0.8, 0.01)));
}

// However long a scan is, its lines stay, as even as they are, from its first to its last.
TEST(KeptLines, AreEvenOverTheWholeScan) {
  Stripes stripes(1000, 0.05, 20'000);
  for (int i = 0; i < 5'000; ++i) stripes.Add(0.05 * i);
  EXPECT_LE(stripes.kept().point_count(), 21'000U);
  EXPECT_GE(stripes.kept().point_count(), 5'000U);
  const auto lines = stripes.RaysOfLines();
  const double pitch_mm = 0.05 * static_cast<double>(lines.begin()->second[1]);
  const std::vector<double> gaps_mm = GapsMm(stripes);
  EXPECT_THAT(gaps_mm,
              testing::Each(testing::AllOf(testing::Ge(pitch_mm), testing::Le(8 * pitch_mm))));
  EXPECT_NEAR(lines.begin()->first, 0.0, 1e-9);
  EXPECT_NEAR(lines.rbegin()->first, 249.95, gaps_mm.front() + 1e-9);
}

// A scanner that is held over a place, shaking by a hundredth, gives it no more than its share.
TEST(KeptLines, OfAPlaceThatIsSeenForLongAreFew) {
  Stripes stripes(100, 0.1, 20'000);
  for (int i = 0; i < 100; ++i) stripes.Add(0.5 * i);
  for (int i = 0; i < 2'000; ++i) stripes.Add(50.0 + 0.01 * (i % 3));
  for (int i = 0; i < 100; ++i) stripes.Add(50.5 + 0.5 * i);
  const std::vector<double> gaps_mm = GapsMm(stripes);
  EXPECT_GE(gaps_mm.size(), 198U);
  EXPECT_LE(gaps_mm.size(), 202U);
}

TEST(KeptLines, NearAPlaceAreAFew) {
  Stripes stripes(100, 0.1, 100'000);
  for (int i = 0; i < 100; ++i) stripes.Add(0.5 * i);
  const std::vector<Ball> balls = {{{5, 10, 0}, 1.1}, {{12, 30, 0}, 1.0}, {{5, -4, 0}, 3.0}};
  std::map<double, int> lines;
  for (const Eigen::Vector3d& point : stripes.kept().Near(balls).Points().points_mm) {
    ++lines[point.y()];
  }
  EXPECT_THAT(lines, testing::ElementsAre(testing::Pair(9.0, 100), testing::Pair(9.5, 100),
                                          testing::Pair(10.0, 100), testing::Pair(10.5, 100),
                                          testing::Pair(11.0, 100)));
}

// Thinned once more they are what they were had there been less room.
TEST(KeptLines, AreThinnedOnceMore) {
  Stripes stripes(400, 0.05, 50'000), few(400, 0.05, 12'000);
  for (int i = 0; i < 100; ++i) stripes.Add(0.8 * i), few.Add(0.8 * i);
  EXPECT_EQ(stripes.kept().point_count(), 40'000U);
  EXPECT_EQ(stripes.kept().ThinnedTo(12'000).Points().points_mm, few.kept().Points().points_mm);
}

hal::LaserProfile OfPoints(std::size_t count, double far_mm = 1.0) {
  hal::LaserProfile profile(count);
  for (std::size_t i = 0; i < count; ++i) profile.points.push_back({0, static_cast<float>(far_mm)});
  return profile;
}

TEST(KeptLines, HoldNoPointThatIsNone) {
  KeptLines lines(100);
  lines.Add(OfPoints(1, std::numeric_limits<double>::quiet_NaN()), 0);
  lines.Add(OfPoints(0), 0);
  EXPECT_EQ(lines.point_count(), 0U);
  lines.Add(OfPoints(1), 0);
  ASSERT_EQ(lines.point_count(), 1U);
  EXPECT_EQ(lines.Points().points_mm[0], Eigen::Vector3d(0, 0, 1));
}

// Bounded whatever comes: lines of a point, all at one place.
TEST(KeptLines, StayWithinTheirRoom) {
  KeptLines lines(100);
  for (int i = 0; i < 1'000; ++i) lines.Add(OfPoints(1), 0);
  EXPECT_LE(lines.point_count(), 6U);
  KeptLines line(100);
  line.Add(OfPoints(10'000), 0);
  EXPECT_LE(line.point_count(), 100U);
  KeptLines none(0);
  for (int i = 0; i < 10; ++i) none.Add(OfPoints(3), 0);
  EXPECT_LE(none.point_count(), 1U);
}

}  // namespace
}  // namespace bendloop::pipeline
