// SPDX-License-Identifier: Apache-2.0
// Where a tube's pieces meet: a little beside each other, askew, at borders that lean.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <BRepPrimAPI_MakeCylinder.hxx>
#include <BRep_Builder.hxx>
#include <TopoDS_Compound.hxx>
#include <cmath>
#include <fstream>
#include <numbers>
#include <string>

#include "made_files.h"
#include "run_nominal.h"
#include "step_text.h"

namespace bendloop::host {
namespace {

using test::DemoTube;
using test::Nominal;
using test::Outcome;
using test::StepStyle;
using ::testing::HasSubstr;
using ::testing::Not;

Outcome Joint(const StepStyle& style, const std::vector<std::string>& words = {}) {
  const std::string file = test::TemporaryFile("joint.step");
  std::ofstream(file) << test::StepText(DemoTube(), style);
  return Nominal(file, words);
}

// The pipe radius is 5 mm, so that axes 0.06 mm apart are one by the way they lie.
TEST(Joints, PiecesThatShareTheirBorderAreOneTube) {
  StepStyle style;
  style.wall_mm = 0;
  style.off = {0.2, 0.3, true};
  for (const test::BodyStyle body : {test::BodyStyle::kSolid, test::BodyStyle::kOpenShell}) {
    SCOPED_TRACE(int(body));
    style.body = body;
    const auto done = Joint(style);
    test::ExpectRows(done, DemoTube().program, 0.002);
    EXPECT_THAT(done.out, HasSubstr("straights and bends meet at up to 0.300 degrees"));
    EXPECT_THAT(done.out, HasSubstr("meet up to 0.200 mm beside each other"));
    EXPECT_THAT(Joint(style, {"--list"}).out, Not(HasSubstr("\n     2 ")));
  }
  style.body = test::BodyStyle::kSolid;
  style.off = {0.01, 0.9, true};
  EXPECT_THAT(Joint(style).out, HasSubstr("straights and bends meet at up to 0.900 degrees"));
  style.off = {0.01, 1.2, true};
  const auto kinked = Joint(style);
  EXPECT_EQ(kinked.code, 3);
  EXPECT_THAT(kinked.err, HasSubstr("straights meet in a kink of 1.200 degrees"));
}

hal::Tube Bow8() {
  hal::Tube tube;
  tube.pipe_radius_mm = 8;
  tube.program = {{{100, 0, 90, 30.0}, {80, 0, 0, std::nullopt}}};
  return tube;
}

TEST(Joints, WhatGoesOnBesideAnEndIsTold) {
  const TopoDS_Shape bar = test::Pipe(Bow8(), {.wall_mm = 0});
  // Its last end lies at (130, 110, 0) and points along y.
  for (const double length_mm : {50.0, 12.0}) {
    SCOPED_TRACE(length_mm);
    const TopoDS_Shape on =
        BRepPrimAPI_MakeCylinder(gp_Ax2({132, 110, 0}, {0, 1, 0}), 8, length_mm).Shape();
    TopoDS_Compound both;
    BRep_Builder builder;
    builder.MakeCompound(both);
    for (const TopoDS_Shape& shape : {bar, on}) builder.Add(both, test::LooseFaces(shape));
    const std::string file = test::WriteStepFile({{"bar", both}});
    const std::string what = std::to_string(int(length_mm)) +
                             ".000 mm of the same diameter begin 2.000 mm beside and 0.000 mm "
                             "beyond its ";
    EXPECT_THAT(Nominal(file).out, HasSubstr(what + "last end, at 0.000 degrees to it: not in the "
                                                    "rows"));
    EXPECT_THAT(Nominal(file, {"--reverse"}).out, HasSubstr(what + "first end"));
  }
}

TEST(Joints, StraightTubesOfTheSameBodyAreCounted) {
  const TopoDS_Shape plate =
      BRepPrimAPI_MakeCylinder(gp_Ax2({50, 0, 50}, {0, 0, -1}), 4, 60).Shape();
  const TopoDS_Shape rod = BRepPrimAPI_MakeCylinder(gp_Ax2({0, 0, 50}, {1, 0, 0}), 8, 100).Shape();
  const auto done = Nominal(test::WriteStepFile(
      {{"rack", test::Joined(test::Joined(test::Pipe(Bow8(), {.wall_mm = 0}), plate), rod)}}));
  test::ExpectRows(done, Bow8().program);
  EXPECT_THAT(done.out, HasSubstr("straight tubes in the same body, left out (--list): "));
}

TEST(Joints, AnEndIsSquareToItsOwnStraight) {
  StepStyle style;
  style.off = {0, 0.1, false};
  const auto done = Joint(style);
  test::ExpectRows(done, DemoTube().program, 1e-3);
  EXPECT_THAT(done.out, HasSubstr("first end: square\nlast end: square\n"));
  EXPECT_THAT(done.out, HasSubstr("straights and bends meet at up to 0.100 degrees"));
}

TEST(Joints, WhatSitsOnAnEndIsAboutItsOwnStraight) {
  // The last straight begins where the bend ends, 0.1 degrees askew to it.
  hal::Tube hook = Bow8();
  hook.program.rows.back().length_mm = 0;
  const double askew = 0.1 * std::numbers::pi / 180;
  const gp_Dir along(std::sin(askew), std::cos(askew), 0);
  const auto at = [&](double mm) { return gp_Pnt(gp_XYZ(130, 30, 0) + mm * along.XYZ()); };
  TopoDS_Compound all, tube;
  BRep_Builder builder;
  builder.MakeCompound(tube);
  builder.Add(tube, test::LooseFaces(test::Pipe(hook, {.wall_mm = 0})));
  builder.Add(tube,
              test::LooseFaces(BRepPrimAPI_MakeCylinder(gp_Ax2(at(0), along), 8, 80).Shape()));
  const TopoDS_Shape ring =
      test::Without(BRepPrimAPI_MakeCylinder(gp_Ax2(at(74), along), 14, 8).Shape(),
                    BRepPrimAPI_MakeCylinder(gp_Ax2(at(70), along), 8, 20).Shape());
  builder.MakeCompound(all);
  builder.Add(all, tube);
  builder.Add(all, ring);
  const auto done = Nominal(test::WriteStepFile({{"line", all}}));
  EXPECT_THAT(done.out, HasSubstr("straights and bends meet at up to 0.100 degrees"));
  EXPECT_THAT(done.out, HasSubstr("sits on the last end, from 6.0 mm before it to 2.0 mm beyond"));
}

TEST(Joints, BordersThatLeanMakeBendsNoLarger) {
  StepStyle style;
  style.lean_deg = 0.1;
  for (const auto faces : {test::FaceStyle::kNoSeam, test::FaceStyle::kHalves}) {
    SCOPED_TRACE(int(faces));
    style.faces = faces;
    test::ExpectRows(Joint(style), DemoTube().program, 5e-4);
  }
}

}  // namespace
}  // namespace bendloop::host
