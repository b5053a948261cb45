// SPDX-License-Identifier: Apache-2.0
// Tubes in pieces that do not quite meet: faces and bodies beside, before and into each other, of
// another diameter; and what is no tube for it.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <BRepBuilderAPI_MakeEdge.hxx>
#include <BRepBuilderAPI_MakePolygon.hxx>
#include <BRepBuilderAPI_MakeWire.hxx>
#include <BRepBuilderAPI_Transform.hxx>
#include <BRepOffsetAPI_MakePipeShell.hxx>
#include <BRep_Builder.hxx>
#include <TopoDS_Compound.hxx>
#include <cmath>
#include <fstream>
#include <gp_Circ.hxx>
#include <gp_Trsf.hxx>
#include <string>
#include <vector>

#include "hal/spine.h"
#include "made_files.h"
#include "run_nominal.h"
#include "step_text.h"

namespace bendloop::host {
namespace {

using test::Nominal;
using ::testing::HasSubstr;
using ::testing::Not;

constexpr double kWallMm = 1.5;

hal::Tube Bent() {
  hal::Tube tube;
  tube.pipe_radius_mm = 10;
  tube.program = {{{60, 0, 90, 40.0}, {80, 45, 60, 40.0}, {70, 0, 0, std::nullopt}}};
  return tube;
}

// How the pieces of a tube lie and what they are.
struct Pieces {
  double longer_mm = 0;  // each straight at each of its joints
  double beside_mm = 0;  // every other piece, along z
  double elbow_radius_mm = 10, elbow_bore_mm = 10 - kWallMm;
};

// The straight or bend `segment` alone, with a wall.
TopoDS_Shape Piece(const hal::SpineSegment& segment, const Pieces& pieces, bool first, bool last) {
  hal::Tube tube;
  const Eigen::Matrix3d axes = segment.axes();
  tube.X_WT.orientation = Eigen::Quaterniond(axes);
  tube.X_WT.position_mm = segment.start_mm;
  if (segment.is_arc()) {
    tube.pipe_radius_mm = pieces.elbow_radius_mm;
    tube.program = {{{0, 0, segment.angle_rad() * 180 / M_PI, segment.bend_radius_mm},
                     {0, 0, 0, std::nullopt}}};
    return test::Pipe(tube, {.wall_mm = pieces.elbow_radius_mm - pieces.elbow_bore_mm});
  }
  const double before_mm = first ? 0 : pieces.longer_mm, after_mm = last ? 0 : pieces.longer_mm;
  tube.pipe_radius_mm = 10;
  tube.X_WT.position_mm -= before_mm * segment.tangent;
  tube.program = {{{segment.length_mm + before_mm + after_mm, 0, 0, std::nullopt}}};
  return test::Pipe(tube, {.wall_mm = kWallMm});
}

std::vector<TopoDS_Shape> InPieces(const Pieces& pieces) {
  std::vector<TopoDS_Shape> shapes;
  const auto segments = hal::SpineSegments(Bent().program, Bent().X_WT);
  for (std::size_t i = 0; i < segments.size(); ++i) {
    TopoDS_Shape shape = Piece(segments[i], pieces, i == 0, i + 1 == segments.size());
    if (i % 2 == 1 && pieces.beside_mm != 0) {
      gp_Trsf move;
      move.SetTranslation(gp_Vec(0, 0, pieces.beside_mm));
      shape = BRepBuilderAPI_Transform(shape, move, true).Shape();
    }
    shapes.push_back(shape);
  }
  return shapes;
}

// The bodies of a product; or all of their faces, as one body.
std::string BodiesFile(const std::vector<TopoDS_Shape>& shapes) {
  TopoDS_Compound all;
  BRep_Builder builder;
  builder.MakeCompound(all);
  for (const TopoDS_Shape& shape : shapes) builder.Add(all, shape);
  return test::WriteStepFile({{"pieces", all}});
}

std::string FacesFile(const std::vector<TopoDS_Shape>& shapes) {
  std::vector<TopoDS_Shape> faces;
  for (const TopoDS_Shape& shape : shapes) faces.push_back(test::LooseFaces(shape));
  return BodiesFile(faces);
}

TEST(Apart, FacesBesideEachOtherAreOneTube) {
  for (const double beside_mm : {0.3, 0.9}) {
    SCOPED_TRACE(beside_mm);
    const auto done = Nominal(FacesFile(InPieces({.beside_mm = beside_mm})));
    // What lies beside moves the corners, and with them the lengths, by as much.
    test::ExpectRows(done, Bent().program, beside_mm);
    EXPECT_THAT(done.out, HasSubstr("straights and bends meet up to 0." +
                                    std::to_string(int(10 * beside_mm)) + "00 mm beside"));
    EXPECT_THAT(done.out, HasSubstr("first end: square\nlast end: square\n"));
  }
  // Farther off it is another tube.
  EXPECT_EQ(Nominal(FacesFile(InPieces({.beside_mm = 1.5}))).code, 2);
}

TEST(Apart, GapsAndOverlapsAreBridgedAndTold) {
  for (const auto& file : {BodiesFile, FacesFile}) {
    for (const double longer_mm : {-2.0, -0.5, 0.5, 3.0}) {
      SCOPED_TRACE(longer_mm);
      const auto done = Nominal(file(InPieces({.longer_mm = longer_mm})));
      test::ExpectRows(done, Bent().program);
      EXPECT_THAT(done.out, HasSubstr((longer_mm < 0 ? "begin up to " : "reach up to ") +
                                      std::to_string(std::abs(longer_mm)).substr(0, 5) + " mm"));
    }
    EXPECT_THAT(Nominal(file(InPieces({}))).out, Not(HasSubstr("up to")));
  }
}

TEST(Apart, StraightsInSeveralBodiesAreOne) {
  std::vector<TopoDS_Shape> shapes = InPieces({});
  // The second straight in two.
  const auto segments = hal::SpineSegments(Bent().program, Bent().X_WT);
  const Eigen::Vector3d at = segments[2].PointAt(30), along = segments[2].TangentAt(0);
  shapes.push_back(test::Cut(shapes[2], at, along));
  shapes[2] = test::Cut(shapes[2], at, -along);
  const auto done = Nominal(BodiesFile(shapes));
  test::ExpectRows(done, Bent().program);
  EXPECT_THAT(done.out, HasSubstr("the file has it as 6 bodies, end to end"));
}

TEST(Apart, ABodyThatIsThereTwiceIsToldAsThat) {
  const TopoDS_Shape pipe = test::Pipe(Bent());
  const auto done = Nominal(BodiesFile({pipe, pipe}));
  test::ExpectRows(done, Bent().program);
  EXPECT_THAT(done.out, HasSubstr("the file has it in the same place again, so many times: 1"));
  EXPECT_THAT(done.out, Not(HasSubstr("end to end")));
}

TEST(Apart, ElbowsOfAnotherDiameterAreTold) {
  struct Elbow {
    double radius_mm, bore_mm;
    std::string told;
  };
  for (const Elbow& elbow :
       {Elbow{10.3, 8.5,
              "2 of its bends have a diameter of 20.600 mm, its straights one of 20.000"},
        Elbow{10.05, 8.5, "a diameter of 20.100 mm"},
        Elbow{10, 8, "2 of its bends have a bore of 16.000 mm, its straights one of 17.000"},
        Elbow{10, 9, "a bore of 18.000 mm, its straights one of 17.000"}}) {
    SCOPED_TRACE(elbow.told);
    const auto done = Nominal(
        BodiesFile(InPieces({.elbow_radius_mm = elbow.radius_mm, .elbow_bore_mm = elbow.bore_mm})));
    test::ExpectRows(done, Bent().program);
    EXPECT_EQ(done.json["pipe_radius_mm"], 10);
    EXPECT_NEAR(done.json["wall_mm"], kWallMm, 1e-6);
    EXPECT_THAT(done.out, HasSubstr(elbow.told));
    EXPECT_THAT(done.out, Not(HasSubstr("has no face")));
  }
}

TEST(Apart, PiecesWhoseRadiiScatterAreOneTube) {
  std::vector<TopoDS_Shape> shapes;
  const auto segments = hal::SpineSegments(Bent().program, Bent().X_WT);
  for (std::size_t i = 0; i < segments.size(); ++i) {
    hal::Tube piece;
    piece.pipe_radius_mm = 10 + 0.05 * (int(i % 3) - 1);
    piece.X_WT.orientation = Eigen::Quaterniond(Eigen::Matrix3d(segments[i].axes()));
    piece.X_WT.position_mm = segments[i].start_mm;
    piece.program.rows = {{segments[i].is_arc() ? 0 : segments[i].length_mm, 0, 0, std::nullopt}};
    if (segments[i].is_arc()) {
      piece.program.rows.insert(
          piece.program.rows.begin(),
          {0, 0, segments[i].angle_rad() * 180 / M_PI, segments[i].bend_radius_mm});
    }
    shapes.push_back(test::Pipe(piece, {.wall_mm = 0}));
  }
  const auto done = Nominal(FacesFile(shapes));
  test::ExpectRows(done, Bent().program);
  EXPECT_NEAR(done.json["pipe_radius_mm"], 10, 0.02);
  EXPECT_THAT(done.out, HasSubstr("the diameters of its straights and bends lie up to 0.200 mm"));
}

// A pipe along a polygon, its corners mitred.
TopoDS_Shape Mitred(const std::vector<gp_Pnt>& corners) {
  BRepBuilderAPI_MakePolygon polygon;
  for (const gp_Pnt& corner : corners) polygon.Add(corner);
  BRepOffsetAPI_MakePipeShell sweep(polygon.Wire());
  sweep.SetTransitionMode(BRepBuilderAPI_RightCorner);
  sweep.Add(
      BRepBuilderAPI_MakeWire(BRepBuilderAPI_MakeEdge(gp_Circ(gp_Ax2(corners[0], {1, 0, 0}), 10)))
          .Wire());
  sweep.Build();
  return sweep.Shape();
}

TEST(Apart, AKinkIsToldAsSharpAsItIsAndWhereTheAxesMeet) {
  // Pieces of 21.5 mm between the corners, so that both ends of one lie near each corner.
  const auto gore = Nominal(test::WriteStepFile(
      {{"gore", Mitred({{0, 0, 0}, {100, 0, 0}, {120, 8, 0}, {133, 25, 0}, {140, 120, 0}})}}));
  EXPECT_EQ(gore.code, 3);
  EXPECT_THAT(gore.err, HasSubstr("kink of 21.801 degrees (a mitre) at x 100.0, y 0.0, z 0.0 mm"));
  const auto square =
      Nominal(test::WriteStepFile({{"square", Mitred({{0, 0, 0}, {100, 0, 0}, {100, 90, 0}})}}));
  EXPECT_THAT(square.err, HasSubstr("kink of 90.000 degrees (a mitre) at x 100.0, y 0.0"));
}

TEST(Apart, ABendTighterThanThePipeIsNoMitre) {
  hal::Tube tight = Bent();
  tight.program.rows = {{60, 0, 90, 8.0}, {70, 0, 0, std::nullopt}};
  const std::string file = test::TemporaryFile("tight.step");
  test::StepStyle style;
  style.wall_mm = 0;
  std::ofstream(file) << test::StepText(tight, style);
  const auto done = Nominal(file);
  EXPECT_EQ(done.code, 3);
  EXPECT_THAT(done.err, HasSubstr("straights meet in a bend of 8.000 mm radius and 90.000 degrees, "
                                  "tighter than the pipe's own radius, at x 68.0, y 0.0"));
}

}  // namespace
}  // namespace bendloop::host
