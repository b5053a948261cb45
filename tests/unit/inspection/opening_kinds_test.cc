// SPDX-License-Identifier: Apache-2.0
// Holes, slots and what leaning drills leave are told apart where the part names one of them.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "pipeline/inspection/inspection.h"
#include "pipeline/tube/representations.h"
#include "tests/support/reversed_features.h"
#include "tests/support/synthetic_tube.h"
#include "tests/unit/inspection/sample_parts.h"

namespace bendloop::pipeline {
namespace {

using ::testing::Contains;
using ::testing::Each;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr double kPipeRadiusMm = 8;
constexpr double kAlongMm = 40, kAroundDeg = 90;

// `radial_sigma_deg`: by which one that does not lean may lean each way.
OpeningFound FoundOn(const hal::Tube& tube, const hal::WallOpening& opening,
                     double radial_sigma_deg) {
  const auto segments = hal::SpineSegments(tube.program, tube.X_WT);
  const hal::SurfaceFrame frame = hal::FrameAt(segments, opening.along_mm, opening.around_deg);
  const double axis = opening.axis_deg * std::acos(-1.0) / 180;
  const bool leans = opening.lean_along_deg != 0 || opening.lean_around_deg != 0;
  const double lean_sigma_deg = leans ? 0.25 : radial_sigma_deg;
  return {opening,
          {0.02, 0.1, 0.02, 0.02, opening.is_hole() ? 0.0 : 0.2, lean_sigma_deg, lean_sigma_deg},
          frame.spine_mm + kPipeRadiusMm * frame.outward,
          std::cos(axis) * frame.tangent + std::sin(axis) * frame.sideways()};
}

Inspection InspectOpening(const hal::WallOpening& named, const hal::WallOpening& found,
                          bool from_other_end = false, double radial_sigma_deg = 0) {
  support::Rng rng(7);
  Measurement measured = support::MeasurementOf({kPipeRadiusMm, kPart, {}}, rng);
  hal::TubeFeatures cut;
  cut.openings = {found};
  if (from_other_end) {
    cut = tests::ReversedFeatures(cut, measured.tube);
    measured.tube = ReverseTube(measured.tube);
    measured.sigma = ReverseProgram(measured.sigma);
  }
  measured.features.openings = {FoundOn(measured.tube, cut.openings.front(), radial_sigma_deg)};
  InspectionOptions options;
  options.features.openings = {{named.is_hole() ? "hole 1" : "slot 1", named, false, 0.5, 2.0, 0.3,
                                named.is_hole() ? std::nullopt : std::optional<double>(2.0)}};
  return Inspect(measured, kPart, kPipeRadiusMm, options);
}

hal::WallOpening Hole(double diameter_mm, double lean_along_deg = 0, double lean_around_deg = 0) {
  return {kAlongMm, kAroundDeg, diameter_mm, diameter_mm, 0, lean_along_deg, lean_around_deg};
}
hal::WallOpening Slot(double length_mm, double width_mm, double axis_deg = 0) {
  return {kAlongMm, kAroundDeg, length_mm, width_mm, axis_deg};
}

TEST(OpeningKinds, ASlotIsNoHoleOfItsLengthOrWidth) {
  for (const double diameter_mm : {11.55, 4.2}) {
    for (const double axis_deg : {0.0, 90.0, 30.0}) {
      const Inspection in = InspectOpening(Hole(diameter_mm), Slot(11.55, 4.2, axis_deg));
      EXPECT_EQ(in.verdict, Verdict::kFail) << diameter_mm;
      EXPECT_LT(in.probability, 0.01);
      EXPECT_THAT(in.reasons, Each(HasSubstr("hole 1 (found: a slot of 11.55 x 4.20 mm) ")));
      EXPECT_EQ(in.features.openings[0].named, OpeningKind::kHole);
      EXPECT_EQ(in.features.openings[0].found_as, OpeningKind::kSlot);
      EXPECT_EQ(in.features.openings[0].axis_deg.state, ToleranceState::kNotJudged);
    }
  }
  EXPECT_THAT(InspectOpening(Hole(11.55), Slot(11.55, 4.2)).reasons,
              Contains(HasSubstr("width 7.35 mm below nominal (tolerance 0.30 mm")));
}

TEST(OpeningKinds, AHoleIsNoSlotOfItsLengthOrWidth) {
  for (const double diameter_mm : {11.55, 4.2, 7.0}) {
    const Inspection in = InspectOpening(Slot(11.55, 4.2), Hole(diameter_mm));
    EXPECT_EQ(in.verdict, Verdict::kFail) << diameter_mm;
    EXPECT_THAT(in.reasons, Each(HasSubstr("slot 1 (found: a hole of ")));
    EXPECT_EQ(in.features.openings[0].found_as, OpeningKind::kHole);
    EXPECT_EQ(in.features.openings[0].axis_deg.state, ToleranceState::kNotJudged);
  }
}

TEST(OpeningKinds, BothWaysWithinTheToleranceAndStillNotRoundFails) {
  const Inspection in = InspectOpening(Hole(6), Slot(6.22, 5.78));
  EXPECT_EQ(in.verdict, Verdict::kFail);
  ASSERT_EQ(in.reasons.size(), 1U);
  EXPECT_THAT(in.reasons[0], HasSubstr("length less width 0.44 mm above nominal"));
  EXPECT_EQ(InspectOpening(Slot(6.22, 5.78), Hole(6)).verdict, Verdict::kFail);
}

TEST(OpeningKinds, IsUndecidedWithinTheDoubtOfWhatItIs) {
  const Inspection in = InspectOpening(Hole(6), Slot(6.15, 5.84));
  EXPECT_EQ(in.verdict, Verdict::kUndecided);
  EXPECT_THAT(in.reasons, Contains(HasSubstr("hole 1 (found: a slot of 6.15 x 5.84 mm)")));
}

TEST(OpeningKinds, ALeaningDrillsOvalIsNoRoundHoleBeyondTheTolerance) {
  for (const auto& [along_deg, around_deg] : {std::pair{30.0, 0.0}, {0.0, -30.0}, {21.0, 21.0}}) {
    const Inspection in = InspectOpening(Hole(6), Hole(6, along_deg, around_deg));
    EXPECT_EQ(in.verdict, Verdict::kFail) << along_deg;
    EXPECT_THAT(in.reasons, Each(HasSubstr("hole 1 (found: a leaning hole of 6.")));
    EXPECT_THAT(in.reasons, Each(HasSubstr("degrees off the wall's normal) length")));
    EXPECT_EQ(in.features.openings[0].found_as, OpeningKind::kLeaningHole);
    EXPECT_GT(in.features.openings[0].length_mm.sigma, 0.02);
  }
  // 6 mm at 30 degrees are 6.93 mm long.
  const Inspection in = InspectOpening(Hole(6), Hole(6, 30, 0));
  EXPECT_NEAR(in.features.openings[0].length_mm.deviation, 0.928, 0.001);
  EXPECT_NEAR(in.features.openings[0].width_mm.deviation, 0, 1e-9);
  EXPECT_NEAR(in.features.openings[0].lean_deg.measured, 30, 1e-9);
  // A lean that leaves an oval within the tolerance is no fault.
  EXPECT_EQ(InspectOpening(Hole(6), Hole(6, 10, 0)).verdict, Verdict::kPass);
}

TEST(OpeningKinds, AnOvalAndASlotThatLookTheSameAreJudgedTheSame) {
  EXPECT_EQ(InspectOpening(Slot(6.93, 6), Hole(6, 30, 0)).verdict, Verdict::kPass);
  EXPECT_EQ(InspectOpening(Slot(6.93, 6, 90), Hole(6, 30, 0)).verdict, Verdict::kFail);
  EXPECT_EQ(InspectOpening(Slot(6.93, 6, 90), Hole(6, 0, 30)).verdict, Verdict::kPass);
  EXPECT_EQ(InspectOpening(Slot(6.93, 6, -45), Hole(6, 22.2, 22.2)).verdict, Verdict::kPass);
}

// A hole counts as radial until its lean is certain: that of a good part failed.
TEST(OpeningKinds, ALeanThatSamplesLeaveOpenIsNotOut) {
  EXPECT_EQ(InspectOpening(Hole(6, 30, 0), Hole(6), false, 25).verdict, Verdict::kUndecided);
  EXPECT_EQ(InspectOpening(Hole(6, 30, 0), Hole(6.6), false, 25).verdict, Verdict::kFail);
  EXPECT_EQ(InspectOpening(Hole(6, 30, 0), Hole(6), false, 5).verdict, Verdict::kFail);
  EXPECT_EQ(InspectOpening(Hole(6, 10, 0), Hole(6), false, 5).verdict, Verdict::kPass);
}

TEST(OpeningKinds, ANamedLeanIsFoundFromBothEnds) {
  for (const bool from_other_end : {false, true}) {
    const Inspection in = InspectOpening(Hole(6, 30, 10), Hole(6.05, 30.4, 9.8), from_other_end);
    EXPECT_EQ(in.verdict, Verdict::kPass) << from_other_end;
    EXPECT_THAT(in.reasons, IsEmpty());
    EXPECT_NEAR(in.features.openings[0].lean_deg.deviation, 0.43, 0.05);
  }
}

}  // namespace
}  // namespace bendloop::pipeline
