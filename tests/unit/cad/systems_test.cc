// SPDX-License-Identifier: Apache-2.0
// Forms that tubes have in files of CAD systems, which drawings of their own making lack.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <BRepBuilderAPI_MakeEdge.hxx>
#include <BRepBuilderAPI_MakeFace.hxx>
#include <BRepBuilderAPI_MakeWire.hxx>
#include <BRepBuilderAPI_NurbsConvert.hxx>
#include <BRepOffsetAPI_MakePipe.hxx>
#include <BRepPrimAPI_MakeBox.hxx>
#include <BRepPrimAPI_MakeCone.hxx>
#include <BRepPrimAPI_MakeCylinder.hxx>
#include <BRep_Builder.hxx>
#include <TopoDS.hxx>
#include <TopoDS_Compound.hxx>
#include <TopoDS_Face.hxx>
#include <cmath>
#include <gp_Circ.hxx>

#include "firmware-host/cad/tube_chain.h"
#include "foreign_files.h"
#include "made_files.h"
#include "run_nominal.h"

namespace bendloop::host {
namespace {

using test::Nominal;
using test::Pipe;
using ::testing::AnyOf;
using ::testing::HasSubstr;
using ::testing::Not;

// A handle of round bar.
hal::Tube Handle3() {
  hal::Tube tube;
  tube.pipe_radius_mm = 6;
  tube.program = {{{114, 0, 90, 10.0}, {60, 90, 90, 10.0}, {130, 0, 0, std::nullopt}}};
  return tube;
}

// Across x about the origin, `wide_mm` along y and `high_mm` along z, corners of `corner_mm`.
TopoDS_Face Profile(double wide_mm, double high_mm, double corner_mm) {
  BRepBuilderAPI_MakeWire wire;
  const double y = wide_mm / 2 - corner_mm, z = high_mm / 2 - corner_mm;
  const std::pair<double, double> centres[] = {{y, z}, {-y, z}, {-y, -z}, {y, -z}};
  gp_Pnt before(0, y + corner_mm, -z);
  for (int i = 0; i < 4; ++i) {
    const auto [cy, cz] = centres[i];
    const double a = i * M_PI / 2, b = a + M_PI / 2;
    const gp_Pnt from(0, cy + corner_mm * std::cos(a), cz + corner_mm * std::sin(a));
    const gp_Pnt to(0, cy + corner_mm * std::cos(b), cz + corner_mm * std::sin(b));
    if (before.Distance(from) > 1e-9) wire.Add(BRepBuilderAPI_MakeEdge(before, from));
    wire.Add(BRepBuilderAPI_MakeEdge(gp_Circ(gp_Ax2({0, cy, cz}, {1, 0, 0}), corner_mm), from, to));
    before = to;
  }
  return BRepBuilderAPI_MakeFace(wire.Wire());
}

TopoDS_Shape SweptProfile(const hal::Tube& tube, const TopoDS_Face& profile) {
  return BRepOffsetAPI_MakePipe(TopoDS::Wire(test::CentreLine(tube)), profile).Shape();
}

TEST(Systems, AnEndMilledFlatCountsToItsChamfer) {
  const hal::Tube bar = Handle3();  // ends at (124, 80, 140), along z
  // A chamfer of 1 mm; half of the last 24 mm milled away; a hole through what is left.
  TopoDS_Shape shape =
      test::Joined(Pipe(bar, {.wall_mm = 0}),
                   BRepPrimAPI_MakeCone(gp_Ax2({124, 80, 140}, {0, 0, 1}), 6, 5, 1).Shape());
  shape = test::Without(shape, BRepPrimAPI_MakeBox(gp_Pnt(100, 80, 117), 50, 20, 40).Shape());
  shape = test::Drilled(shape, {124, 60, 134}, {124, 100, 134}, 3);
  const auto done = Nominal(test::WriteStepFile({{"handle", test::WithoutSeams(shape, 180)}}));
  hal::BendProgram expected = bar.program;
  expected.rows.back().length_mm += 1;
  test::ExpectRows(done, expected);
  EXPECT_THAT(done.out, HasSubstr("last end: cut to a shape that is no plane"));
}

TopoDS_Compound Together(std::initializer_list<TopoDS_Shape> shapes) {
  TopoDS_Compound all;
  BRep_Builder builder;
  builder.MakeCompound(all);
  for (const TopoDS_Shape& shape : shapes) builder.Add(all, shape);
  return all;
}

TEST(Systems, AStraightThatIsNotQuiteStraightIsOne) {
  hal::Tube left = test::DemoTube(), right = left;
  left.program = {{{60, 0, 45, 20.0}, {40, 0, 0, std::nullopt}}};
  right.program = {{{45, 0, 90, 20.0}, {50, 0, 0, std::nullopt}}};
  const Spine spine = SpineOf(left);
  right.X_WT.position_mm = spine.end;
  // The next bend turns the other way; 0.09 degrees from tangent.
  const Eigen::Vector3d x =
      Eigen::AngleAxisd(0.09 * M_PI / 180, spine.end_direction().unitOrthogonal()) *
      spine.end_direction();
  Eigen::Matrix3d frame;
  frame.col(2) = (-spine.arcs[0].normal + spine.arcs[0].normal.dot(x) * x).normalized();
  frame.col(0) = x;
  frame.col(1) = frame.col(2).cross(x);
  right.X_WT.orientation = Eigen::Quaterniond(frame);
  const auto done = Nominal(test::WriteStepFile(
      {{"spike",
        test::LooseFaces(Together({Pipe(left, {.wall_mm = 0}), Pipe(right, {.wall_mm = 0})}))}}));
  test::ExpectRows(done, {{{60, 0, 45, 20.0}, {85, 180, 90, 20.0}, {50, 0, 0, std::nullopt}}}, 0.1);
  EXPECT_THAT(done.out, HasSubstr("meet at up to 0.090 degrees"));
}

// A hole that a part file cannot hold is told by its place, and never dropped.
TEST(Systems, BoresThatAreNoPlainHolesAreTold) {
  hal::Tube tube;
  tube.pipe_radius_mm = 10;
  tube.program = {{{100, 0, 90, 30.0}, {80, 0, 0, std::nullopt}}};
  const auto through = Nominal(test::WriteStepFile(
      {{"bar", test::Drilled(Pipe(tube, {.wall_mm = 0}), {40, 0, -30}, {40, 0, 30}, 3)}}));
  test::ExpectRows(through, tube.program);
  EXPECT_THAT(through.out, HasSubstr("a bore of 6.000 mm at 40.0 mm of the developed length, 0 "));
  EXPECT_THAT(through.out,
              HasSubstr("a bore of 6.000 mm at 40.0 mm of the developed length, 180 "));
  EXPECT_THAT(Nominal(test::TemporaryFile("made.step"), {"--reverse"}).out,
              HasSubstr("a bore of 6.000 mm at 187.1 mm"));
  const auto blind = Nominal(test::WriteStepFile(
      {{"bar", test::Drilled(Pipe(tube, {.wall_mm = 0}), {40, 0, 4}, {40, 0, 30}, 3)}}));
  EXPECT_THAT(blind.out, HasSubstr("a bore of 6.000 mm at 40.0 mm of the developed length, 0 "));
  EXPECT_THAT(blind.out, Not(HasSubstr("180 degrees around")));
  // A countersink of 90 degrees on a hole through a wall of 3 mm.
  TopoDS_Shape sunk = test::Drilled(Pipe(tube, {.wall_mm = 3}), {40, 0, 0}, {40, 0, 30}, 2);
  sunk = test::Without(sunk, BRepPrimAPI_MakeCone(gp_Ax2({40, 0, 8}, {0, 0, 1}), 1, 6, 5).Shape());
  const auto countersunk = Nominal(test::WriteStepFile({{"tube", sunk}}));
  test::ExpectRows(countersunk, tube.program);
  EXPECT_THAT(countersunk.out, HasSubstr("a bore of 4.000 mm at 40.0 mm"));
  // A plain hole is one, and no bore beside.
  const auto plain = Nominal(test::WriteStepFile(
      {{"tube", test::Drilled(Pipe(tube, {.wall_mm = 3}), {40, 0, 0}, {40, 0, 30}, 2)}}));
  EXPECT_THAT(plain.out, HasSubstr("hole of 4.000 mm at 40.000 mm"));
  EXPECT_THAT(plain.out, Not(HasSubstr("bore")));
}

// Union nuts: each a solid, with its thread as a sheet beside it.
TEST(Systems, NutsOnATubeAreNoTubes) {
  const hal::Tube tube = test::DemoTube();
  const auto nut = [](double x) {
    const auto bar = [&](double radius, double length) {
      return BRepPrimAPI_MakeCylinder(gp_Ax2({x, 0, 0}, {1, 0, 0}), radius, length).Shape();
    };
    return Together({test::Without(bar(13, 20), bar(5.2, 20)), test::WithoutEnds(bar(8, 14))});
  };
  const auto done =
      Nominal(test::WriteStepFile({{"line", Together({nut(2), Pipe(tube), nut(30)})}}));
  test::ExpectRows(done, tube.program);
  ASSERT_EQ(done.code, 0) << done.err;
  EXPECT_NEAR(done.part->wall_mm.value_or(0), 1, 1e-6);
}

TEST(Systems, ProfilesThatAreNotRoundAreRefused) {
  hal::Tube line = test::DemoTube();
  line.program = {{{60, 0, 45, 40.0}, {70, 0, 60, 40.0}, {50, 0, 0, std::nullopt}}};
  for (const bool nurbs : {false, true}) {
    for (const auto& [wide, high, corner] :
         {std::tuple(20., 20., 2.), std::tuple(20., 10., 2.), std::tuple(20., 10., 4.999),
          std::tuple(10., 20., 4.999), std::tuple(20., 20., 9.)}) {
      SCOPED_TRACE(testing::Message() << wide << " " << high << " " << corner << " " << nurbs);
      TopoDS_Shape shape = SweptProfile(line, Profile(wide, high, corner));
      if (nurbs) shape = BRepBuilderAPI_NurbsConvert(shape, true).Shape();
      const auto done = Nominal(test::WriteStepFile({{"bar", shape}}));
      EXPECT_EQ(done.code, 3) << done.out << done.err;
      EXPECT_THAT(done.err, AnyOf(HasSubstr("not round"), HasSubstr("no round tube")));
      EXPECT_THAT(done.err, Not(HasSubstr("--nearest")));
    }
  }
}

}  // namespace
}  // namespace bendloop::host
