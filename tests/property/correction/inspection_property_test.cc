// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <string>

#include "pipeline/inspection/inspection.h"
#include "pipeline/tube/representations.h"
#include "tests/property/correction/test_bender.h"

namespace bendloop::pipeline {
namespace {

using support::Rng;

// The same tube fed from its other end and moved elsewhere, samples and all.
Measurement Reversed(Measurement measurement) {
  measurement.tube = ReverseTube(measurement.tube);
  measurement.sigma = ReverseProgram(measurement.sigma);
  return measurement;
}

Measurement Moved(Measurement measurement, const hal::Pose& X_VW) {
  measurement.tube.X_WT = X_VW * measurement.tube.X_WT;
  for (SurfaceSample& sample : measurement.surface) sample.position_mm = X_VW * sample.position_mm;
  return measurement;
}

void ExpectSame(const Inspection& a, const Inspection& b) {
  ASSERT_EQ(a.rows.size(), b.rows.size());
  for (std::size_t i = 0; i < a.rows.size(); ++i) {
    EXPECT_NEAR(a.rows[i].length_mm.deviation, b.rows[i].length_mm.deviation, 1e-9);
    EXPECT_NEAR(a.rows[i].rotation_deg.deviation, b.rows[i].rotation_deg.deviation, 1e-9);
    EXPECT_NEAR(a.rows[i].angle_deg.deviation, b.rows[i].angle_deg.deviation, 1e-9);
    EXPECT_EQ(a.rows[i].angle_deg.state, b.rows[i].angle_deg.state);
    EXPECT_EQ(a.rows[i].length_mm.sigma, b.rows[i].length_mm.sigma);
  }
  ASSERT_EQ(a.envelope.size(), b.envelope.size());
  for (std::size_t i = 0; i < a.envelope.size(); ++i) {
    EXPECT_EQ(a.envelope[i].name, b.envelope[i].name);
    EXPECT_NEAR(a.envelope[i].distance_mm, b.envelope[i].distance_mm, 1e-6);
    EXPECT_NEAR(a.envelope[i].sigma_mm, b.envelope[i].sigma_mm, 1e-6);
  }
  ASSERT_EQ(a.surface.distance_mm.size(), b.surface.distance_mm.size());
  for (std::size_t i = 0; i < a.surface.distance_mm.size(); ++i) {
    EXPECT_NEAR(a.surface.distance_mm[i], b.surface.distance_mm[i], 1e-6);
  }
  EXPECT_EQ(a.verdict, b.verdict);
  EXPECT_EQ(a.reasons, b.reasons);
}

class InspectionProperty : public ::testing::Test {
 protected:
  // A nominal and a part bent from it, not corrected yet.
  void Make(std::uint64_t seed) {
    Rng rng(seed);
    nominal = support::RandomProgram(rng, 2 + static_cast<int>(seed % 7));
    support::TestBender bender;
    bender.Detune(rng, nominal.rows.size(), 0.5, 1.0, 0.5);
    measurement = support::MeasurementOf({8.0, bender.Bend(nominal, rng), support::RandomPose(rng)},
                                         rng, 100, 0.03);
    motion = support::RandomPose(rng);
  }
  Inspection Look(const Measurement& of) const { return Inspect(of, nominal, 8.0, {}); }

  hal::BendProgram nominal;
  Measurement measurement;
  hal::Pose motion;
};

TEST_F(InspectionProperty, IsTheSameFromEitherEndAndInAnyPose) {
  int held = 0;
  for (std::uint64_t seed = 1; seed <= 200; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    Make(seed);
    const Inspection there = Look(measurement);
    held += !there.direction.settled();
    if (there.direction.settled()) {
      EXPECT_EQ(there.direction.state, DirectionState::kForward);
      EXPECT_EQ(Look(Reversed(measurement)).direction.state, DirectionState::kReverse);
    }
    const Inspection moved = Look(Moved(measurement, motion));
    const Inspection reversed = Look(Reversed(Moved(measurement, motion)));
    ExpectSame(there, moved);
    if (there.direction.settled()) ExpectSame(there, reversed);
  }
  // Random parts are not symmetric: a matcher that asks too often is as useless as a wrong one.
  EXPECT_LE(held, 2);
}

TEST_F(InspectionProperty, AMirroredPartIsNeverTakenForThePart) {
  for (std::uint64_t seed = 1; seed <= 200; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    Make(seed);
    Measurement mirrored = measurement;
    double turned = 0;
    for (hal::BendRow& row : mirrored.tube.program.rows) {
      turned = std::max(turned, std::abs(hal::WrapRotationDeg(2 * row.rotation_deg)));
      row.rotation_deg = -row.rotation_deg;
    }
    if (turned < 20) continue;  // nearly flat: both hands are the same
    EXPECT_NE(Look(mirrored).verdict, Verdict::kPass);
    EXPECT_EQ(Look(mirrored).direction.state, DirectionState::kMirrored);
    EXPECT_EQ(Look(Reversed(mirrored)).direction.state, DirectionState::kMirrored);
  }
}

TEST_F(InspectionProperty, ASymmetricPartIsAlwaysHeldUntilItIsSettled) {
  for (std::uint64_t seed = 1; seed <= 200; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    Rng rng(seed);
    // A palindrome: the second half repeats the first backwards.
    hal::BendProgram program = support::RandomProgram(rng, 1 + static_cast<int>(seed % 8));
    const hal::BendProgram turned = ReverseProgram(program);
    const std::size_t bends = program.bend_count();
    for (std::size_t i = 0; i <= bends; ++i) {
      hal::BendRow& row = program.rows[i];
      if (2 * i > bends) row.length_mm = turned.rows[i].length_mm;
      if (i < bends && 2 * i + 1 > bends) row.angle_deg = turned.rows[i].angle_deg;
      if (i > 0 && i < bends && 2 * i > bends) row.rotation_deg = turned.rows[i].rotation_deg;
    }
    support::TestBender bender;
    const hal::BendProgram bent = bender.Bend(program, rng);
    DirectionOptions options;
    EXPECT_EQ(MatchDirection(program, bent, {}, options).state, DirectionState::kAmbiguous);
    options.choice = DirectionChoice::kReverse;
    EXPECT_EQ(MatchDirection(program, bent, {}, options).state, DirectionState::kReverse);
  }
}

}  // namespace
}  // namespace bendloop::pipeline
