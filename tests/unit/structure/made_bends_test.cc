// SPDX-License-Identifier: Apache-2.0
// What no machine makes: bends without a straight between them or tube beyond them, and bends as
// tight as the pipe is thick.
#include <gtest/gtest.h>

#include <utility>
#include <vector>

#include "hal/spine.h"
#include "pipeline/spline/arc_line_spline.h"
#include "pipeline/structure/bows.h"
#include "pipeline/structure/makeable_bends.h"
#include "pipeline/structure/neighbour_separation.h"
#include "pipeline/structure/structure_moves.h"

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

// Samples of a clamp lie as far off a bend as those of a nut do, but no nut is where it leads to.
TEST(MadeBends, AreThoseThatLeadAwayFromTheTubesAxis) {
  const auto is_dropped = [](const hal::BendProgram& program) {
    SurfaceFit fit = FitOf(program);
    fit.sigma_mm = 0.05;
    fit.segment_mean_square_mm2.assign(fit.segment_samples.size(), 0.01);
    fit.segment_mean_square_mm2[3] = fit.segment_mean_square_mm2[4] = 1.0;
    ArcLineSpline spline = SplineFromTube(fit.tube);
    return DropUnexplained(spline, fit);
  };
  EXPECT_TRUE(is_dropped({{{50, 0, 40, 15}, {50, 70, 20, 10}, {6, 0, 0, std::nullopt}}}));
  EXPECT_FALSE(is_dropped({{{50, 0, 40, 15}, {50, 70, 40, 25}, {14, 0, 0, std::nullopt}}}));
}

// Beside another bend no straight tells a bow from a slight bend: one that is wider than a die is
// a bow where it turns by no more than bows do.
TEST(MadeBends, TurnByMoreThanBowsDo) {
  const auto bow = [](double angle_deg) {
    SurfaceFit fit = FitOf(
        {{{50, 0, 40, 15}, {50, -50, angle_deg, 270}, {0, 150, 6, 20}, {50, 0, 0, std::nullopt}}});
    return FindBow(fit, {}, 1.0, {}, 0.5);
  };
  EXPECT_EQ(bow(4.3), std::nullopt);
  EXPECT_EQ(bow(2.0), 1U);
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
