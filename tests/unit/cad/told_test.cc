// SPDX-License-Identifier: Apache-2.0
// What is told of a tube beside its rows: its name, where it lies, and what is odd about its bends.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <BRepAdaptor_Surface.hxx>
#include <BRepPrimAPI_MakeCylinder.hxx>
#include <TopExp_Explorer.hxx>
#include <TopoDS.hxx>
#include <TopoDS_Face.hxx>
#include <cmath>
#include <fstream>
#include <gp_Pln.hxx>
#include <string>

#include "foreign_files.h"
#include "made_files.h"
#include "run_nominal.h"
#include "step_text.h"

namespace bendloop::host {
namespace {

using test::Nominal;
using test::Outcome;
using test::StepStyle;
using ::testing::ContainsRegex;
using ::testing::HasSubstr;
using ::testing::Not;

Outcome Told(const hal::Tube& tube, const StepStyle& style = {}) {
  const std::string file = test::TemporaryFile("bracket left.step");
  std::ofstream(file) << test::StepText(tube, style);
  return Nominal(file);
}

hal::Tube WithRadii(double first_mm, double second_mm) {
  hal::Tube tube;
  tube.pipe_radius_mm = 9.5;
  tube.program = {{{100, 0, 107, first_mm}, {60, 70, 45, second_mm}, {80, 0, 0, std::nullopt}}};
  return tube;
}

TEST(Told, WhatHasNoNameIsCalledAsTheFile) {
  for (const char* name : {"None", "NONE", "", " "}) {
    SCOPED_TRACE(name);
    StepStyle style;
    style.name = name;
    const auto done = Told(test::DemoTube(), style);
    ASSERT_TRUE(done.part) << done.err;
    EXPECT_EQ(done.part->name, "bracket left");
    EXPECT_THAT(done.out, HasSubstr("bracket left: 10.000 mm"));
    EXPECT_EQ(done.json["body"].get<std::string>(), name);
  }
  EXPECT_EQ(Told(test::DemoTube()).part->name, "tube");
}

TEST(Told, WhereTheFirstEndLies) {
  hal::Tube tube = test::DemoTube();
  tube.X_WT.position_mm = {12.5, -3, 1e-9};
  EXPECT_THAT(Told(tube).out,
              HasSubstr("the first end lies at x 12.500, y -3.000, z 0.000 mm of the file\n"));
}

// The fit of a B-spline leaves 39.9999987 of a bend of 40 mm.
TEST(Told, BendRadiiOfSplinesHaveTheDecimalsTheyHad) {
  StepStyle style;
  style.surfaces = test::SurfaceStyle::kRational;
  style.faces = test::FaceStyle::kHalves;
  for (const int digits : {10, 15}) {
    SCOPED_TRACE(digits);
    style.digits = digits;
    const auto done = Told(WithRadii(40, 57.15), style);
    ASSERT_EQ(done.code, 0) << done.err;
    EXPECT_EQ(done.part->rows.rows[0].bend_radius_mm, 40.0);
    EXPECT_EQ(done.part->rows.rows[1].bend_radius_mm, 57.15);
    EXPECT_EQ(done.part->pipe_radius_mm, 9.5);
  }
  // Near ones keep what is told of how far off they lie.
  style.surfaces = test::SurfaceStyle::kPolynomial;
  style.span_deg = 90;
  style.digits = 15;
  const auto near = Told(WithRadii(40, 57.15), style);
  ASSERT_TRUE(near.part) << near.err;
  EXPECT_NEAR(near.part->rows.rows[0].bend_radius_mm.value_or(0), 40, 0.02);
  EXPECT_NE(near.part->rows.rows[0].bend_radius_mm, 40.0);
  // A torus says what it is.
  style.surfaces = test::SurfaceStyle::kAnalytic;
  const auto exact = Told(WithRadii(39.9999987, 57.1500013), style);
  ASSERT_TRUE(exact.part) << exact.err;
  EXPECT_EQ(exact.part->rows.rows[0].bend_radius_mm, 39.9999987);
  EXPECT_EQ(exact.part->rows.rows[1].bend_radius_mm, 57.1500013);
}

TEST(Told, HolesInABend) {
  hal::Tube tube = WithRadii(40, 40);
  tube.program = {{{100, 0, 90, 40.0}, {80, 0, 0, std::nullopt}}};
  // 45 degrees into the bend, along its normal; and on the straight before it.
  const double x = 100 + 40 * std::sqrt(0.5), y = 40 - 40 * std::sqrt(0.5);
  TopoDS_Shape shape = test::Drilled(test::Pipe(tube), {x, y, 0}, {x, y, 30}, 2);
  shape = test::Drilled(shape, {50, 0, 0}, {50, 0, 30}, 2);
  const auto done = Nominal(test::WriteStepFile({{"tube", shape}}));
  EXPECT_THAT(done.out, HasSubstr("hole of 4.000 mm at 131.416 mm of the developed length (in bend "
                                  "1), 0.00 degrees around"));
  EXPECT_THAT(done.out, HasSubstr("at 50.000 mm of the developed length, 0.00 degrees around"));
  ASSERT_EQ(done.json["openings"].size(), 2U);
  EXPECT_FALSE(done.json["openings"][0].contains("in_bend"));
  EXPECT_EQ(done.json["openings"][1]["in_bend"].dump(), "1");
}

TEST(Told, BendsThatXyzCannotCarry) {
  hal::Tube hook = test::DemoTube();
  hook.program.rows[0].angle_deg = 185;
  EXPECT_THAT(Told(hook).out, HasSubstr("bend 1 turns by 185.000 degrees: XYZ cannot carry 180 and "
                                        "more, LRA and YBC can"));
  EXPECT_THAT(Told(test::DemoTube()).out, Not(HasSubstr("XYZ")));
}

TEST(Told, BendsThatAClampHasNoRoomBetween) {
  // 40, 0 and 80 mm lie between them.
  EXPECT_THAT(Told(test::DemoTube()).out,
              HasSubstr("\nless straight than a pipe diameter, for a clamp between, have bends 2 "
                        "and 3\n"));
  EXPECT_THAT(Told(WithRadii(40, 40)).out, Not(HasSubstr("clamp")));
}

TEST(Told, BendsThatAreTighterThanBendersMakeThem) {
  EXPECT_THAT(Told(WithRadii(16, 40)).out,
              HasSubstr("\ntighter than a pipe diameter, as few benders make them, are bends 1 "
                        "(16.000 mm)\n"));
  EXPECT_THAT(Told(WithRadii(20, 40)).out, Not(HasSubstr("tighter")));
}

TEST(Told, BendsThatAreRatherBows) {
  EXPECT_THAT(Told(WithRadii(40, 1000)).out,
              HasSubstr("bend 2 is rather a bow: its radius is 1000.000 mm, over 45.000 degrees"));
  EXPECT_THAT(Told(WithRadii(40, 900)).out, Not(HasSubstr("bow")));
}

TEST(Told, ThatThePartFileIsWritten) {
  EXPECT_EQ(Told(test::DemoTube()).err, "wrote " + test::TemporaryFile("part.toml") + "\n");
}

TEST(Told, WhereItBendsAsNoArc) {
  const auto hose = Nominal(test::WriteStepFile({{"hose", test::SplineHose(5)}}));
  EXPECT_EQ(hose.code, 3);
  EXPECT_THAT(hose.err, ContainsRegex("about x [0-9.]+, y [0-9.]+, z [0-9.]+\\s+mm"));
  // It goes on after 40 mm of straight, at the origin.
  const TopoDS_Shape spline = test::SplineHose(5);
  gp_Dir back;
  for (TopExp_Explorer at(spline, TopAbs_FACE); at.More(); at.Next()) {
    const BRepAdaptor_Surface face(TopoDS::Face(at.Current()));
    if (face.GetType() != GeomAbs_Plane || face.Plane().Distance(gp_Pnt()) > 1e-6) continue;
    back = face.Plane().Axis().Direction();
    if (back.X() > 0) back.Reverse();
  }
  const TopoDS_Shape straight = BRepPrimAPI_MakeCylinder(gp_Ax2({}, back), 5, 40).Shape();
  const auto line = Nominal(test::WriteStepFile({{"line", test::Joined(spline, straight)}}));
  EXPECT_EQ(line.code, 3);
  EXPECT_THAT(line.err, HasSubstr("'line': "));
  EXPECT_THAT(line.err, HasSubstr("x 0.0, y 0.0, z 0.0"));
}

// However near they come to arcs: the rows are a fit's, as their odd decimals show.
TEST(Told, BendsThatAreFittedByArcsAreToldWithHowFarOff) {
  const hal::Tube tube = WithRadii(30, 30);
  for (const int places : {7, 15}) {
    const auto fitted = Nominal(test::WriteStepFile({{"fitted", test::SplineBends(tube, places)}}));
    ASSERT_EQ(fitted.code, 0) << fitted.err;
    test::ExpectRows(fitted, tube.program, 0.05);
    EXPECT_THAT(fitted.out,
                ContainsRegex("its (bends are B-splines, fitted by arcs that they lie up "
                              "to|B-splines lie up to) 0.0[0-9]+ mm off"));
  }
  EXPECT_THAT(Told(tube).out, Not(HasSubstr("B-spline")));
}

}  // namespace
}  // namespace bendloop::host
