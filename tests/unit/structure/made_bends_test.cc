// SPDX-License-Identifier: Apache-2.0
// What no machine makes: bends without a straight between them or tube beyond them, and bends as
// tight as the pipe is thick.
#include <gtest/gtest.h>

#include <utility>
#include <vector>

#include "hal/spine.h"
#include "pipeline/structure/makeable_bends.h"
#include "pipeline/structure/neighbour_separation.h"

namespace bendloop::pipeline {
namespace {

// Ten samples a millimetre, all along.
SurfaceFit FitOf(hal::BendProgram program) {
  SurfaceFit fit;
  fit.tube.pipe_radius_mm = 5;
  fit.tube.program = std::move(program);
  fit.sigma = fit.tube.program;
  for (hal::BendRow& row : fit.sigma.rows) row = {0.1, 0.1, 0.1, 3.0};
  for (const auto& segment : hal::SpineSegments(fit.tube.program, fit.tube.X_WT)) {
    fit.segment_samples.push_back(10 * segment.length_mm);
  }
  return fit;
}

TEST(MadeBends, AreThoseWithAStraightBetweenThem) {
  EXPECT_EQ(LeastMadeBends(FitOf({{{50, 0, 0, std::nullopt}}})), 0U);
  EXPECT_EQ(LeastMadeBends(FitOf({{{50, 0, 40, 15}, {50, 0, 0, std::nullopt}}})), 1U);
  EXPECT_EQ(LeastMadeBends(FitOf(
                {{{50, 0, 40, 15}, {1, 2, 10, 8}, {2, 4, 30, 15}, {50, 0, 0, std::nullopt}}})),
            1U);
  EXPECT_EQ(LeastMadeBends(FitOf({{{50, 0, 40, 15}, {7, 2, 10, 8}, {50, 0, 0, std::nullopt}}})),
            2U);
}

TEST(MadeBends, HaveTubeBeyondThem) {
  const hal::BendProgram flared = {{{50, 0, 40, 15}, {50, 70, 15, 10}, {5, 0, 0, std::nullopt}}};
  EXPECT_EQ(LeastMadeBends(FitOf(flared)), 1U);
  hal::BendProgram longer = flared;
  longer.rows.back().length_mm = 20;
  EXPECT_EQ(LeastMadeBends(FitOf(longer)), 2U);
  // Two of them, the one upon the other, and one at the other end.
  EXPECT_EQ(LeastMadeBends(FitOf({{{4, 0, 20, 6},
                                   {50, 20, 40, 15},
                                   {50, 70, 15, 10},
                                   {0, 90, 40, 5},
                                   {3, 0, 0, std::nullopt}}})),
            1U);
}

// A joint to a neighbour is as tight as the fit lets it be; so may any bend be for which the form
// of the tube would do as well.
TEST(MadeBends, AreJointsWhereTheFormTellsThemFromWiderOnes) {
  SurfaceFit fit = FitOf({{{100, 0, 60, 15}, {100, 70, 33, 5}, {100, 0, 0, std::nullopt}}});
  SpinePolygon polygon;
  for (const auto& segment : hal::SpineSegments(fit.tube.program, fit.tube.X_WT)) {
    for (double along = 0; along < segment.length_mm; along += 1.0) {
      polygon.push_back({segment.PointAt(along), segment.TangentAt(along)});
    }
  }
  fit.form_mm = 0.01;
  EXPECT_EQ(PiecesBetweenJoints(fit, polygon, false).size(), 2U);
  fit.form_mm = 0.1;
  EXPECT_EQ(PiecesBetweenJoints(fit, polygon, false).size(), 1U);
}

}  // namespace
}  // namespace bendloop::pipeline
