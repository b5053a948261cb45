// SPDX-License-Identifier: Apache-2.0
#include "pipeline/correction/correction.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>

#include "tests/support/synthetic_tube.h"

namespace bendloop::pipeline {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

const hal::BendProgram kNominal{
    {{80, 0, 90, 40.0}, {120, 175, 60, 40.0}, {60, -100, 30, 40.0}, {150, 0, 0, std::nullopt}}};

// No noise, and no coil that the values share: each is off by itself, and one part shows it.
CorrectionOptions Exact() {
  CorrectionOptions options;
  options.scatter_sigma = {0, 0, 0};
  options.deadband_sigmas = 0;
  options.filter.first_coil_constant_deg = 0;
  options.filter.first_coil_slope_deg = 0;
  options.filter.first_coil_stretch_percent = 0;
  return options;
}

Correction MustCorrect(const CorrectionInput& input, const CorrectionOptions& options,
                       const LotState& lot = {}) {
  auto correction = Correct(input, lot, options);
  EXPECT_TRUE(correction) << correction.error().message;
  return correction ? *correction : Correction{};
}

TEST(Correction, MakesItsPartOfTheChangeThatTakesTheDeviationAway) {
  CorrectionInput input{kNominal, kNominal, kNominal, {}};
  input.commanded.rows[1].angle_deg = 62;  // an earlier correction
  input.measured.rows[1].angle_deg = 61;
  input.measured.rows[2].length_mm = 59;
  input.measured.rows[2].rotation_deg = -101;
  CorrectionOptions options = Exact();
  options.gain = {0.5, 0.25, 0.8};
  const Correction correction = MustCorrect(input, options);
  EXPECT_NEAR(correction.corrected.rows[1].angle_deg, 62 + 0.8 * (60 - 61), 1e-6);
  EXPECT_NEAR(correction.corrected.rows[2].length_mm, 60 + 0.5 * (60 - 59), 1e-6);
  EXPECT_NEAR(correction.corrected.rows[2].rotation_deg, -100 + 0.25 * (-100 + 101), 1e-6);
  EXPECT_EQ(correction.rows[1].angle_deg.commanded, 62);
  EXPECT_NEAR(correction.rows[1].angle_deg.deviation, -1, 1e-6);
  EXPECT_NEAR(correction.rows[1].angle_deg.gain, 1, 1e-6);  // nothing is left open
  EXPECT_TRUE(correction.changes_anything);
  // Everything that was right stays as it is.
  EXPECT_NEAR(correction.corrected.rows[0].angle_deg, kNominal.rows[0].angle_deg, 1e-6);
  EXPECT_NEAR(correction.corrected.rows[3].length_mm, kNominal.rows[3].length_mm, 1e-6);
}

TEST(Correction, DividesByTheSlopeOfTheMaterial) {
  CorrectionInput input{kNominal, kNominal, kNominal, {}};
  input.measured.rows[0].angle_deg = 87;
  CorrectionOptions options = Exact();
  options.material = {1.0, 11.0, 0};  // slope 0.9
  const Correction correction = MustCorrect(input, options);
  EXPECT_NEAR(correction.rows[0].angle_deg.applied, 3 / 0.9, 1e-6);
}

TEST(Correction, ShortensStraightsByTheStretchThatALargerAngleWillAdd) {
  CorrectionInput input{kNominal, kNominal, kNominal, {}};
  input.measured.rows[1].angle_deg = 57;
  CorrectionOptions options = Exact();
  options.material.elongation_percent = 4;
  const Correction correction = MustCorrect(input, options);
  const double stretch_mm = 0.02 * 40 * 3 * std::numbers::pi / 180;
  EXPECT_NEAR(correction.rows[1].angle_deg.applied, 3, 1e-6);
  EXPECT_NEAR(correction.rows[1].length_mm.applied, -stretch_mm, 1e-6);
  EXPECT_NEAR(correction.rows[2].length_mm.applied, -stretch_mm, 1e-6);
  EXPECT_NEAR(correction.rows[0].length_mm.applied, 0, 1e-6);
  EXPECT_NEAR(correction.rows[3].length_mm.applied, 0, 1e-6);
}

TEST(Correction, NeverTouchesRowsRadiiAndTheFirstRotation) {
  CorrectionInput input{kNominal, kNominal, kNominal, {}};
  input.commanded.rows[0].rotation_deg = 33;  // how the setter clamps it
  for (hal::BendRow& row : input.measured.rows) {
    row.angle_deg -= row.angle_deg > 0 ? 1 : 0;
    if (row.bend_radius_mm) row.bend_radius_mm = 41.0;
  }
  input.measured.rows[0].rotation_deg = 5;
  const Correction correction = MustCorrect(input, Exact());
  ASSERT_EQ(correction.corrected.rows.size(), 4u);
  EXPECT_EQ(correction.corrected.rows[0].rotation_deg, 33);
  EXPECT_EQ(correction.rows[0].rotation_deg.flags, kFlagNotCorrected);
  for (int i = 0; i < 3; ++i) EXPECT_EQ(correction.corrected.rows[i].bend_radius_mm, 40.0);
  EXPECT_FALSE(correction.corrected.rows[3].bend_radius_mm.has_value());
  EXPECT_EQ(correction.corrected.rows[3].angle_deg, 0);
  EXPECT_EQ(correction.corrected.rows[3].rotation_deg, 0);
}

TEST(Correction, RotatesTheShortWayRoundAndWraps) {
  CorrectionInput input{kNominal, kNominal, kNominal, {}};
  input.nominal.rows[1].rotation_deg = input.commanded.rows[1].rotation_deg = 179;
  input.measured.rows[1].rotation_deg = 176;
  Correction correction = MustCorrect(input, Exact());
  EXPECT_NEAR(correction.rows[1].rotation_deg.applied, 3, 1e-6);
  EXPECT_NEAR(correction.corrected.rows[1].rotation_deg, -178, 1e-6);
  EXPECT_THAT(correction.refusals, IsEmpty());
  // The next correction starts from beyond the half turn, and the base is before it.
  input.commanded = correction.corrected;
  input.measured.rows[1].rotation_deg = -179;
  correction = MustCorrect(input, Exact(), StartLot(input.nominal, input.nominal, Exact()));
  EXPECT_NEAR(correction.rows[1].rotation_deg.applied, -2, 1e-6);
  EXPECT_THAT(correction.refusals, IsEmpty());
}

TEST(Correction, LeavesTheRotationBesideATinyBendAlone) {
  CorrectionInput input{kNominal, kNominal, kNominal, {}};
  input.nominal.rows[1].angle_deg = input.measured.rows[1].angle_deg = 1;
  input.commanded.rows[1].angle_deg = 1;
  input.measured.rows[1].rotation_deg = 120;
  input.measured.rows[2].rotation_deg = -60;
  const Correction correction = MustCorrect(input, Exact());
  EXPECT_EQ(correction.rows[1].rotation_deg.flags, kFlagNoMeaning);
  EXPECT_EQ(correction.rows[2].rotation_deg.flags, kFlagNoMeaning);
  EXPECT_FALSE(correction.changes_anything);
}

TEST(Correction, ASmallChangeIsLeftAloneAndALargerOneNever) {
  CorrectionInput input{kNominal, kNominal, kNominal,
                        support::ConstantSigma(kNominal, 0.05, 0.05, 0.05)};
  input.measured.rows[0].angle_deg -= 0.009;  // a tenth of the scatter is 0.01
  Correction correction = MustCorrect(input, {});
  EXPECT_EQ(correction.corrected.rows[0], kNominal.rows[0]);
  EXPECT_EQ(FlagNames(correction.rows[0].angle_deg.flags), "deadband");
  input.measured.rows[0].angle_deg -= 0.09;
  correction = MustCorrect(input, {});
  EXPECT_TRUE(correction.changes_anything);
  EXPECT_EQ(correction.rows[0].angle_deg.flags, 0u);
}

// However wide a cell file makes the deadband.
TEST(Correction, NoDeadbandLeavesARowOutOfTolerance) {
  CorrectionInput input{kNominal, kNominal, kNominal,
                        support::ConstantSigma(kNominal, 0.05, 0.05, 0.05)};
  CorrectionOptions options;
  options.deadband_sigmas = 10;
  LotState lot;
  for (int part = 0; part < 3; ++part) {
    input.measured = input.commanded;
    input.measured.rows[0].angle_deg -= 0.566;
    const Correction correction = MustCorrect(input, options, lot);
    lot = correction.next;
    input.commanded = correction.corrected;
  }
  EXPECT_NEAR(input.commanded.rows[0].angle_deg, kNominal.rows[0].angle_deg + 0.566, 0.03);
}

TEST(Correction, WhatIsOpenFallsAsPartsAreMeasured) {
  const CorrectionInput input{kNominal, kNominal, kNominal, {}};
  LotState lot;
  std::vector<double> gains;
  for (int i = 0; i < 30; ++i) {
    const Correction correction = MustCorrect(input, {}, lot);
    lot = correction.next;
    gains.push_back(correction.rows[0].angle_deg.gain);
  }
  EXPECT_EQ(lot.parts, 30u);
  EXPECT_GT(gains[0], 0.9);
  EXPECT_GT(gains[1], 0.3);
  EXPECT_LT(gains[29], 0.2);
}

TEST(Correction, ARowThatIsNotKnownIsHeldByItself) {
  CorrectionInput input{kNominal, kNominal, kNominal,
                        support::ConstantSigma(kNominal, 0.03, 0.03, 0.02)};
  input.sigma.rows[3].length_mm = 0.4;
  for (hal::BendRow& row : input.measured.rows) row.length_mm += 1;
  const Correction correction = MustCorrect(input, {});
  EXPECT_EQ(correction.rows[3].length_mm.flags, kFlagUncertain);
  EXPECT_EQ(correction.corrected.rows[3].length_mm, kNominal.rows[3].length_mm);
  EXPECT_NEAR(correction.rows[0].length_mm.applied, -1, 0.1);
  EXPECT_NEAR(correction.rows[1].length_mm.applied, -1, 0.1);
  EXPECT_FALSE(correction.refused());
  EXPECT_THAT(correction.notices, ElementsAre(HasSubstr("end length is known to 0.4")));
  // Two such parts are as good as one that is known to 0.28.
  EXPECT_EQ(MustCorrect(input, {}, correction.next).rows[3].length_mm.flags, 0u);
}

// An angle and a length that the scan hardly tells apart: what was seen of both together counts.
TEST(Correction, ValuesThatTradeAreCorrectedTogether) {
  CorrectionInput input{kNominal, kNominal, kNominal,
                        support::ConstantSigma(kNominal, 0.03, 0.03, 0.02)};
  input.sigma.rows[2].length_mm = 1.0;
  input.sigma.rows[2].angle_deg = 0.6;
  input.measured.rows[2].length_mm += 1.0;
  input.measured.rows[2].angle_deg -= 0.6;  // as an error of the scan would have it
  CorrectionOptions options;
  options.hold_sigma = {9, 9, 9};
  const LotState lot = StartLot(kNominal, kNominal, options);
  const double alone = MustCorrect(input, options, lot).rows[2].angle_deg.wanted;
  input.correlations = {{{2, RowValueKind::kLength}, {2, RowValueKind::kAngle}, -0.99}};
  const double as_error = MustCorrect(input, options, lot).rows[2].angle_deg.wanted;
  input.measured.rows[2].length_mm = kNominal.rows[2].length_mm - 1.0;  // as none would
  const double as_fact = MustCorrect(input, options, lot).rows[2].angle_deg.wanted;
  EXPECT_LT(std::abs(as_error), std::abs(alone));
  EXPECT_GT(std::abs(as_fact), std::abs(alone));
}

TEST(Correction, AHeldLotIsLearntFromAndChangesNothing) {
  CorrectionInput input{kNominal, kNominal, kNominal, {}};
  input.measured.rows[0].angle_deg -= 1;
  LotState lot;
  lot.held = true;
  const Correction correction = MustCorrect(input, {}, lot);
  EXPECT_FALSE(correction.changes_anything);
  EXPECT_NE(correction.rows[0].angle_deg.flags & kFlagLotHeld, 0u);
  EXPECT_EQ(correction.next.parts, 1u);
  EXPECT_THAT(correction.notices, ElementsAre(HasSubstr("the lot is held")));
}

TEST(Correction, ForecastsTheNextTube) {
  CorrectionInput input{kNominal, kNominal, kNominal,
                        support::ConstantSigma(kNominal, 0.03, 0.03, 0.02)};
  LotState lot;
  CorrectionOptions options;
  for (int i = 0; i < 20; ++i) lot = MustCorrect(input, options, lot).next;
  const Forecast wide = MustCorrect(input, options, lot).forecast;
  ASSERT_EQ(wide.rows.size(), 4u);
  EXPECT_GT(wide.part, 0.9);
  EXPECT_LE(wide.part, wide.rows[0].angle_deg);
  EXPECT_EQ(wide.rows[0].rotation_deg, 1);  // not judged
  options.tolerance = {0.05, 0.05, 0.05};
  EXPECT_LT(MustCorrect(input, options, lot).forecast.part, wide.part);
}

TEST(Correction, CutsAStepAndSaysSo) {
  CorrectionInput input{kNominal, kNominal, kNominal, {}};
  input.measured.rows[2].angle_deg -= 8;
  const Correction correction = MustCorrect(input, Exact());
  EXPECT_NEAR(correction.rows[2].angle_deg.wanted, 8, 1e-6);
  EXPECT_NEAR(correction.rows[2].angle_deg.applied, 6, 1e-6);
  EXPECT_EQ(correction.rows[2].angle_deg.flags, kFlagStepLimit);
  EXPECT_FALSE(correction.refused());
  EXPECT_THAT(correction.notices, ElementsAre(HasSubstr("bend 3 angle: a change of 8.00")));
}

TEST(Correction, CutsAStepDownwardsToo) {
  CorrectionInput input{kNominal, kNominal, kNominal, {}};
  input.measured.rows[2].angle_deg += 8;
  EXPECT_NEAR(MustCorrect(input, Exact()).rows[2].angle_deg.applied, -6, 1e-6);
}

TEST(Correction, StatesItsUncertaintyInTheBendersTerms) {
  CorrectionInput input{kNominal, kNominal, kNominal, {}};
  CorrectionOptions options;
  const double flat = MustCorrect(input, options).rows[0].angle_deg.sigma;
  options.material = {1.0, 11.0, 0};  // slope 0.9: a command moves the bend by less than itself
  const LotState lot = StartLot(kNominal, *InitialProgram(kNominal, options.material), options);
  input.commanded = *InitialProgram(kNominal, options.material);
  EXPECT_NEAR(MustCorrect(input, options, lot).rows[0].angle_deg.sigma, flat / 0.9, 0.005);
}

TEST(Correction, RefusesToLeaveTheLotsBaseByMoreThanTheTotal) {
  CorrectionInput input{kNominal, kNominal, kNominal, {}};
  LotState lot = StartLot(kNominal, kNominal, Exact());
  input.commanded.rows[2].angle_deg = 40;  // ten degrees on the way already
  input.measured.rows[2].angle_deg = 27;
  const Correction correction = MustCorrect(input, Exact(), lot);
  EXPECT_TRUE(correction.refused());
  EXPECT_NE(correction.rows[2].angle_deg.flags & kFlagTotalLimit, 0u);
  EXPECT_THAT(correction.refusals,
              ElementsAre(AllOf(HasSubstr("bend 3 angle"), HasSubstr("13.00 degrees"),
                                HasSubstr("limit 12.00"))));
}

TEST(Correction, AStraightOfLengthZeroStaysAtZero) {
  CorrectionInput input{kNominal, kNominal, kNominal, {}};
  input.nominal.rows[1].length_mm = input.commanded.rows[1].length_mm = 0;
  input.measured.rows[1].length_mm = 0.4;
  const Correction correction = MustCorrect(input, Exact());
  EXPECT_EQ(correction.corrected.rows[1].length_mm, 0);
  EXPECT_NE(correction.rows[1].length_mm.flags & kFlagAtZero, 0u);
  EXPECT_FALSE(correction.refused());
}

TEST(Correction, RefusesImpossibleLengthsAndAngles) {
  CorrectionInput input{kNominal, kNominal, kNominal, {}};
  input.nominal.rows[1].length_mm = input.commanded.rows[1].length_mm = 1;
  input.measured.rows[1].length_mm = 3;
  input.nominal.rows[2].angle_deg = input.commanded.rows[2].angle_deg = 3;
  input.measured.rows[2].angle_deg = 7;
  const Correction correction = MustCorrect(input, Exact());
  EXPECT_THAT(correction.refusals,
              ElementsAre(HasSubstr("bend 3 angle"), HasSubstr("length before bend 2")));
}

TEST(Correction, AnAxisWithoutGainIsReportedAndKept) {
  CorrectionInput input{kNominal, kNominal, kNominal, {}};
  for (hal::BendRow& row : input.measured.rows) row.length_mm += 1;
  CorrectionOptions options = Exact();
  options.gain.length_mm = 0;
  const Correction correction = MustCorrect(input, options);
  EXPECT_EQ(correction.rows[1].length_mm.flags, kFlagNotCorrected);
  EXPECT_NEAR(correction.rows[1].length_mm.deviation, -1, 1e-6);
  EXPECT_FALSE(correction.changes_anything);
}

// Parts of a lot that was right so far, with the first angle off by so much from here on.
struct AfterwardsOff {
  LotState lot;
  CorrectionInput input{kNominal, kNominal, kNominal,
                        support::ConstantSigma(kNominal, 0.03, 0.03, 0.02)};

