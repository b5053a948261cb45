// SPDX-License-Identifier: Apache-2.0
#include "pipeline/correction/correction.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

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

// No noise, no damping: what the formula says and nothing else.
CorrectionOptions Exact() {
  CorrectionOptions options;
  options.decaying_gain = false;
  options.scatter_sigma = {0, 0, 0};
  options.deadband_sigmas = 0;
  return options;
}

Correction MustCorrect(const CorrectionInput& input, const CorrectionOptions& options,
                       const LotState& lot = {}) {
  auto correction = Correct(input, lot, options);
  EXPECT_TRUE(correction) << correction.error().message;
  return correction ? *correction : Correction{};
}

TEST(Correction, AddsTheGainTimesTheDeviationToWhatWasCommanded) {
  CorrectionInput input{kNominal, kNominal, kNominal, {}};
  input.commanded.rows[1].angle_deg = 62;  // an earlier correction
  input.measured.rows[1].angle_deg = 61;
  input.measured.rows[2].length_mm = 59;
  input.measured.rows[2].rotation_deg = -101;
  CorrectionOptions options = Exact();
  options.gain = {0.5, 0.25, 0.8};
  const Correction correction = MustCorrect(input, options);
  EXPECT_NEAR(correction.corrected.rows[1].angle_deg, 62 + 0.8 * (60 - 61), 1e-12);
  EXPECT_NEAR(correction.corrected.rows[2].length_mm, 60 + 0.5 * (60 - 59), 1e-12);
  EXPECT_NEAR(correction.corrected.rows[2].rotation_deg, -100 + 0.25 * (-100 + 101), 1e-12);
  EXPECT_EQ(correction.rows[1].angle_deg.commanded, 62);
  EXPECT_NEAR(correction.rows[1].angle_deg.deviation, -1, 1e-12);
  EXPECT_EQ(correction.rows[1].angle_deg.gain, 0.8);
  EXPECT_TRUE(correction.changes_anything);
  // Everything that was right stays as it is.
  EXPECT_EQ(correction.corrected.rows[0], kNominal.rows[0]);
  EXPECT_EQ(correction.corrected.rows[3], kNominal.rows[3]);
}

TEST(Correction, DividesByTheSlopeOfTheMaterial) {
  CorrectionInput input{kNominal, kNominal, kNominal, {}};
  input.measured.rows[0].angle_deg = 87;
  CorrectionOptions options = Exact();
  options.material = {1.0, 11.0, 0};  // slope 0.9
  const Correction correction = MustCorrect(input, options);
  EXPECT_NEAR(correction.rows[0].angle_deg.applied, 3 / 0.9, 1e-9);
}

