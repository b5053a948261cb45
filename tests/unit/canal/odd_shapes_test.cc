// SPDX-License-Identifier: Apache-2.0
// What is no tube from one end to the other, or no tube at all: never rows without a word.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "pipeline/tube_model.h"
#include "tests/support/pipe_along.h"

namespace bendloop::pipeline {
namespace {

using testing::HasSubstr;

hal::Result<Measurement> MeasureShape(const tests::Points& points,
                                      TubeModel model = TubeModel::kAuto) {
  const hal::SteadyClock clock;
  return ReconstructModel(points, model, {}, clock);
}

std::string Said(const Measurement& measurement) {
  std::string all;
  for (const std::string& warning : measurement.warnings) all += warning + "\n";
  return all;
}

TEST(OddShapes, AClosedTubeIsToldAndHasNoRows) {
  tests::Random random(1);
  const hal::Tube frame = tests::Frame(120, 20, 6, 0);
  for (const tests::Points& points :
       {tests::PipeAlong(tests::Helix(40, 0, 1), 6, 2000, 0.05, random),
        tests::SyntheticCloud(frame, {.points = 3000}, random)}) {
    const auto tube = MeasureShape(points, TubeModel::kTube);
    ASSERT_FALSE(tube);
    EXPECT_THAT(tube.error().message, HasSubstr("the tube is closed"));
    const auto found = MeasureShape(points);
    ASSERT_TRUE(found) << found.error().message;
    EXPECT_TRUE(found->tube.program.rows.empty());
    EXPECT_NEAR(found->tube.pipe_radius_mm, 6, 0.02);
    EXPECT_THAT(Said(*found), HasSubstr("the tube is closed"));
  }
}

// What lies in front of an end is the other one, and neither is longer or less sure for it.
TEST(OddShapes, AFrameWhoseEndsNearlyMeetHasRows) {
  const hal::Tube frame = tests::Frame(120, 20, 6, 2.5);
  for (const int seed : {2, 5, 8, 11}) {
    tests::Random random(seed);
    const auto found = MeasureShape(tests::SyntheticCloud(frame, {.points = 6000}, random));
    ASSERT_TRUE(found) << found.error().message;
    const auto &rows = found->tube.program.rows, &sigma = found->sigma.rows;
    ASSERT_EQ(rows.size(), 5u) << Said(*found);
    for (const std::size_t end : {std::size_t{0}, std::size_t{4}}) {
      EXPECT_LT(sigma[end].length_mm, 0.3) << "seed " << seed;
      EXPECT_NEAR(rows[end].length_mm, frame.program.rows[end].length_mm, 4 * sigma[end].length_mm)
          << "seed " << seed;
    }
    for (std::size_t i = 0; i < 4; ++i) EXPECT_NEAR(rows[i].angle_deg, 90, 0.3);
  }
}

TEST(OddShapes, ACoilIsOneOfItsPipeAndNotAPipeAsWide) {
  tests::Random random(3);
  const auto found = MeasureShape(tests::PipeAlong(tests::Helix(20, 12, 2), 3, 3000, 0.05, random));
  if (!found) return;
  EXPECT_NEAR(found->tube.pipe_radius_mm, 3, 0.05);
  EXPECT_THAT(Said(*found),
              testing::AnyOf(HasSubstr("measured as a free form"), HasSubstr("arc follows upon")));
}

// Places on a wall that is not there: they came with sigmas of hundredths.
TEST(OddShapes, OfACoilNoCutsAndHolesAreTold) {
  tests::Random random(3);
  const auto found = MeasureShape(tests::PipeAlong(tests::Helix(20, 12, 2), 3, 3000, 0.05, random),
                                  TubeModel::kTube);
  ASSERT_TRUE(found) << found.error().message;
  ASSERT_THAT(Said(*found), HasSubstr("arc follows upon"));
  EXPECT_FALSE(found->features.is_known);
  EXPECT_FALSE(found->features.first_end);
  EXPECT_FALSE(found->features.last_end);
  EXPECT_TRUE(found->features.openings.empty());
}

}  // namespace
}  // namespace bendloop::pipeline
