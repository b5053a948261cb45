// SPDX-License-Identifier: Apache-2.0
// What stands on a tube, about it, in it and beside it.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <BRepAdaptor_Curve.hxx>
#include <BRepBuilderAPI_GTransform.hxx>
#include <BRepBuilderAPI_MakeEdge.hxx>
#include <BRepBuilderAPI_MakePolygon.hxx>
#include <BRepPrimAPI_MakeBox.hxx>
#include <BRepPrimAPI_MakeCone.hxx>
#include <BRepPrimAPI_MakeCylinder.hxx>
#include <BRep_Builder.hxx>
#include <GeomAPI_Interpolate.hxx>
#include <STEPControl_Writer.hxx>
#include <TColgp_Array1OfPnt.hxx>
#include <TopExp_Explorer.hxx>
#include <TopoDS.hxx>
#include <TopoDS_Compound.hxx>
#include <gp_Circ.hxx>
#include <gp_GTrsf.hxx>
#include <string>

#include "firmware-host/cad/cad_helper.h"
#include "foreign_files.h"
#include "made_files.h"
#include "run_nominal.h"

namespace bendloop::host {
namespace {

using test::Nominal;
using test::Pipe;
using ::testing::HasSubstr;
using ::testing::Not;

hal::Tube Elbow(double pipe_radius_mm) {
  hal::Tube tube;
  tube.pipe_radius_mm = pipe_radius_mm;
  tube.program = {{{100, 0, 90, 30.0}, {80, 0, 0, std::nullopt}}};
  return tube;
}

TopoDS_Shape Bar(const gp_Pnt& at, const gp_Dir& along, double radius_mm, double length_mm) {
  return BRepPrimAPI_MakeCylinder(gp_Ax2(at, along), radius_mm, length_mm).Shape();
}

TEST(Beside, BranchesAreTold) {
  const TopoDS_Shape run = Pipe(Elbow(10), {.wall_mm = 0});
  const auto tee =
      Nominal(test::WriteStepFile({{"tee", test::Joined(run, Bar({50, 0, 0}, {0, 0, 1}, 8, 60))}}));
  test::ExpectRows(tee, Elbow(10).program);
  EXPECT_THAT(tee.out, HasSubstr("a branch of 16.000 mm in diameter leaves it at 50.0 mm"));
  const auto boss = Nominal(
      test::WriteStepFile({{"boss", test::Joined(run, Bar({50, 0, 0}, {0, 0, 1}, 6, 14))}}));
  EXPECT_THAT(boss.out, HasSubstr("a socket or boss of 12.000 mm"));
}

TEST(Beside, BranchesAreCountedFromTheFirstEnd) {
  // The last end lies at the origin, so the rows begin there.
  gp_Trsf shift;
  shift.SetTranslation({-130, -110, 0});
  const TopoDS_Shape tee =
      test::Joined(Pipe(Elbow(10), {.wall_mm = 0}), Bar({50, 0, 0}, {0, 0, 1}, 8, 60));
  const auto file = test::WriteStepFile({{"tee", tee.Moved(TopLoc_Location(shift))}});
  EXPECT_THAT(Nominal(file).out, HasSubstr("leaves it at 177.1 mm"));
  EXPECT_THAT(Nominal(file, {"--reverse"}).out, HasSubstr("leaves it at 50.0 mm"));
}

// Nothing that a body holds beside its tube is dropped without a word.
TEST(Beside, CrossBarsAndPlatesAreTold) {
  hal::Tube bow;
  bow.pipe_radius_mm = 15;
  bow.program = {{{200, 0, 90, 60.0}, {300, 0, 90, 60.0}, {200, 0, 0, std::nullopt}}};
  const TopoDS_Shape bar = Pipe(bow, {.wall_mm = 0});
  const auto frame = Nominal(
      test::WriteStepFile({{"frame", test::Joined(bar, Bar({100, 0, 0}, {0, 1, 0}, 12, 420))}}));
  test::ExpectRows(frame, bow.program);
  EXPECT_THAT(frame.out, HasSubstr("a branch of 24.000 mm in diameter leaves it at 100.0 mm"));
  EXPECT_THAT(frame.out, HasSubstr("a branch of 24.000 mm in diameter leaves it at 788.5 mm"));
  EXPECT_THAT(frame.out, Not(HasSubstr("a plate")));
  const TopoDS_Shape plate = BRepPrimAPI_MakeBox(gp_Pnt(70, -40, -3), 30, 80, 6).Shape();
  const auto plated = Nominal(test::WriteStepFile({{"bracket", test::Joined(bar, plate)}}));
  test::ExpectRows(plated, bow.program);
  EXPECT_THAT(plated.out, HasSubstr("faces reach up to 40.1 mm from its axis"));
  EXPECT_THAT(plated.out, HasSubstr("(a plate, a bracket, a sleeve)"));
  const auto plain = Nominal(test::WriteStepFile({{"bow", bar}}));
  EXPECT_THAT(plain.out, Not(HasSubstr("faces reach")));
}

// Circles that a file has as bodies of their own are the pipe of the centre line they lie about.
TEST(Beside, CirclesAboutACentreLineAreItsPipe) {
  const auto circle = [](double radius) {
    return BRepBuilderAPI_MakeEdge(gp_Circ(gp_Ax2({0, 0, 0}, {1, 0, 0}), radius)).Edge();
  };
  TopoDS_Compound all;
  BRep_Builder builder;
  builder.MakeCompound(all);
  builder.Add(all, test::CentreLine(Elbow(10)));
  STEPControl_Writer writer;
  for (const TopoDS_Shape& shape :
       {TopoDS_Shape(all), TopoDS_Shape(circle(10)), TopoDS_Shape(circle(8))}) {
    writer.Transfer(shape, STEPControl_AsIs);
  }
  const std::string file = test::TemporaryFile("circles.step");
  ASSERT_EQ(writer.Write(file.c_str()), IFSelect_RetDone);
  const auto done = Nominal(file);
  test::ExpectRows(done, Elbow(10).program);
  ASSERT_EQ(done.code, 0) << done.err;
  EXPECT_NEAR(done.part->pipe_radius_mm, 10, 1e-6);
  EXPECT_NEAR(done.part->wall_mm.value_or(0), 2, 1e-6);
  EXPECT_THAT(done.out, Not(HasSubstr("end to end")));
}

TEST(Beside, ASilencerIsNoTube) {
  hal::Tube tube;
  tube.pipe_radius_mm = 5;
  tube.program = {{{40, 0, 90, 20.0}, {200, 90, 90, 20.0}, {40, 0, 0, std::nullopt}}};
  const TopoDS_Shape pipe = Pipe(tube, {.wall_mm = 0});
  // 160 mm of it, longer than a straight without faces may be.
  const auto done = Nominal(
      test::WriteStepFile({{"line", test::Joined(pipe, Bar({60, 40, 0}, {0, 1, 0}, 25, 160))}}));
  test::ExpectRows(done, tube.program);
  ASSERT_EQ(done.code, 0) << done.err;
  EXPECT_NEAR(done.part->pipe_radius_mm, 5, 1e-6);
}

TEST(Beside, FlaresCountToTheLength) {
  const TopoDS_Shape flare = BRepPrimAPI_MakeCone(gp_Ax2({0, 0, 0}, {-1, 0, 0}), 10, 14, 5).Shape();
  const auto done = Nominal(
      test::WriteStepFile({{"flared", test::Joined(Pipe(Elbow(10), {.wall_mm = 0}), flare)}}));
  hal::BendProgram longer = Elbow(10).program;
  longer.rows[0].length_mm += 5;
  test::ExpectRows(done, longer);
  EXPECT_THAT(done.out, HasSubstr("the plain tube ends 5.000 mm before it"));
}

TEST(Beside, BodiesInTheBoreAreNoTubes) {
  const auto both = [](const TopoDS_Shape& a, const TopoDS_Shape& b) {
    TopoDS_Compound all;
    BRep_Builder builder;
    builder.MakeCompound(all);
    builder.Add(all, a);
    builder.Add(all, b);
    return test::WriteStepFile({{"line", all}});
  };
  const TopoDS_Shape inner = Pipe(Elbow(8), {.wall_mm = 0});
  const auto fluid = Nominal(both(inner, Pipe(Elbow(10), {.wall_mm = 2})));
  test::ExpectRows(fluid, Elbow(10).program);
  EXPECT_THAT(fluid.out, HasSubstr("lies in its bore: left out"));
  const auto bars = Nominal(both(inner, Pipe(Elbow(10), {.wall_mm = 0})));
  test::ExpectRows(bars, Elbow(10).program);
  ASSERT_EQ(bars.code, 0) << bars.err;
  EXPECT_NEAR(bars.part->wall_mm.value_or(0), 2, 1e-6);
}

std::string InOneProduct(const std::vector<TopoDS_Shape>& shapes) {
  TopoDS_Compound all;
  BRep_Builder builder;
  builder.MakeCompound(all);
  for (const TopoDS_Shape& shape : shapes) builder.Add(all, shape);
  return test::WriteStepFile({{"line", all}});
}

TEST(Beside, BodiesOnTheEndsAreTold) {
  // A nut from 3 mm beyond the first end to 9 mm onto it; a flange 1 mm beyond the last one, which
  // lies at (130, 110, 0) and points along y; a bracket somewhere.
  const TopoDS_Shape nut =
      test::Drilled(Bar({-3, 0, 0}, {1, 0, 0}, 15, 12), {-4, 0, 0}, {20, 0, 0}, 10);
  const TopoDS_Shape flange =
      test::Drilled(Bar({130, 111, 0}, {0, 1, 0}, 30, 6), {130, 100, 0}, {130, 120, 0}, 8);
  const TopoDS_Shape bracket = BRepPrimAPI_MakeBox(gp_Pnt(40, 40, 0), 5, 6, 7).Shape();
  const std::string file = InOneProduct({Pipe(Elbow(10), {.wall_mm = 2}), nut, flange, bracket});
  const auto done = Nominal(file);
  test::ExpectRows(done, Elbow(10).program);
  EXPECT_THAT(done.out, HasSubstr("sits on the first end, from 9.0 mm before it to 3.0 mm beyond "
                                  "it, up to 30.0 mm in diameter: left out\n"));
  EXPECT_THAT(done.out, HasSubstr("sits on the last end, from 1.0 mm beyond it to 7.0 mm beyond "
                                  "it, up to 60.0 mm in diameter: left out\n"));
  EXPECT_THAT(done.out, HasSubstr("\n1 other body, left out\n"));
  EXPECT_THAT(done.out, HasSubstr("'line' sits"));  // and not 'SOLID', as its shapes are called
  EXPECT_THAT(Nominal(file, {"--reverse"}).out, HasSubstr("sits on the last end, from 9.0 mm"));
}

TEST(Beside, ANutOfAFreeFormIsTold) {
  gp_GTrsf wider;
  wider.SetValue(3, 3, 1.3);
  const TopoDS_Shape oval =
      BRepBuilderAPI_GTransform(Bar({-3, 0, 0}, {1, 0, 0}, 15, 12), wider).Shape();
  const TopoDS_Shape nut = test::Drilled(oval, {-4, 0, 0}, {20, 0, 0}, 10);
  const auto done = Nominal(InOneProduct({Pipe(Elbow(10), {.wall_mm = 2}), nut}), {"--body", "1"});
  test::ExpectRows(done, Elbow(10).program);
  EXPECT_THAT(done.out,
              HasSubstr("sits on the first end, from 9.0 mm before it to 3.0 mm beyond "));
}

TEST(Beside, ABoreInAPlateBesideAnEndIsInNoForm) {
  // The last end lies at (130, 110, 0) and points along y.
  const TopoDS_Shape plate =
      test::Drilled(BRepPrimAPI_MakeBox(gp_Pnt(150, 50, -3), 30, 110, 6).Shape(), {160, 150, -9},
                    {160, 150, 9}, 2);
  TopoDS_Compound both;
  BRep_Builder builder;
  builder.MakeCompound(both);
  for (const TopoDS_Shape& shape : {Pipe(Elbow(10), {.wall_mm = 0}), plate}) {
    builder.Add(both, test::LooseFaces(shape));
  }
  const auto done = Nominal(test::WriteStepFile({{"bar", both}}));
  test::ExpectRows(done, Elbow(10).program);
  EXPECT_THAT(done.out, Not(HasSubstr("goes across the form")));
  EXPECT_THAT(done.out, HasSubstr("other faces reach up to"));
}

// A tab that is welded on, from 60 mm before the last end to 50 mm beyond it.
TEST(Beside, APlateThatGoesOnBeyondAnEndIsNoFormOfIt) {
  for (const double wall_mm : {0.0, 2.0}) {
    SCOPED_TRACE(wall_mm);
    const TopoDS_Shape plate = BRepPrimAPI_MakeBox(gp_Pnt(138, 50, -3), 32, 110, 6).Shape();
    const auto done = Nominal(test::WriteStepFile(
        {{"bracket", test::Joined(Pipe(Elbow(10), {.wall_mm = wall_mm}), plate)}}));
    test::ExpectRows(done, Elbow(10).program);
    EXPECT_THAT(done.out, HasSubstr("other faces reach up to 64.1 mm from its axis"));
    // Nor beside one that has a chamfer.
    const TopoDS_Shape chamfer =
        BRepPrimAPI_MakeCone(gp_Ax2({130, 110, 0}, {0, 1, 0}), 10, 9, 1).Shape();
    const TopoDS_Shape bar = test::Joined(Pipe(Elbow(10), {.wall_mm = 0}), chamfer);
    hal::Tube longer = Elbow(10);
    longer.program.rows.back().length_mm += 1;
    test::ExpectRows(Nominal(test::WriteStepFile({{"bracket", test::Joined(bar, plate)}})),
                     longer.program);
  }
}

TEST(Beside, WhetherACentreLineAgreesIsTold) {
  const TopoDS_Shape pipe = Pipe(Elbow(10), {.wall_mm = 2});
  const auto same = Nominal(InOneProduct({pipe, test::CentreLine(Elbow(10))}));
  test::ExpectRows(same, Elbow(10).program);
  EXPECT_THAT(same.out, HasSubstr("the file has its centre line, too, with the same bends: "
                                  "227.124 mm long beside 227.124 mm of the tube\n"));
  hal::Tube other = Elbow(10);
  other.program.rows[0].bend_radius_mm = 32;
  other.program.rows[0].length_mm = 98;
  EXPECT_THAT(Nominal(InOneProduct({pipe, test::CentreLine(other)})).out,
              HasSubstr("its centre line, too, with other bends: "));
  EXPECT_THAT(Nominal(InOneProduct({pipe})).out, Not(HasSubstr("centre line")));
}

TEST(Beside, OnePartSeveralTimesIsThatPart) {
  const TopoDS_Shape pipe = Pipe(Elbow(10), {.wall_mm = 0});
  const auto done =
      Nominal(test::WriteStepFile({{"left", pipe}, {"right", pipe}, {"spare", pipe}}));
  ASSERT_EQ(done.code, 0) << done.err;
  EXPECT_THAT(done.out, HasSubstr("the file holds it 3 times"));
}

TEST(Beside, APolygonIsOneTubeWithoutBends) {
  const TopoDS_Shape polygon = BRepBuilderAPI_MakePolygon(gp_Pnt(0, 0, 0), gp_Pnt(100, 0, 0),
                                                          gp_Pnt(100, 80, 0), gp_Pnt(100, 80, 50))
                                   .Wire();
  const auto done = Nominal(test::WriteStepFile({{"line", polygon}}));
  EXPECT_EQ(done.code, 3);
  EXPECT_THAT(done.err, HasSubstr("its 3 lines meet in corners without arcs"));
}

TEST(Beside, AnInterpolatedCentreLineHasNearestArcs) {
  const hal::Tube tube = test::DemoTube();
  TColgp_Array1OfPnt all(1, 400);
  int count = 0;
  for (TopExp_Explorer at(test::CentreLine(tube), TopAbs_EDGE); at.More(); at.Next()) {
    const BRepAdaptor_Curve curve(TopoDS::Edge(at.Current()));
    const double from = curve.FirstParameter(), to = curve.LastParameter();
    for (int i = count == 0 ? 0 : 1; i <= 30; ++i) {
      all(++count) = curve.Value(from + (to - from) * i / 30);
    }
  }
  const Handle(TColgp_HArray1OfPnt) points = new TColgp_HArray1OfPnt(1, count);
  for (int i = 1; i <= count; ++i) points->SetValue(i, all(i));
  GeomAPI_Interpolate spline(points, false, 1e-6);
  spline.Perform();
  const auto file = test::WriteStepFile({{"line", BRepBuilderAPI_MakeEdge(spline.Curve()).Edge()}});
  EXPECT_THAT(Nominal(file).err, HasSubstr("--nearest gives the lines and arcs nearest to it, "
                                           "with --pipe-diameter MM"));
  const auto done = Nominal(file, {"--nearest", "--pipe-diameter", "10"});
  // The spline swings about where an arc begins and, most, where two bends meet.
  test::ExpectRows(done, tube.program, 0.1);
}

TEST(Beside, AFileThatHoldsItselfIsRefused) {
  const auto file = test::WriteStepFile({{"tube", Pipe(Elbow(10))}});
  const auto itself = test::Edited(
      test::Edited(file, "ADVANCED_BREP_SHAPE_REPRESENTATION('',(#11,#15),",
                   "SHAPE_REPRESENTATION('',(#11,#90003),"),
      "ENDSEC;\nEND-ISO",
      "#90001=REPRESENTATION_MAP(#11,#10);\n#90003=MAPPED_ITEM('',#90001,#11);\nENDSEC;\nEND-ISO");
  const auto done = Nominal(itself);
  EXPECT_EQ(done.code, 3) << done.out;
  EXPECT_THAT(done.err, HasSubstr("export the tube alone"));
}

TEST(Beside, TheHelperIsGivenUpInTime) {
  const auto file = test::WriteStepFile({{"tube", Pipe(Elbow(10))}});
  const auto late = RunCadHelper({"read", file, "0"}, "", file, std::chrono::seconds(0));
  ASSERT_FALSE(late);
  EXPECT_EQ(late.error().kind, hal::ErrorKind::kBadInput);
  EXPECT_THAT(late.error().message, HasSubstr("export the tube alone"));
}

}  // namespace
}  // namespace bendloop::host
