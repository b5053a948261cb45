// SPDX-License-Identifier: Apache-2.0
#include "pipeline/correction/interlocks.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>
#include <limits>

#include "tests/support/synthetic_tube.h"

namespace bendloop::pipeline {
namespace {

using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
const hal::BendProgram kPart{
    {{80, 0, 90, 40.0}, {120, 45, 60, 40.0}, {60, -100, 30, 40.0}, {150, 0, 0, std::nullopt}}};

InterlockInput Good() {
  InterlockInput input;
  input.nominal_bends = 3;
  input.direction = MatchDirection(kPart, kPart, {}, {});
  input.measured = kPart;
  input.sigma = support::ConstantSigma(kPart, 0.02, 0.02, 0.02);
  input.coverage = 0.97;
  input.longest_gap_mm = 20;
  input.fit.samples = 10000;
  input.fit.rms_distance_mm = 0.05;
  input.pipe_radius_mm = 8.02;
  input.nominal_pipe_radius_mm = 8.0;
  input.profiles = 1000;
  input.session_age_s = 3;
  input.correction = *Correct({kPart, kPart, kPart, {}}, {}, {});
  input.bent_with = {17, 4, kPart, 0xABCD};
  input.bender = BenderFacts{{}, input.bent_with};
  input.bender->state.mode = hal::BenderMode::kIdle;
  input.bender->state.active_part_number = 17;
  input.bender->state.active_sequence = 4;
  return input;
}

TEST(Interlocks, AGoodRunPassesEveryCheck) {
  const InterlockReport report = CheckInterlocks(Good(), {});
  EXPECT_TRUE(report.passed());
  EXPECT_THAT(report.refusals(), IsEmpty());
  EXPECT_EQ(report.checks.size(), 15u);
  for (const Interlock& check : report.checks) EXPECT_TRUE(check.passed) << check.sentence;
}

struct Fault {
  const char* name;
  InterlockKind kind;
  std::function<void(InterlockInput&)> make;
  const char* words;
};

class EachInterlock : public ::testing::TestWithParam<Fault> {};

// Each fires on its own fault, says it, and on nothing else.
TEST_P(EachInterlock, FiresAlone) {
  InterlockInput input = Good();
  GetParam().make(input);
  const InterlockReport report = CheckInterlocks(input, {});
  EXPECT_FALSE(report.passed());
  int failed = 0;
  for (const Interlock& check : report.checks) {
    if (check.passed) continue;
    ++failed;
    EXPECT_EQ(check.kind, GetParam().kind) << check.sentence;
    EXPECT_THAT(check.sentence, HasSubstr(GetParam().words));
  }
  EXPECT_EQ(failed, 1);
}

const Fault kFaults[] = {
    {"Bends", InterlockKind::kBendCount,
     [](InterlockInput& in) {
       in.nominal_bends = 4;
       in.direction.state = DirectionState::kWrongBends;
     },
     "measured 3 bends, the nominal has 4"},
    {"Direction", InterlockKind::kDirection,
     [](InterlockInput& in) {
       in.direction.state = DirectionState::kAmbiguous;
       in.direction.message = "which end?";
     },
     "which end?"},
    {"Coverage", InterlockKind::kCoverage, [](InterlockInput& in) { in.coverage = 0.62; },
     "covers 62.0 % of the tube, at least 90.0 %"},
    {"CoverageUnknown", InterlockKind::kCoverage, [](InterlockInput& in) { in.coverage = kNan; },
     "covers"},
    {"Gap", InterlockKind::kGap, [](InterlockInput& in) { in.longest_gap_mm = 75; },
     "75.0 mm, limit 60.0 mm"},
    {"Fit", InterlockKind::kFit, [](InterlockInput& in) { in.fit.rms_distance_mm = 0.5; },
     "0.500 mm rms off the fitted tube, limit 0.300"},
    {"NoSamples", InterlockKind::kFit, [](InterlockInput& in) { in.fit.samples = 0; }, "0 samples"},
    {"Moved", InterlockKind::kPasses,
     [](InterlockInput& in) {
       in.passes = {{500, {0.5, 0, 0}, {0, 0, 0}}, {700, {-0.5, 0, 0}, {0, 0, 0.01}}};
     },
     "1.000 mm and 0.010 degrees beside the others, limit 0.424 mm and 0.170 degrees: the tube was "
     "moved while it was scanned"},
    {"Turned", InterlockKind::kPasses,
     [](InterlockInput& in) {
       in.passes = {
           {500, {0, 0, 0}, {0, 0, 0}}, {0, {9, 9, 9}, {0, 0, 0}}, {700, {0, 0, 0}, {0.2, 0, 0}}};
     },
     "0.200 degrees beside the others"},
    {"PipeRadius", InterlockKind::kPipeRadius, [](InterlockInput& in) { in.pipe_radius_mm = 16; },
     "diameter entered as radius"},
    {"Units", InterlockKind::kPipeRadius, [](InterlockInput& in) { in.pipe_radius_mm = 8000; },
     "check the units"},
    {"LostProfiles", InterlockKind::kLostProfiles,
     [](InterlockInput& in) { in.profiles_lost = 100; }, "100 profiles lost"},
    {"NoCorrection", InterlockKind::kCorrection, [](InterlockInput& in) { in.correction.reset(); },
     "there is no correction"},
    {"CorrectionTooLarge", InterlockKind::kCorrection,
     [](InterlockInput& in) {
       in.correction.emplace().refusals = {"bend 2 angle: 13 degrees, limit 12"};
     },
     "correction of bend 2 angle: 13 degrees, limit 12"},
    {"Stale", InterlockKind::kStaleSession, [](InterlockInput& in) { in.session_age_s = 4000; },
     "4000 s ago, limit 600 s"},
    {"FromTheFuture", InterlockKind::kStaleSession,
     [](InterlockInput& in) { in.session_age_s = -5; }, "-5 s ago"},
    {"Used", InterlockKind::kUsedSession, [](InterlockInput& in) { in.session_used = true; },
     "already led to a committed program"},
    {"BenderFault", InterlockKind::kBenderReady,
     [](InterlockInput& in) {
       in.bender->state.mode = hal::BenderMode::kFault;
       in.bender->state.fault_code = 31;
     },
     "in fault (code 31)"},
    {"BenderBending", InterlockKind::kBenderReady,
     [](InterlockInput& in) { in.bender->state.mode = hal::BenderMode::kBending; },
     "wait for the end of the cycle"},
    {"BenderNotReady", InterlockKind::kBenderReady,
     [](InterlockInput& in) { in.bender->state.mode = hal::BenderMode::kNotReady; }, "not ready"},
    {"OtherPart", InterlockKind::kActiveProgram,
     [](InterlockInput& in) {
       in.bender->active.part_number = in.bender->state.active_part_number = 18;
     },
     "the active program is part 18 sequence 4, this part was bent with part 17 sequence 4"},
    {"OtherSequence", InterlockKind::kActiveProgram,
     [](InterlockInput& in) { in.bender->active.sequence = in.bender->state.active_sequence = 5; },
     "sequence 5"},
    {"EditedAtThePanel", InterlockKind::kActiveProgram,
     [](InterlockInput& in) { in.bender->active.program.rows[1].angle_deg += 0.5; },
     "the rows differ"},
    {"StateContradictsProgram", InterlockKind::kActiveProgram,
     [](InterlockInput& in) { in.bender->state.active_sequence = 5; }, "its state says"},
};
INSTANTIATE_TEST_SUITE_P(Faults, EachInterlock, ::testing::ValuesIn(kFaults),
                         [](const auto& fault) { return std::string(fault.param.name); });

TEST(Interlocks, PassesThatDriftAreToldAndHoldNothing) {
  InterlockInput input = Good();
  input.passes = {{500, {0.1, 0.1, 0}, {0, 0, 0}}, {700, {-0.1, 0, 0}, {0, 0, 0}}};
  const InterlockReport report = CheckInterlocks(input, {});
  EXPECT_TRUE(report.passed());
  EXPECT_EQ(report.checks.size(), 16u);
}

TEST(Interlocks, ReportEveryFailureNotJustTheFirst) {
  InterlockInput input = Good();
  for (const Fault& fault : kFaults) fault.make(input);
  EXPECT_GE(CheckInterlocks(input, {}).refusals().size(), 12u);
}

TEST(Interlocks, ABenderThatDoesNotAnswerIsNotReady) {
  InterlockInput input = Good();
  input.bender.reset();
  EXPECT_EQ(CheckInterlocks(input, {}).refusals().size(), 2u);
}

TEST(Interlocks, ARunThatSendsNothingNeedsNoBender) {
  InterlockInput input = Good();
  input.bender.reset();
  input.correction.reset();
  input.sends = false;
  EXPECT_TRUE(CheckInterlocks(input, {}).passed());
}

TEST(Interlocks, ARowThatIsNotKnownIsHeldByItself) {
  struct Case {
    InterlockKind kind;
    void (*spoil)(hal::BendProgram&);
    const char* says;
  };
  for (const Case& one :
       {Case{InterlockKind::kUncertaintyLength,
             [](hal::BendProgram& sigma) { sigma.rows[3].length_mm = 0.7; },
             "end length is known to 0.700 mm"},
        Case{InterlockKind::kUncertaintyRotation,
             [](hal::BendProgram& sigma) { sigma.rows[2].rotation_deg = 2; },
             "bend 3 rotation is known to 2.000 degrees"},
        Case{InterlockKind::kUncertaintyAngle,
             [](hal::BendProgram& sigma) { sigma.rows[1].angle_deg = 0.25; },
             "bend 2 angle is known to 0.250 degrees (1 sigma, the worst angle), limit 0.200"},
        Case{InterlockKind::kUncertaintyAngle,
             [](hal::BendProgram& sigma) { sigma.rows[0].angle_deg = kNan; }, "bend 1 angle"}}) {
    InterlockInput input = Good();
    one.spoil(input.sigma);
    const InterlockReport report = CheckInterlocks(input, {});
    EXPECT_TRUE(report.passed()) << one.says;
    for (const Interlock& check : report.checks) {
      if (check.kind != one.kind) continue;
      EXPECT_THAT(check.sentence, HasSubstr(one.says));
      EXPECT_THAT(check.sentence, HasSubstr("held by itself"));
    }
  }
}

TEST(Interlocks, ATubeOfWhichNothingIsKnownIsRefused) {
  InterlockInput input = Good();
  input.sigma = support::ConstantSigma(kPart, 2, 2, 2);
  EXPECT_EQ(CheckInterlocks(input, {}).refusals().size(), 3u);
}

TEST(Interlocks, RefuseWithoutAnyUncertainty) {
  InterlockInput input = Good();
  input.sigma = {};
  EXPECT_EQ(CheckInterlocks(input, {}).refusals().size(), 3u);
}

TEST(Interlocks, DoNotAskForRotationsBesideTinyBends) {
  InterlockInput input = Good();
  input.measured.rows[1].angle_deg = 0.5;
  input.sigma.rows[1].rotation_deg = input.sigma.rows[2].rotation_deg = 20;
  EXPECT_TRUE(CheckInterlocks(input, {}).passed());
}

TEST(Interlocks, NothingIsNotGoodEnough) {
  EXPECT_FALSE(InterlockReport{}.passed());
  EXPECT_FALSE(CheckInterlocks({}, {}).passed());
}

}  // namespace
}  // namespace bendloop::pipeline
