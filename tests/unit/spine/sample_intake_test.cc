// SPDX-License-Identifier: Apache-2.0
#include "pipeline/spine/sample_intake.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

namespace bendloop::pipeline {
namespace {

constexpr double kLengthMm = 200.0;

// A straight from end to end, with a few more points than may wait.
std::vector<Eigen::Vector3d> MoreThanWait() {
  std::vector<Eigen::Vector3d> points(SampleGrid::kMaxPoints + 200'000);
  for (std::size_t i = 0; i < points.size(); ++i) {
    const double turn = 0.7 * static_cast<double>(i % 10'000);
    points[i] = {kLengthMm * static_cast<double>(i) / static_cast<double>(points.size()),
                 5 * std::cos(turn), 5 * std::sin(turn)};
  }
  return points;
}

double LastMm(const SampleGrid& grid) {
  double last_mm = 0;
  for (const SampleGrid::Block& block : grid.blocks()) {
    for (const Eigen::Vector3d& sample : block.samples()) last_mm = std::max(last_mm, sample.x());
  }
  return last_mm;
}

TEST(SampleIntake, TooManyPointsAreThinnedAndNotCutOff) {
  const auto points = MoreThanWait();
  for (const bool lent : {true, false}) {
    SampleIntake intake(std::nullopt, SampleGrid::kMaxPoints, SampleGrid::kMaxPoints);
    if (lent) {
      intake.Lend(points);
    } else {
      intake.Add(points);
    }
    ASSERT_TRUE(intake.FindPipeRadius(nullptr)) << lent;
    EXPECT_NEAR(intake.pipe_radius_mm(), 5, 0.01) << lent;
    ASSERT_TRUE(intake.TakeAll(nullptr)) << lent;
    EXPECT_GT(LastMm(intake.grid()), kLengthMm - 1.0) << lent;
    EXPECT_LE(intake.grid().kept_count(), SampleGrid::kMaxPoints + intake.grid().sample_count());
  }
}

}  // namespace
}  // namespace bendloop::pipeline
