// SPDX-License-Identifier: Apache-2.0
#include "pipeline/inspection/inspection.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "pipeline/tube/representations.h"
#include "tests/support/reversed_features.h"
#include "tests/support/synthetic_tube.h"
#include "tests/unit/inspection/sample_parts.h"

namespace bendloop::pipeline {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr double kPipeRadius = 8;
Measurement Measured(const hal::BendProgram& program, double pipe_radius_mm = kPipeRadius) {
  support::Rng rng(7);
  const hal::Pose X_WT = support::RandomPose(rng);
  return support::MeasurementOf({pipe_radius_mm, program, X_WT}, rng);
}

Inspection InspectPart(const hal::BendProgram& bent, const InspectionOptions& options = {}) {
  return Inspect(Measured(bent), kPart, kPipeRadius, options);
}

TEST(Inspection, PassesAPerfectPartInAnyPose) {
  const Inspection inspection = InspectPart(kPart);
  EXPECT_EQ(inspection.verdict, Verdict::kPass);
  EXPECT_THAT(inspection.reasons, IsEmpty());
  EXPECT_EQ(inspection.direction.state, DirectionState::kForward);
  ASSERT_EQ(inspection.rows.size(), 4u);
  EXPECT_EQ(inspection.rows[2].rotation_deg.state, ToleranceState::kIn);
  EXPECT_EQ(inspection.rows[0].rotation_deg.state, ToleranceState::kNotJudged);
  EXPECT_EQ(inspection.rows[3].angle_deg.state, ToleranceState::kNotJudged);
  EXPECT_FALSE(inspection.rows[3].bend_radius_mm.has_value());
  ASSERT_EQ(inspection.envelope.size(), 8u);
  EXPECT_EQ(inspection.envelope[0].name, "start");
  EXPECT_EQ(inspection.envelope[1].name, "bend 1 entry");
  EXPECT_EQ(inspection.envelope[4].name, "bend 2 exit");
  EXPECT_EQ(inspection.envelope[7].name, "end");
  EXPECT_NEAR(inspection.envelope_max_mm, 0, 1e-9);
  EXPECT_EQ(inspection.surface.distance_mm.size(), 400u);
  EXPECT_NEAR(inspection.surface.max_abs_mm, 0, 1e-9);
}

TEST(Inspection, SaysInWordsWhatIsOut) {
  hal::BendProgram bent = kPart;
  bent.rows[2].angle_deg -= 1.2;
  InspectionOptions options;
  options.tolerances.envelope_mm.reset();
  options.tolerances.surface_mm.reset();
  const Inspection inspection = InspectPart(bent, options);
  EXPECT_EQ(inspection.verdict, Verdict::kFail);
  EXPECT_THAT(
      inspection.reasons,
      ElementsAre(
          "bend 3 angle 1.20 degrees below nominal (tolerance 0.50 degrees, 1 sigma 0.02)"));
  EXPECT_NEAR(inspection.rows[2].angle_deg.deviation, -1.2, 1e-12);
  EXPECT_EQ(inspection.rows[2].angle_deg.state, ToleranceState::kOut);
}

TEST(Inspection, JudgesStraightnessAndDentsWhereTheyHaveLimits) {
  Measurement measured = Measured(kPart);
  measured.straights = {{0.1, 0.01, 80}, {0.6, 0.01, 120}, {}, {0.1, 0.01, 150}};
  measured.dents = {{40, 90, 0.5, 0.02, 6, {0, 0, 0}}};
  EXPECT_EQ(Inspect(measured, kPart, kPipeRadius, {}).verdict, Verdict::kPass);
  InspectionOptions options;
  options.tolerances.straightness_mm = 0.4;
  options.tolerances.dent_depth_mm = 1.0;
  const Inspection bowed = Inspect(measured, kPart, kPipeRadius, options);
  EXPECT_EQ(bowed.verdict, Verdict::kFail);
  EXPECT_THAT(bowed.reasons, ElementsAre(HasSubstr("straight 2 is bowed by 0.60 mm")));
  options.tolerances.straightness_mm = 1.0;
  options.tolerances.dent_depth_mm = 0.3;
  const Inspection dented = Inspect(measured, kPart, kPipeRadius, options);
  EXPECT_EQ(dented.verdict, Verdict::kFail);
  EXPECT_THAT(dented.reasons, ElementsAre(HasSubstr("dent at 40 mm along the tube")));
}

InspectionOptions WithHole() {
  InspectionOptions options;
  options.features.openings = {{"hole 1", {40, 90, 6, 6, 0}, false, 0.5, 2.0, 0.3, std::nullopt}};
  return options;
}

TEST(Inspection, JudgesTheHolesThatItFinds) {
  Measurement measured = Measured(kPart);
  const auto segments = hal::SpineSegments(measured.tube.program, measured.tube.X_WT);
  const auto drill = [&](double along_mm, double around_deg, double diameter_mm) {
    const hal::SurfaceFrame frame = hal::FrameAt(segments, along_mm, around_deg);
    measured.features.openings = {{{along_mm, around_deg, diameter_mm, diameter_mm, 0},
                                   {0.02, 0.1, 0.02, 0.02, 0},
                                   frame.spine_mm + kPipeRadius * frame.outward,
                                   frame.tangent}};
  };
  drill(40.1, 90.2, 6.05);
  const Inspection good = Inspect(measured, kPart, kPipeRadius, WithHole());
  EXPECT_EQ(good.verdict, Verdict::kPass);
  ASSERT_EQ(good.features.openings.size(), 1u);
  EXPECT_EQ(good.features.openings[0].state, OpeningState::kFound);
  EXPECT_NEAR(good.features.openings[0].along_mm.deviation, 0.1, 1e-9);
  drill(40.1, 90.2, 6.6);
  const Inspection wide = Inspect(measured, kPart, kPipeRadius, WithHole());
  EXPECT_EQ(wide.verdict, Verdict::kFail);
  EXPECT_THAT(wide.reasons, ElementsAre(HasSubstr("hole 1 diameter 0.60 mm above nominal")));

  // The same tube measured from its other end.
  drill(40.1, 90.2, 6.05);
  Measurement turned = measured;
  turned.tube = ReverseTube(measured.tube);
  turned.sigma = ReverseProgram(measured.sigma);
  OpeningFound& found = turned.features.openings[0];
  hal::TubeFeatures features;
  features.openings = {found.opening};
  found.opening = tests::ReversedFeatures(features, measured.tube).openings.front();
  ASSERT_NEAR(found.opening.around_deg, 89.8, 1e-6) << "counted the other way round";
  // A straight that bows has its wall's axis there, about which that is counted, beside its line.
  found.position_mm += 0.3 * found.direction.cross(Eigen::Vector3d::UnitX());
  const Inspection reversed = Inspect(turned, kPart, kPipeRadius, WithHole());
  EXPECT_EQ(reversed.verdict, Verdict::kPass) << reversed.reasons.size();
  EXPECT_NEAR(reversed.features.openings[0].along_mm.deviation, 0.1, 1e-6);
  EXPECT_NEAR(reversed.features.openings[0].around_deg.deviation, 0.2, 1e-6);
}

TEST(Inspection, FailsWhereAHoleIsMissingAndIsUndecidedWhereNobodyLooked) {
  support::Rng rng(7);
  Measurement seen = support::MeasurementOf({kPipeRadius, kPart, {}}, rng, 20'000);
  const Inspection missing = Inspect(seen, kPart, kPipeRadius, WithHole());
  EXPECT_EQ(missing.features.openings[0].state, OpeningState::kMissing);
  EXPECT_EQ(missing.verdict, Verdict::kFail);
  EXPECT_THAT(missing.reasons, ElementsAre(HasSubstr("hole 1 is missing")));
  // The side of the hole was not scanned.
  const auto frame = hal::FrameAt(hal::SpineSegments(kPart, {}), 40, 90);
  std::erase_if(seen.surface, [&](const SurfaceSample& sample) {
    return (sample.position_mm - frame.spine_mm).dot(frame.outward) > 0 &&
           std::abs((sample.position_mm - frame.spine_mm).dot(frame.tangent)) < 30;
  });
  const Inspection hidden = Inspect(seen, kPart, kPipeRadius, WithHole());
  EXPECT_EQ(hidden.features.openings[0].state, OpeningState::kNotSeen);
  EXPECT_EQ(hidden.verdict, Verdict::kUndecided);
}

TEST(Inspection, JudgesHowEndsAreCut) {
  Measurement measured = Measured(kPart);
  measured.features.last_end = EndCutFound{{2.0, 30}, 0.1, 3, {}, {}, {}};
  EXPECT_EQ(Inspect(measured, kPart, kPipeRadius, {}).verdict, Verdict::kPass);
  InspectionOptions options;
  options.features.obliquity_tolerance_deg = 1.0;
  const Inspection inspection = Inspect(measured, kPart, kPipeRadius, options);
  EXPECT_EQ(inspection.verdict, Verdict::kFail);
  EXPECT_NEAR(inspection.features.last_end.obliquity_deg.deviation, 2.0, 1e-9);
  EXPECT_FALSE(inspection.features.first_end.is_known);
}

TEST(Inspection, IsUndecidedWithinTheUncertaintyOfTheLimit) {
  hal::BendProgram bent = kPart;
  bent.rows[1].angle_deg += 0.49;  // limit 0.5, 1 sigma 0.02
  const Inspection inspection = InspectPart(bent);
  EXPECT_EQ(inspection.verdict, Verdict::kUndecided);
  ASSERT_EQ(inspection.reasons.size(), 1u);
  EXPECT_THAT(inspection.reasons[0], HasSubstr("too close to the tolerance to decide"));
}

// Alarm and status tell the first reason: of a tube that fails not one that says "too close to
// decide".
TEST(Inspection, TellsWhatIsOutBeforeWhatIsUndecided) {
  hal::BendProgram bent = kPart;
  bent.rows[1].angle_deg += 0.49;  // limit 0.5, 1 sigma 0.02
  bent.rows[2].angle_deg += 0.9;
  const Inspection inspection = InspectPart(bent);
  EXPECT_EQ(inspection.verdict, Verdict::kFail);
  ASSERT_GE(inspection.reasons.size(), 2u);
  EXPECT_THAT(inspection.reasons.front(), HasSubstr("bend 3 angle 0.90 degrees above nominal"));
  EXPECT_THAT(inspection.reasons.back(), HasSubstr("too close to the tolerance to decide"));
}

TEST(Inspection, ComparesRotationsTheShortWayRound) {
  hal::BendProgram nominal = kPart;
  nominal.rows[1].rotation_deg = 179.9;
  hal::BendProgram bent = nominal;
  bent.rows[1].rotation_deg = -179.9;
  const Inspection inspection = Inspect(Measured(bent), nominal, kPipeRadius, {});
  EXPECT_NEAR(inspection.rows[1].rotation_deg.deviation, 0.2, 1e-9);
  EXPECT_NEAR(inspection.rows[1].rotation_deg.measured, 180.1, 1e-9);
  EXPECT_EQ(inspection.verdict, Verdict::kPass);
}

TEST(Inspection, DoesNotJudgeTheRotationBesideATinyBend) {
  hal::BendProgram nominal = kPart;
  nominal.rows[1].angle_deg = 1.0;
  hal::BendProgram bent = nominal;
  bent.rows[1].rotation_deg += 2.5;
  bent.rows[2].rotation_deg -= 2.5;
  const Inspection inspection = Inspect(Measured(bent), nominal, kPipeRadius, {});
  EXPECT_EQ(inspection.rows[1].rotation_deg.state, ToleranceState::kNotJudged);
  EXPECT_EQ(inspection.rows[2].rotation_deg.state, ToleranceState::kNotJudged);
  EXPECT_EQ(inspection.verdict, Verdict::kPass);
}

TEST(Inspection, ATubeCutTooLongIsOutInItsEndLengthOnly) {
  hal::BendProgram bent = kPart;
  bent.rows[3].length_mm += 3;
  const Inspection inspection = InspectPart(bent);
  EXPECT_THAT(inspection.reasons,
              ElementsAre(HasSubstr("end length 3.00 mm above nominal (tolerance 0.50 mm")));
  EXPECT_NEAR(inspection.envelope_max_mm, 0, 1e-9);
  EXPECT_NEAR(inspection.surface.max_abs_mm, 0, 1e-9);
  EXPECT_NEAR(inspection.alignment.rms_mm, 0, 1e-9);
}

TEST(Inspection, SurfaceDistancesAreSignedFromTheNominalPipe) {
  const Inspection inspection = Inspect(Measured(kPart, 8.4), kPart, 8.0, {});
  for (const double distance_mm : inspection.surface.distance_mm) {
    EXPECT_NEAR(distance_mm, 0.4, 1e-9);
  }
  EXPECT_NEAR(inspection.surface.rms_mm, 0.4, 1e-9);
  EXPECT_NEAR(inspection.pipe_radius_mm.deviation, 0.4, 1e-12);
}

TEST(Inspection, TheEnvelopeFollowsTheLeverOfAWrongAngle) {
  hal::BendProgram bent = kPart;
  bent.rows[1].angle_deg += 1.0;
  const Inspection inspection = InspectPart(bent);
  // One degree in the middle of a tube of 380 mm: a best fit halves some 3.4 mm of lever.
  EXPECT_GT(inspection.envelope_max_mm, 0.4);
  EXPECT_LT(inspection.envelope_max_mm, 2.5);
  EXPECT_GT(inspection.surface.max_abs_mm, 0.4);
  EXPECT_LT(inspection.surface.max_abs_mm, 2.5);
  for (const EnvelopePoint& point : inspection.envelope) EXPECT_LT(point.sigma_mm, 0.15);
  EXPECT_GT(inspection.envelope.back().sigma_mm, 0.01);
}

TEST(Inspection, OneFlierInAThousandDoesNotFailAPart) {
  Measurement measurement = Measured(kPart);
  measurement.surface[11].position_mm.x() += 30;
  const Inspection inspection = Inspect(measurement, kPart, kPipeRadius, {});
  EXPECT_GT(inspection.surface.max_abs_mm, 5);
  EXPECT_EQ(inspection.surface.state, ToleranceState::kIn);
}

TEST(Inspection, AnotherNumberOfBendsFailsWithoutRows) {
  const Inspection inspection = Inspect(Measured(kU), kPart, kPipeRadius, {});
  EXPECT_EQ(inspection.verdict, Verdict::kFail);
  EXPECT_THAT(inspection.rows, IsEmpty());
  EXPECT_THAT(inspection.reasons, ElementsAre(HasSubstr("measured 2 bends")));
}

TEST(Inspection, ASymmetricPartIsJudgedButNotSettled) {
  const Inspection good = Inspect(Measured(kU), kU, kPipeRadius, {});
  EXPECT_EQ(good.direction.state, DirectionState::kAmbiguous);
  EXPECT_EQ(good.verdict, Verdict::kPass);  // good whichever way round it is
  hal::BendProgram bent = kU;
  bent.rows[0].angle_deg -= 2;
  const Inspection bad = Inspect(Measured(bent), kU, kPipeRadius, {});
  EXPECT_EQ(bad.direction.state, DirectionState::kAmbiguous);
  EXPECT_EQ(bad.verdict, Verdict::kFail);  // bad whichever way round it is
  EXPECT_THAT(bad.reasons.front(), HasSubstr("which end is bent first?"));
}

TEST(Inspection, AMirroredPartFails) {
  hal::BendProgram bent = kPart;
  for (hal::BendRow& row : bent.rows) row.rotation_deg = -row.rotation_deg;
  const Inspection inspection = InspectPart(bent);
  EXPECT_EQ(inspection.direction.state, DirectionState::kMirrored);
  EXPECT_EQ(inspection.verdict, Verdict::kFail);
}

TEST(Inspection, NumbersThatAreNoneNeverPass) {
  Measurement measurement = Measured(kPart);
  measurement.sigma.rows[1].angle_deg = std::numeric_limits<double>::quiet_NaN();
  EXPECT_NE(Inspect(measurement, kPart, kPipeRadius, {}).verdict, Verdict::kPass);
}

TEST(Judge, HasABandOfDoubtAroundTheLimit) {
  EXPECT_EQ(Judge(-0.3, 0.05, 0.5, 2), ToleranceState::kIn);
  EXPECT_EQ(Judge(-0.45, 0.05, 0.5, 2), ToleranceState::kUndecided);
  EXPECT_EQ(Judge(0.55, 0.05, 0.5, 2), ToleranceState::kUndecided);
  EXPECT_EQ(Judge(0.65, 0.05, 0.5, 2), ToleranceState::kOut);
  EXPECT_EQ(Judge(9, 0, std::nullopt, 2), ToleranceState::kNotJudged);
}

}  // namespace
}  // namespace bendloop::pipeline
