// SPDX-License-Identifier: Apache-2.0
#include "pipeline/inspection/direction.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>

#include "pipeline/tube/representations.h"
#include "tests/unit/inspection/sample_parts.h"

namespace bendloop::pipeline {
namespace {

using ::testing::HasSubstr;

hal::BendProgram Mirror(hal::BendProgram program) {
  for (hal::BendRow& row : program.rows) row.rotation_deg = -row.rotation_deg;
  return program;
}

DirectionMatch Match(const hal::BendProgram& nominal, const hal::BendProgram& measured,
                     DirectionChoice choice = DirectionChoice::kAuto) {
  DirectionOptions options;
  options.choice = choice;
  return MatchDirection(nominal, measured, {}, options);
}

TEST(Direction, IsFoundFromEitherEnd) {
  EXPECT_EQ(Match(kPart, kPart).state, DirectionState::kForward);
  const DirectionMatch reverse = Match(kPart, ReverseProgram(kPart));
  EXPECT_EQ(reverse.state, DirectionState::kReverse);
  EXPECT_TRUE(reverse.reversed);
  EXPECT_TRUE(reverse.settled());
  EXPECT_NEAR(reverse.reverse.residual_mm, 0, 1e-9);
}

TEST(Direction, IsFoundThroughUncorrectedSpringbackAndStretch) {
  hal::BendProgram bent = kPart;
  for (hal::BendRow& row : bent.rows) {
    row.length_mm += 1.5;
    if (row.angle_deg > 0) row.angle_deg -= 1 + 0.03 * row.angle_deg;
  }
  EXPECT_EQ(Match(kPart, bent).state, DirectionState::kForward);
  EXPECT_EQ(Match(kPart, ReverseProgram(bent)).state, DirectionState::kReverse);
}

TEST(Direction, OfASymmetricPartIsHeldWithAQuestion) {
  const DirectionMatch match = Match(kU, kU);
  EXPECT_EQ(match.state, DirectionState::kAmbiguous);
  EXPECT_FALSE(match.settled());
  EXPECT_THAT(match.message, HasSubstr("which end is bent first?"));
}

TEST(Direction, OfANearlySymmetricPartIsHeldEvenWhenOneWayFitsBetter) {
  hal::BendProgram nearly = kU;
  nearly.rows[0].angle_deg = 88;  // 2 degrees are within what springback may do
  EXPECT_EQ(Match(nearly, nearly).state, DirectionState::kAmbiguous);
  EXPECT_EQ(Match(nearly, ReverseProgram(nearly)).state, DirectionState::kAmbiguous);
}

TEST(Direction, IsSettledByTheCellFile) {
  EXPECT_EQ(Match(kU, kU, DirectionChoice::kForward).state, DirectionState::kForward);
  const DirectionMatch reverse = Match(kU, kU, DirectionChoice::kReverse);
  EXPECT_EQ(reverse.state, DirectionState::kReverse);
  EXPECT_TRUE(reverse.reversed);
}

TEST(Direction, ThatContradictsTheCellFileIsRefused) {
  const DirectionMatch match = Match(kPart, ReverseProgram(kPart), DirectionChoice::kForward);
  EXPECT_EQ(match.state, DirectionState::kNoMatch);
  EXPECT_THAT(match.message, HasSubstr("the cell's direction says the other end"));
}

TEST(Direction, OfAStraightTubeDoesNotMatter) {
  const hal::BendProgram straight{{{300, 0, 0, std::nullopt}}};
  EXPECT_EQ(Match(straight, straight).state, DirectionState::kForward);
}

TEST(Direction, KnowsTheWrongHand) {
  for (const hal::BendProgram& measured : {Mirror(kPart), ReverseProgram(Mirror(kPart))}) {
    const DirectionMatch match = Match(kPart, measured);
    EXPECT_EQ(match.state, DirectionState::kMirrored);
    EXPECT_THAT(match.message, HasSubstr("mirror image"));
  }
}

TEST(Direction, OfAFlatPartHasNoHand) {
  hal::BendProgram flat = kPart;
  flat.rows[1].rotation_deg = 180;
  flat.rows[2].rotation_deg = 0;
  EXPECT_EQ(Match(flat, Mirror(flat)).state, DirectionState::kForward);
}

// Springback may leave a part ten degrees off its nominal, no process thirty.
TEST(Direction, RefusesAPartWithOneBendOfAnotherAngle) {
  for (const double off_deg : {-30.0, 30.0}) {
    for (const std::size_t bend : {std::size_t{0}, std::size_t{1}, std::size_t{2}}) {
      hal::BendProgram other = kPart;
      other.rows[bend].angle_deg += off_deg;
      if (other.rows[bend].angle_deg < 1) continue;
      EXPECT_EQ(Match(kPart, other).state, DirectionState::kNoMatch) << bend << ' ' << off_deg;
      other.rows[bend].angle_deg = kPart.rows[bend].angle_deg + off_deg / 3;
      EXPECT_EQ(Match(kPart, other).state, DirectionState::kForward) << bend << ' ' << off_deg;
    }
  }
}

TEST(Direction, RefusesAnotherPart) {
  hal::BendProgram other = kPart;
  other.rows[1].length_mm += 40;
  const DirectionMatch match = Match(kPart, other);
  EXPECT_EQ(match.state, DirectionState::kNoMatch);
  EXPECT_THAT(match.message, HasSubstr("this is not the part: row 2"));
}

TEST(Direction, RefusesAnotherNumberOfBends) {
  const DirectionMatch match = Match(kPart, kU);
  EXPECT_EQ(match.state, DirectionState::kWrongBends);
  EXPECT_THAT(match.message, HasSubstr("measured 2 bends, the nominal has 3"));
  EXPECT_EQ(Match({}, {}).state, DirectionState::kWrongBends);
}

TEST(Direction, IgnoresRotationsBetweenBendsTooSmallToHaveOne) {
  hal::BendProgram nominal = kPart;
  nominal.rows[1].angle_deg = 0.3;
  hal::BendProgram measured = nominal;
  measured.rows[1].rotation_deg = -120;
  measured.rows[2].rotation_deg = 65;
  EXPECT_EQ(Match(nominal, measured).state, DirectionState::kForward);
}

TEST(Direction, NeverMatchesNumbersThatAreNone) {
  hal::BendProgram broken = kPart;
  broken.rows[0].angle_deg = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(Match(kPart, broken).settled());
}

}  // namespace
}  // namespace bendloop::pipeline