TEST(Correction, ShortensStraightsByTheStretchThatALargerAngleWillAdd) {
  CorrectionInput input{kNominal, kNominal, kNominal, {}};
  input.measured.rows[1].angle_deg = 57;
  CorrectionOptions options = Exact();
  options.material.elongation_percent = 4;
  const Correction correction = MustCorrect(input, options);
  const double stretch_mm = 0.02 * 40 * 3 * std::numbers::pi / 180;
  EXPECT_NEAR(correction.rows[1].angle_deg.applied, 3, 1e-9);
  EXPECT_NEAR(correction.rows[1].length_mm.applied, -stretch_mm, 1e-9);
  EXPECT_NEAR(correction.rows[2].length_mm.applied, -stretch_mm, 1e-9);
  EXPECT_NEAR(correction.rows[0].length_mm.applied, 0, 1e-9);
  EXPECT_NEAR(correction.rows[3].length_mm.applied, 0, 1e-9);
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
  EXPECT_NEAR(correction.rows[1].rotation_deg.applied, 3, 1e-9);
  EXPECT_NEAR(correction.corrected.rows[1].rotation_deg, -178, 1e-9);
  EXPECT_THAT(correction.refusals, IsEmpty());
  // The next correction starts from beyond the half turn, and the base is before it.
  input.commanded = correction.corrected;
  input.measured.rows[1].rotation_deg = -179;
  correction = MustCorrect(input, Exact(), correction.next);
  EXPECT_NEAR(correction.rows[1].rotation_deg.applied, -2, 1e-9);
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

TEST(Correction, DoesNothingWithinTheUncertainty) {
  CorrectionInput input{kNominal, kNominal, kNominal,
                        support::ConstantSigma(kNominal, 0.05, 0.05, 0.05)};
  input.measured.rows[0].angle_deg -= 0.09;  // scatter 0.1 and measurement 0.05 are 0.11
  Correction correction = MustCorrect(input, {});
  EXPECT_EQ(correction.corrected, kNominal);
  EXPECT_FALSE(correction.changes_anything);
  EXPECT_EQ(FlagNames(correction.rows[0].angle_deg.flags), "deadband");
  input.measured.rows[0].angle_deg -= 0.1;
  correction = MustCorrect(input, {});
  EXPECT_TRUE(correction.changes_anything);
  EXPECT_EQ(correction.rows[0].angle_deg.flags, 0u);
}

TEST(Correction, ADeviationThatStaysLeavesTheDeadbandAsEvidenceGrows) {
  CorrectionInput input{kNominal, kNominal, kNominal, {}};
  input.measured.rows[0].angle_deg -= 0.08;
  LotState lot;
  int parts = 0;
  for (; parts < 10; ++parts) {
    const Correction correction = MustCorrect(input, {}, lot);
    lot = correction.next;
    if (correction.changes_anything) break;
  }
  EXPECT_GE(parts, 1);
  EXPECT_LE(parts, 3);
}

TEST(Correction, GainDecaysAsPartsAreMeasured) {
  const CorrectionInput input{kNominal, kNominal, kNominal, {}};
  LotState lot;
  std::vector<double> gains;
  for (int i = 0; i < 60; ++i) {
    const Correction correction = MustCorrect(input, {}, lot);
    lot = correction.next;
    gains.push_back(correction.rows[0].angle_deg.gain);
  }
  EXPECT_EQ(lot.parts, 60u);
  EXPECT_NEAR(gains[0], 1.0, 0.01);
  EXPECT_NEAR(gains[1], 0.5, 0.01);
  EXPECT_NEAR(gains[2], 1.0 / 3, 0.01);
  EXPECT_NEAR(gains[59], CorrectionOptions{}.least_gain, 1e-12);
}

TEST(Correction, CutsAStepAndSaysSo) {
  CorrectionInput input{kNominal, kNominal, kNominal, {}};
  input.measured.rows[2].angle_deg -= 8;
  const Correction correction = MustCorrect(input, Exact());
  EXPECT_NEAR(correction.rows[2].angle_deg.wanted, 8, 1e-9);
  EXPECT_NEAR(correction.rows[2].angle_deg.applied, 6, 1e-9);
  EXPECT_EQ(correction.rows[2].angle_deg.flags, kFlagStepLimit);
  EXPECT_FALSE(correction.refused());
  EXPECT_THAT(correction.notices, ElementsAre(HasSubstr("bend 3 angle: a change of 8.00")));
}

TEST(Correction, CutsAStepDownwardsToo) {
  CorrectionInput input{kNominal, kNominal, kNominal, {}};
  input.measured.rows[2].angle_deg += 8;
  EXPECT_NEAR(MustCorrect(input, Exact()).rows[2].angle_deg.applied, -6, 1e-9);
}

TEST(Correction, StatesItsUncertaintyInTheBendersTerms) {
  CorrectionInput input{kNominal, kNominal, kNominal, {}};
  CorrectionOptions options;
  options.decaying_gain = false;
  options.material = {1.0, 11.0, 0};  // slope 0.9: a command moves the bend by less than itself
  EXPECT_NEAR(MustCorrect(input, options).rows[0].angle_deg.sigma, 0.1 / 0.9, 1e-9);
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
  EXPECT_NEAR(correction.rows[1].length_mm.deviation, -1, 1e-12);
  EXPECT_FALSE(correction.changes_anything);
}

TEST(Correction, SaysWhenAPartIsNotLikeItsLot) {
  CorrectionInput input{kNominal, kNominal, kNominal, {}};
  LotState lot;
  for (int i = 0; i < 5; ++i) lot = MustCorrect(input, {}, lot).next;
  input.measured.rows[0].angle_deg -= 3;
  const Correction correction = MustCorrect(input, {}, lot);
  EXPECT_NE(correction.rows[0].angle_deg.flags & kFlagUnexpected, 0u);
  EXPECT_THAT(correction.notices, ElementsAre(HasSubstr("start a new lot")));
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
  lot.rows.pop_back();
  EXPECT_FALSE(Correct(input, lot, {}));
  EXPECT_FALSE(Correct({}, {}, {}));
}

}  // namespace
}  // namespace bendloop::pipeline
