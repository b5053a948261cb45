// SPDX-License-Identifier: Apache-2.0
#include "pipeline/features/pass_lines.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace bendloop::pipeline {
namespace {

constexpr std::size_t kStrips = 40;

// Lines 1 mm apart, tilted alike, as strips of a view from one side cross them; `ends`: beyond it
// a strip sees none.
template <typename Ends>
std::vector<std::vector<StripCrossing>> Crossed(double off_mm, const Ends& ends) {
  std::mt19937_64 random(1);
  std::normal_distribution<double> pace(0, 0.05), noise(0, 0.002);
  std::vector<double> lines;
  for (int i = 0; i < 10; ++i) lines.push_back(i + pace(random));
  lines.back() += off_mm;
  std::vector<std::vector<StripCrossing>> strips(kStrips);
  for (std::size_t s = 0; s < kStrips; ++s) {
    const double y = -0.95 + 1.9 * static_cast<double>(s) / (kStrips - 1);
    const Eigen::Vector2d direction(std::sqrt(1 - y * y), y);
    for (const double line : lines) {
      const double at_mm = line + 0.3 * direction.x() - 0.2 * y + noise(random);
      if (!ends(s, line)) strips[s].push_back({at_mm, direction, 0.002});
    }
  }
  return strips;
}

TEST(PassLines, ALineThatEndsHalfwayIsKnownWhereItIsNoMore) {
  // The last one is 0.3 mm late, and seen by the first half.
  const auto strips = Crossed(0.3, [](std::size_t s, double line) { return line > 8.7 && s > 19; });
  const auto whole = Crossed(0.3, [](std::size_t, double) { return false; });
  const PassLines lines(strips);
  for (const std::size_t s : {20U, 25U, 39U}) {
    const auto next = lines.After(s);
    ASSERT_TRUE(next);
    EXPECT_NEAR(next->at_mm, whole[s].back().at_mm, 5 * next->sigma_mm) << s;
    EXPECT_FALSE(lines.HasLostNext(s));
  }
  EXPECT_LT(lines.After(20)->sigma_mm, 0.01);
  EXPECT_FALSE(lines.After(20)->is_shared);
}

TEST(PassLines, TheLineAfterAllIsExpectedAsTheOthersCame) {
  const auto strips = Crossed(0.0, [](std::size_t, double) { return false; });
  const PassLines lines(strips);
  const auto next = lines.After(10);
  ASSERT_TRUE(next);
  EXPECT_TRUE(next->is_shared);
  EXPECT_NEAR(next->at_mm - strips[10].back().at_mm, 1.0, 0.1);
  EXPECT_GT(next->sigma_mm, 0.03);
  EXPECT_LT(next->sigma_mm, 0.15);
}

TEST(PassLines, ARayThatIsLostIsNoEnd) {
  const auto strips =
      Crossed(0.0, [](std::size_t s, double line) { return line > 8.7 && (s == 12 || s > 30); });
  const PassLines lines(strips);
  EXPECT_TRUE(lines.HasLostNext(12));
  EXPECT_FALSE(lines.HasLostNext(35));
  EXPECT_GT(lines.lost_part(), 0.0);
  EXPECT_LT(lines.lost_part(), 0.01);
}

TEST(PassLines, OfAFewCrossingsNothingIsTold) {
  EXPECT_FALSE(PassLines({{}, {}}).After(0));
  const Eigen::Vector2d direction(1, 0);
  EXPECT_FALSE(PassLines({{{0, direction, 0.01}}, {{0, direction, 0.01}}}).After(1));
}

}  // namespace
}  // namespace bendloop::pipeline
