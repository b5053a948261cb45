// SPDX-License-Identifier: Apache-2.0
// Forms that tubes have in files of CAD systems, which drawings of their own making lack.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <BRepBuilderAPI_GTransform.hxx>
#include <BRepBuilderAPI_MakeEdge.hxx>
#include <BRepBuilderAPI_MakeFace.hxx>
#include <BRepBuilderAPI_MakePolygon.hxx>
#include <BRepBuilderAPI_MakeWire.hxx>
#include <BRepBuilderAPI_NurbsConvert.hxx>
#include <BRepOffsetAPI_MakePipe.hxx>
#include <BRepPrimAPI_MakeBox.hxx>
#include <BRepPrimAPI_MakeCone.hxx>
#include <BRepPrimAPI_MakeCylinder.hxx>
#include <BRepPrimAPI_MakeSphere.hxx>
#include <BRep_Builder.hxx>
#include <TopoDS.hxx>
#include <TopoDS_Compound.hxx>
#include <TopoDS_Face.hxx>
#include <cmath>
#include <fstream>
#include <gp_Circ.hxx>
#include <gp_GTrsf.hxx>

#include "firmware-host/cad/tube_chain.h"
#include "foreign_files.h"
#include "made_files.h"
#include "run_nominal.h"
#include "step_text.h"

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
  // The chamfer's millimetre is the least of it: what can be clamped ends where the flat begins.
  EXPECT_THAT(
      done.out,
      HasSubstr(
          "last end: cut to a shape that is no plane; the length is up to "
          "its farthest point about -90 degrees around, the tube is whole all around up to 24.000 "
          "mm before it"));
  EXPECT_NEAR(done.json["ends"][1]["plain_tube_ends_before_mm"].get<double>(), 24, 1e-3);
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
  EXPECT_THAT(through.out, Not(HasSubstr("-0 degrees")));
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

// Bends about as tight as a die makes them, as files have them that know no seams, and with.
TEST(Systems, BendsTighterThanTheirPipeIsWide) {
  hal::Tube tube;
  tube.pipe_radius_mm = 16.85;
  tube.program = {
      {{80, 0, 90, 17.5}, {60, 120, 60, 35.0}, {0, 90, 45, 35.0}, {70, 0, 0, std::nullopt}}};
  for (const auto faces : {test::FaceStyle::kNoSeam, test::FaceStyle::kSeam,
                           test::FaceStyle::kHalves, test::FaceStyle::kQuarters}) {
    for (const auto surfaces : {test::SurfaceStyle::kAnalytic, test::SurfaceStyle::kRational}) {
      SCOPED_TRACE(testing::Message() << int(faces) << " " << int(surfaces));
      if (faces == test::FaceStyle::kNoSeam && surfaces == test::SurfaceStyle::kRational) continue;
      test::StepStyle style;
      style.faces = faces;
      style.surfaces = surfaces;
      style.wall_mm = 2;
      const std::string file = test::TemporaryFile("tight.step");
      std::ofstream(file) << test::StepText(tube, style);
      test::ExpectRows(Nominal(file), tube.program, 1e-5);
    }
  }
}

// What AP242 carries beside the body: tolerances drawn as polylines, and their planes.
TEST(Systems, NotesOnTheModelAreNoCurves) {
  const std::string file = test::WriteStepFile({{"tube", Pipe(test::DemoTube())}}, "AP242DIS");
  const std::string noted = test::Edited(
      file, "ENDSEC;\nEND-ISO",
      "#90001=CARTESIAN_POINT('',(0.,0.,0.));\n#90002=CARTESIAN_POINT('',(0.,90.,0.));\n"
      "#90003=CARTESIAN_POINT('',(70.,90.,0.));\n#90004=POLYLINE('',(#90001,#90002,#90003));\n"
      "#90005=GEOMETRIC_CURVE_SET('Position.1',(#90004));\n"
      "#90006=DRAUGHTING_PRE_DEFINED_CURVE_FONT('continuous');\n"
      "#90007=CURVE_STYLE('',#90006,POSITIVE_LENGTH_MEASURE(0.13),$);\n"
      "#90008=PRESENTATION_STYLE_ASSIGNMENT((#90007));\n"
      "#90009=ANNOTATION_CURVE_OCCURRENCE('Position.1',(#90008),#90005);\n"
      "#90010=VALUE_REPRESENTATION_ITEM('number of annotations',COUNT_MEASURE(1.));\n"
      "#90011=TESSELLATED_ANNOTATION_OCCURRENCE('',(#90008),#90005);\nENDSEC;\nEND-ISO");
  const auto done = Nominal(noted);
  test::ExpectRows(done, test::DemoTube().program);
  EXPECT_THAT(done.out, Not(HasSubstr("left out")));
}

// Text that is engraved beside a tube has more ends than any tube, and none of them is one's.
TEST(Systems, EngravedTextIsNoTube) {
  BRepBuilderAPI_MakePolygon text;
  for (int i = 0; i < 1000; ++i) text.Add(gp_Pnt(50 + 0.2 * i, 40 + 3 * (i % 2), 30));
  const auto done =
      Nominal(test::WriteStepFile({{"tube", Pipe(test::DemoTube())}, {"text", text.Wire()}}));
  test::ExpectRows(done, test::DemoTube().program);
}

// A slot through both walls of an elbow, and dents that are B-splines, leave its bend what it is.
TEST(Systems, ElbowsCutAndDented) {
  hal::Tube elbow;
  elbow.pipe_radius_mm = 17;
  elbow.program = {{{30, 0, 90, 84.0}, {30, 0, 0, std::nullopt}}};
  const auto bar = [](double x, double radius) {
    return BRepPrimAPI_MakeCylinder(gp_Ax2({x, 0, -40}, {0, 0, 1}), radius, 80).Shape();
  };
  TopoDS_Shape shape = Pipe(elbow, {.wall_mm = 3});
  shape = test::Without(shape, bar(12, 5));
  shape = test::Without(shape, bar(20, 5));
  shape = test::Without(shape, BRepPrimAPI_MakeBox(gp_Pnt(12, -5, -40), 8, 10, 80).Shape());
  const auto slotted = Nominal(test::WriteStepFile({{"elbow", shape}}));
  test::ExpectRows(slotted, elbow.program);
  EXPECT_THAT(slotted.out, HasSubstr("slot of 18.000 by 10.000 mm at 16.000 mm"));
  // An egg, as a B-spline, pressed into bend and straight.
  gp_GTrsf stretch;
  stretch.SetValue(1, 1, 3);
  const TopoDS_Shape egg =
      BRepBuilderAPI_GTransform(BRepPrimAPI_MakeSphere(gp_Pnt(0, 0, 0), 6).Shape(), stretch, true)
          .Shape();
  gp_Trsf onto;
  onto.SetTranslation({32, -17, 0});
  const auto dented = Nominal(test::WriteStepFile(
      {{"elbow", test::Without(Pipe(elbow, {.wall_mm = 0}), egg.Moved(TopLoc_Location(onto)))}}));
  test::ExpectRows(dented, elbow.program);
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