  AfterwardsOff() {
    for (int i = 0; i < 6; ++i) lot = MustCorrect(input, {}, lot).next;
  }
  Correction Next(double off_deg) {
    input.measured = input.commanded;
    input.measured.rows[0].angle_deg += off_deg;
    const Correction correction = MustCorrect(input, {}, lot);
    lot = correction.next;
    input.commanded = correction.corrected;
    return correction;
  }
};

TEST(Correction, ASlippedTubeIsSaidAndMovesNothing) {
  AfterwardsOff lot;
  const Correction slipped = lot.Next(-1.5);
  EXPECT_NE(slipped.rows[0].angle_deg.flags & kFlagUnexpected, 0u);
  EXPECT_THAT(slipped.notices, ElementsAre(HasSubstr("bend 1 angle: far off")));
  EXPECT_NEAR(lot.input.commanded.rows[0].angle_deg, 90, 0.1);
  const Correction next = lot.Next(0);
  EXPECT_THAT(next.notices, ElementsAre(HasSubstr("the tube before slipped (bend 1 angle)")));
  EXPECT_NEAR(lot.input.commanded.rows[0].angle_deg, 90, 0.1);
}

TEST(Correction, AJumpIsFollowedWithTheSecondPartOfIt) {
  AfterwardsOff lot;
  lot.Next(-1.0);
  EXPECT_NEAR(lot.input.commanded.rows[0].angle_deg, 90, 0.1);
  const Correction second = lot.Next(-1.0);
  EXPECT_THAT(second.notices, ElementsAre(HasSubstr("jump")));
  EXPECT_NEAR(lot.input.commanded.rows[0].angle_deg, 91, 0.15);
}

TEST(Correction, ANextLotKeepsWhatIsEachBendsOwn) {
  AfterwardsOff first;
  for (int i = 0; i < 6; ++i) first.Next(-0.3);  // the bend's own tool
  const LotState lot = NextLot(first.lot, first.input.commanded, {});
  EXPECT_EQ(lot.number, 2u);
  EXPECT_EQ(lot.parts, 0u);
  EXPECT_EQ(lot.base, first.input.commanded);
  // A coil that springs back by half a degree more: the first part shows it in all bends, and none
  // of them is taken for the scatter of one.
  CorrectionInput input = first.input;
  input.measured = kNominal;
  for (int i = 0; i < 3; ++i) input.measured.rows[i].angle_deg -= 0.5;
  const Correction correction = MustCorrect(input, {}, lot);
  for (int i = 0; i < 3; ++i) {
    EXPECT_NEAR(correction.rows[i].angle_deg.applied, 0.5, 0.08) << i;
  }
}

TEST(Correction, RefusesShapesAndNumbersThatCannotBeCompared) {
  CorrectionInput input{kNominal, kNominal, kNominal, {}};
  input.measured.rows.pop_back();
  auto correction = Correct(input, {}, {});
  ASSERT_FALSE(correction);
  EXPECT_EQ(correction.error().kind, hal::ErrorKind::kBadInput);
  EXPECT_THAT(correction.error().message, HasSubstr("the measured tube has 3 rows, the nominal 4"));
  input.measured = kNominal;
  input.measured.rows[1].angle_deg = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(Correct(input, {}, {}));
  input.measured = kNominal;
  LotState lot = StartLot(kNominal, kNominal, {});
  lot.hypotheses[0].mean.pop_back();
  EXPECT_FALSE(Correct(input, lot, {}));
  EXPECT_FALSE(Correct({}, {}, {}));
}

}  // namespace
}  // namespace bendloop::pipeline
