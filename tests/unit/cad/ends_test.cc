// SPDX-License-Identifier: Apache-2.0
// Ends that are more than a cut: notched, pressed flat, reduced; a bead near one.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <BRepBuilderAPI_MakeEdge.hxx>
#include <BRepBuilderAPI_MakeFace.hxx>
#include <BRepBuilderAPI_MakeWire.hxx>
#include <BRepBuilderAPI_NurbsConvert.hxx>
#include <BRepOffsetAPI_ThruSections.hxx>
#include <BRepPrimAPI_MakeCone.hxx>
#include <BRepPrimAPI_MakePrism.hxx>
#include <BRepPrimAPI_MakeTorus.hxx>
#include <TopoDS_Wire.hxx>
#include <gp_Circ.hxx>
#include <numbers>

#include "made_files.h"
#include "run_nominal.h"

namespace bendloop::host {
namespace {

using test::Nominal;
using test::Pipe;
using ::testing::HasSubstr;
using ::testing::Not;

hal::Tube Bow(double pipe_radius_mm) {
  hal::Tube tube;
  tube.pipe_radius_mm = pipe_radius_mm;
  tube.program = {{{100, 0, 90, 30.0}, {80, 0, 0, std::nullopt}}};
  return tube;
}

// Across x, `wide_mm` by `high_mm`, its narrow sides round.
TopoDS_Wire Slot(double x_mm, double wide_mm, double high_mm) {
  const double r = high_mm / 2, y = wide_mm / 2 - r;
  const gp_Pnt a(x_mm, -y, r), b(x_mm, y, r), c(x_mm, y, -r), d(x_mm, -y, -r);
  const auto round = [&](double at_y, const gp_Pnt& from, const gp_Pnt& to) {
    return BRepBuilderAPI_MakeEdge(gp_Circ(gp_Ax2({x_mm, at_y, 0}, {-1, 0, 0}), r), from, to)
        .Edge();
  };
  return BRepBuilderAPI_MakeWire(BRepBuilderAPI_MakeEdge(a, b).Edge(), round(y, b, c),
                                 BRepBuilderAPI_MakeEdge(c, d).Edge(), round(-y, d, a))
      .Wire();
}

TEST(Ends, ANotchIsTold) {
  // Half of the first 15 mm is cut away, and 5 mm more under a corner.
  const auto notched = Nominal(test::WriteStepFile(
      {{"notched", test::Cut(test::Drilled(Pipe(Bow(8)), {-1, 8, 0}, {15, 8, 0}, 7), {4, 0, 0},
                             {-1, 0, 0})}}));
  hal::BendProgram expected = Bow(8).program;
  expected.rows[0].length_mm = 96;
  test::ExpectRows(notched, expected);
  // Its longest side is the bend's outside.
  EXPECT_THAT(notched.out, HasSubstr("first end: cut to a shape that is no plane; the length is up "
                                     "to its farthest point about 90 degrees around, the tube "
                                     "is whole all around up to"));
  EXPECT_THAT(notched.out, Not(HasSubstr("the plain tube ends")));
}

// Pressed flat at its first end to 22 by 4 mm, along y, for 65 mm.
TopoDS_Shape Pressed() {
  BRepOffsetAPI_ThruSections loft(true);
  const gp_Circ round(gp_Ax2({0, 0, 0}, {1, 0, 0}), 8);
  loft.AddWire(BRepBuilderAPI_MakeWire(BRepBuilderAPI_MakeEdge(round).Edge()).Wire());
  loft.AddWire(Slot(-45, 22, 4));
  const TopoDS_Shape flat =
      BRepPrimAPI_MakePrism(BRepBuilderAPI_MakeFace(Slot(-45, 22, 4)).Face(), gp_Vec(-20, 0, 0))
          .Shape();
  return test::Joined(test::Joined(Pipe(Bow(8), {.wall_mm = 0}), loft.Shape()), flat);
}

TEST(Ends, PressedFlatTheyCountToTheLength) {
  const auto done = Nominal(test::WriteStepFile({{"pressed", Pressed()}}));
  hal::BendProgram longer = Bow(8).program;
  longer.rows[0].length_mm += 65;
  test::ExpectRows(done, longer);
  EXPECT_THAT(done.out, HasSubstr("the first end has a form of its own (B-spline surface), up to "
                                  "whose end the length counts\n"));
  EXPECT_THAT(Nominal(test::TemporaryFile("made.step"), {"--reverse"}).out,
              HasSubstr("the last end has a form of its own (B-spline surface)"));
}

TEST(Ends, HolesInTheirFormAreTold) {
  // 10 mm from the end, through the flat; another one into it from above, off the middle.
  TopoDS_Shape drilled = test::Drilled(Pressed(), {-55, 0, -9}, {-55, 0, 9}, 3);
  drilled = test::Drilled(drilled, {-50, 6, 0.5}, {-50, 6, 9}, 1);
  const auto done = Nominal(test::WriteStepFile({{"pressed", drilled}}));
  const auto bore = [](const std::string& what) {
    return "a bore of " + what.substr(0, 5) + " mm goes across the form of the first end at " +
           what.substr(6) + " mm of the developed length, towards ";
  };
  EXPECT_THAT(done.out, HasSubstr(bore("6.000 10.0") + "0 and 180 degrees around"));
  EXPECT_THAT(done.out, HasSubstr(bore("2.000 15.0") + "0 degrees around: the part file does not"));
  EXPECT_THAT(Nominal(test::TemporaryFile("made.step"), {"--reverse"}).out,
              HasSubstr("across the form of the last end at 282.1 mm of the developed length"));
}

TEST(Ends, HowFlatTheyAreIsTold) {
  const auto done = Nominal(test::WriteStepFile({{"pressed", Pressed()}}));
  EXPECT_THAT(done.out, HasSubstr(" 1 bend, "));
  EXPECT_THAT(done.out,
              HasSubstr("first end: pressed flat to 22.000 by 4.000 mm, its wide way at 90.00 "
                        "degrees around; the plain tube ends 65.000 mm before it\n"));
  ASSERT_EQ(done.code, 0) << done.err;
  EXPECT_NEAR(done.json["ends"][0]["pressed_flat"]["thick_mm"].get<double>(), 4, 1e-6);
  EXPECT_TRUE(done.json["ends"][1]["pressed_flat"].is_null());
}

TEST(Ends, AReducerMakesTwoTubes) {
  gp_Trsf turn, away;
  turn.SetRotation(gp_Ax1({}, {0, 0, 1}), std::numbers::pi);
  away.SetTranslation({-15, 0, 0});
  const TopoDS_Shape thin = Pipe(Bow(7), {.wall_mm = 0}).Moved(TopLoc_Location(away * turn));
  const TopoDS_Shape cone = BRepPrimAPI_MakeCone(gp_Ax2({0, 0, 0}, {-1, 0, 0}), 10, 7, 15).Shape();
  const auto file = test::WriteStepFile(
      {{"line", test::Joined(test::Joined(Pipe(Bow(10), {.wall_mm = 0}), cone), thin)}});
  const auto both = Nominal(file);
  EXPECT_EQ(both.code, 2) << both.out;
  EXPECT_THAT(both.err, HasSubstr("parts of one tube that changes its diameter"));
  const auto thick = Nominal(file, {"--body", "1"});
  hal::BendProgram longer = Bow(10).program;  // up to the cone's end
  longer.rows[0].length_mm += 15;
  test::ExpectRows(thick, longer);
  EXPECT_THAT(thick.out, HasSubstr("it goes on with a diameter of 14.000 mm (a reducer)"));
}

TEST(Ends, BeadsAndPlanesByAnyName) {
  const TopoDS_Shape bead = BRepPrimAPI_MakeTorus(gp_Ax2({12, 0, 0}, {1, 0, 0}), 10, 1).Shape();
  const TopoDS_Shape shape = test::Joined(Pipe(Bow(10), {.wall_mm = 0}), bead);
  for (const TopoDS_Shape& beaded : {shape, BRepBuilderAPI_NurbsConvert(shape, true).Shape()}) {
    const auto done = Nominal(test::WriteStepFile({{"beaded", beaded}}));
    test::ExpectRows(done, Bow(10).program, 1e-5);
    EXPECT_THAT(done.out, HasSubstr("first end: square\n"));
    // Its middle lies 12 mm after the first end, in the file at the origin.
    EXPECT_THAT(done.out, HasSubstr("a gap of 2.000 mm between faces of a straight at 12.0 mm of "
                                    "the developed length is taken as tube; what is there reaches "
                                    "22.0 mm in diameter (a bead, a nut)"));
    EXPECT_THAT(Nominal(test::TemporaryFile("made.step"), {"--reverse"}).out,
                HasSubstr("of a straight at 215.1 mm"));
    EXPECT_THAT(done.out, Not(HasSubstr("a form of its own")));
  }
}

}  // namespace
}  // namespace bendloop::host
