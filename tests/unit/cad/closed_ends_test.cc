// SPDX-License-Identifier: Apache-2.0
// Ends that close over the axis, as domes, points and flat bottoms; rounded ones that do not.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <BRepAdaptor_Curve.hxx>
#include <BRepAlgoAPI_Common.hxx>
#include <BRepBuilderAPI_NurbsConvert.hxx>
#include <BRepFilletAPI_MakeFillet.hxx>
#include <BRepPrimAPI_MakeCone.hxx>
#include <BRepPrimAPI_MakeCylinder.hxx>
#include <BRepPrimAPI_MakeSphere.hxx>
#include <BRepPrimAPI_MakeTorus.hxx>
#include <TopExp_Explorer.hxx>
#include <TopoDS.hxx>
#include <cmath>
#include <gp_Circ.hxx>
#include <numbers>

#include "foreign_files.h"
#include "made_files.h"
#include "run_nominal.h"

namespace bendloop::host {
namespace {

using test::Joined;
using test::Nominal;
using test::Outcome;
using test::Pipe;
using test::WriteStepFile;
using ::testing::HasSubstr;
using ::testing::Not;

// From the origin along x, to (130, 110, 0) along y.
hal::Tube Crook() {
  hal::Tube tube;
  tube.pipe_radius_mm = 8;
  tube.program = {{{100, 0, 90, 30.0}, {80, 0, 0, std::nullopt}}};
  return tube;
}

gp_Ax2 FirstEnd() { return {{0, 0, 0}, {-1, 0, 0}}; }
gp_Ax2 LastEnd() { return {{130, 110, 0}, {0, 1, 0}}; }

// What lies beyond an end of a ball about it.
TopoDS_Shape HalfBall(const gp_Ax2& end, double radius_mm) {
  return BRepPrimAPI_MakeSphere(end, radius_mm, 0, std::numbers::pi / 2).Shape();
}

hal::BendProgram Longer(double first_mm, double last_mm) {
  hal::BendProgram program = Crook().program;
  program.rows.front().length_mm += first_mm;
  program.rows.back().length_mm += last_mm;
  return program;
}

// As text: googletest prints no JSON.
std::string ClosedBy(const Outcome& done, std::size_t end) {
  return done.json.at("ends").at(end).at("closed_by").dump();
}

constexpr const char* kDomed = "domed (closed); the length is up to its tip; the plain tube ends ";

void ExpectDome(const Outcome& done, bool at_first, double high_mm = 8) {
  test::ExpectRows(done, Longer(at_first ? high_mm : 0, at_first ? 0 : high_mm), 1e-5);
  ASSERT_EQ(done.code, 0) << done.err;
  EXPECT_THAT(done.out, HasSubstr((at_first ? "first end: " : "last end: ") + std::string(kDomed)));
  EXPECT_THAT(done.out, HasSubstr(at_first ? "last end: square\n" : "first end: square\n"));
  EXPECT_THAT(done.out, Not(HasSubstr("a form of its own")));
  EXPECT_EQ(ClosedBy(done, at_first ? 0 : 1), "\"dome\"");
  EXPECT_EQ(ClosedBy(done, at_first ? 1 : 0), "null");
  EXPECT_NEAR(done.json["ends"][at_first ? 0 : 1]["plain_tube_ends_before_mm"].get<double>(),
              high_mm, 1e-4);
}

TEST(ClosedEnds, DomesCountToTheirTips) {
  const TopoDS_Shape bar = Pipe(Crook(), {.wall_mm = 0});
  for (const bool at_first : {true, false}) {
    SCOPED_TRACE(at_first);
    const gp_Ax2 end = at_first ? FirstEnd() : LastEnd();
    const TopoDS_Shape capped = Joined(bar, HalfBall(end, 8));
    for (const char* unit : {"MM", "INCH"}) {
      ExpectDome(Nominal(WriteStepFile({{"tube", capped}}, "AP214IS", unit)), at_first);
    }
    const TopoDS_Shape splines = BRepBuilderAPI_NurbsConvert(capped, true).Shape();
    ExpectDome(Nominal(WriteStepFile({{"tube", splines}})), at_first);
    // The ball's poles lie beside the tube, or askew.
    for (const gp_Dir& poles : {gp_Dir(0, 0, 1), gp_Dir(1, 2, 3)}) {
      const TopoDS_Shape ball = BRepPrimAPI_MakeSphere(gp_Ax2(end.Location(), poles), 8).Shape();
      ExpectDome(Nominal(WriteStepFile({{"tube", Joined(bar, ball)}})), at_first);
    }
  }
  // The other end, when it is counted from there.
  const auto file = WriteStepFile({{"tube", Joined(bar, HalfBall(LastEnd(), 8))}});
  EXPECT_THAT(Nominal(file, {"--reverse"}).out, HasSubstr("first end: domed"));
}

TEST(ClosedEnds, DomesInPiecesAndOnTubes) {
  const TopoDS_Shape capped = Joined(Pipe(Crook(), {.wall_mm = 0}), HalfBall(LastEnd(), 8));
  for (const double angle_deg : {180., 90.}) {
    ExpectDome(Nominal(WriteStepFile({{"tube", test::WithoutSeams(capped, angle_deg)}})), false);
  }
  ExpectDome(Nominal(WriteStepFile({{"tube", test::LooseFaces(capped)}})), false);
  ExpectDome(Nominal(test::WriteIgesFile(capped)), false);
  ExpectDome(Nominal(test::WriteIgesFile(test::WithoutSeams(capped, 90))), false);
  const TopoDS_Shape shell = test::Without(HalfBall(LastEnd(), 8), HalfBall(LastEnd(), 6));
  const auto tube =
      Nominal(WriteStepFile({{"tube", Joined(Pipe(Crook(), {.wall_mm = 2}), shell)}}));
  ExpectDome(tube, false);
  ASSERT_TRUE(tube.part);
  EXPECT_NEAR(tube.part->wall_mm.value_or(0), 2, 1e-6);
  // A shallow one, of a ball of 20 mm.
  const double high_mm = 20 - std::sqrt(20. * 20 - 8 * 8);
  const TopoDS_Shape crown =
      BRepAlgoAPI_Common(BRepPrimAPI_MakeSphere(gp_Pnt(130, 110 + high_mm - 20, 0), 20).Shape(),
                         BRepPrimAPI_MakeCylinder(LastEnd(), 8, 20).Shape());
  ExpectDome(Nominal(WriteStepFile({{"tube", Joined(Pipe(Crook(), {.wall_mm = 0}), crown)}})),
             false, high_mm);
}

TEST(ClosedEnds, PointsAreTold) {
  const TopoDS_Shape bar = Pipe(Crook(), {.wall_mm = 0});
  const TopoDS_Shape pointed = Joined(bar, BRepPrimAPI_MakeCone(LastEnd(), 8, 0, 6).Shape());
  for (const TopoDS_Shape& shape : {pointed, BRepBuilderAPI_NurbsConvert(pointed, true).Shape()}) {
    const auto done = Nominal(WriteStepFile({{"spike", shape}}));
    test::ExpectRows(done, Longer(0, 6), 1e-5);
    EXPECT_THAT(done.out, HasSubstr("last end: pointed (closed); the length is up to its tip; the "
                                    "plain tube ends 6.000 mm before it\n"));
    EXPECT_THAT(done.out, HasSubstr("first end: square\n"));
  }
}

// The edges of a shape's plane faces, rounded.
TopoDS_Shape Rounded(const TopoDS_Shape& shape, const gp_Pnt& about, double radius_mm) {
  BRepFilletAPI_MakeFillet fillet(shape);
  for (TopExp_Explorer at(shape, TopAbs_EDGE); at.More(); at.Next()) {
    const BRepAdaptor_Curve edge(TopoDS::Edge(at.Current()));
    if (edge.GetType() == GeomAbs_Circle && edge.Circle().Location().Distance(about) < 1e-6) {
      fillet.Add(radius_mm, TopoDS::Edge(at.Current()));
      break;
    }
  }
  return fillet.Shape();
}

TEST(ClosedEnds, ABarsFlatEndStaysSquare) {
  const TopoDS_Shape bar = Pipe(Crook(), {.wall_mm = 0});
  const auto flat = Nominal(WriteStepFile({{"bar", bar}}));
  EXPECT_THAT(flat.out, HasSubstr("first end: square\nlast end: square\n"));
  EXPECT_EQ(ClosedBy(flat, 0), "null");
  // As its rounded and its centred one does.
  const auto rounded = Nominal(WriteStepFile({{"bar", Rounded(bar, {130, 110, 0}, 3)}}));
  test::ExpectRows(rounded, Crook().program, 1e-5);
  EXPECT_THAT(rounded.out, HasSubstr("last end: square; the plain tube ends 3.000 mm before it "
                                     "(a fitting, flange, chamfer or end form)"));
  const TopoDS_Shape centre =
      BRepPrimAPI_MakeCone(gp_Ax2({130, 108, 0}, {0, 1, 0}), 0, 2, 2).Shape();
  const auto centred = Nominal(WriteStepFile({{"bar", test::Without(bar, centre)}}));
  test::ExpectRows(centred, Crook().program, 1e-5);
  EXPECT_THAT(centred.out, HasSubstr("last end: square\n"));
  // A ball's seat in the rounded one: a hollow, whose other pole lies on no face.
  const TopoDS_Shape ball = BRepPrimAPI_MakeSphere(gp_Pnt(130, 114.2, 0), 5).Shape();
  const auto seat =
      Nominal(WriteStepFile({{"bar", test::Without(Rounded(bar, {130, 110, 0}, 3), ball)}}));
  test::ExpectRows(seat, Crook().program, 1e-5);
  EXPECT_THAT(seat.out, HasSubstr("last end: square; the plain tube ends 3.000 mm before it"));
}

TEST(ClosedEnds, ATubesFlatEndIsClosed) {
  const TopoDS_Shape bottom = BRepPrimAPI_MakeCylinder(LastEnd(), 8, 4).Shape();
  const TopoDS_Shape closed = Joined(Pipe(Crook(), {.wall_mm = 2}), bottom);
  const auto flat = Nominal(WriteStepFile({{"can", closed}}));
  test::ExpectRows(flat, Longer(0, 4), 1e-5);
  EXPECT_THAT(flat.out, HasSubstr("last end: closed: the bore ends before it"));
  EXPECT_THAT(flat.out, HasSubstr("first end: square\n"));
  EXPECT_EQ(ClosedBy(flat, 1), "\"flat\"");
  const auto dished = Nominal(WriteStepFile({{"can", Rounded(closed, {130, 114, 0}, 3)}}));
  test::ExpectRows(dished, Longer(0, 4), 1e-5);
  EXPECT_THAT(dished.out, HasSubstr("last end: closed: the bore ends before it; the plain tube "
                                    "ends 3.000 mm before it"));
}

TEST(ClosedEnds, RoundedOnesThatAreOpenCountToo) {
  // A lip of half a ring on a wall of 2 mm.
  const TopoDS_Shape lip = BRepPrimAPI_MakeTorus(LastEnd(), 7, 1).Shape();
  const auto lipped =
      Nominal(WriteStepFile({{"tube", Joined(Pipe(Crook(), {.wall_mm = 2}), lip)}}));
  test::ExpectRows(lipped, Longer(0, 1), 1e-5);
  EXPECT_THAT(lipped.out, HasSubstr("last end: square; the plain tube ends 1.000 mm before it"));
  // A ball's zone of 4 mm, its poles askew, with the bore going on through it.
  const TopoDS_Shape ball =
      BRepPrimAPI_MakeSphere(gp_Ax2(LastEnd().Location(), {1, 2, 3}), 8).Shape();
  TopoDS_Shape zone = Joined(Pipe(Crook(), {.wall_mm = 0}), ball);
  zone = test::Drilled(test::Cut(zone, {130, 114, 0}, {0, 1, 0}), {130, 90, 0}, {130, 120, 0}, 4);
  const auto seat = Nominal(WriteStepFile({{"tube", zone}}));
  test::ExpectRows(seat, Longer(0, 4), 1e-5);
  EXPECT_THAT(seat.out, HasSubstr("last end: square; the plain tube ends 4.000 mm before it"));
}

TEST(ClosedEnds, ADomeOnABendIsNoStraight) {
  hal::Tube elbow = Crook();
  elbow.program.rows.back().length_mm = 0;
  const TopoDS_Shape shape =
      Joined(Pipe(elbow, {.wall_mm = 0}), HalfBall({{130, 30, 0}, {0, 1, 0}}, 8));
  const auto done = Nominal(WriteStepFile({{"hook", shape}}));
  EXPECT_EQ(done.code, 3);
  EXPECT_THAT(done.out, HasSubstr("last end: domed"));
  EXPECT_THAT(done.out, HasSubstr("8.0000"));
  EXPECT_THAT(done.err, HasSubstr("it ends with a bend"));
}

}  // namespace
}  // namespace bendloop::host
