// SPDX-License-Identifier: Apache-2.0
// What is cut into a tube's wall: holes and slots wherever they are and however they were drilled,
// and in words what is neither.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <BRepAlgoAPI_Cut.hxx>
#include <BRepAlgoAPI_Fuse.hxx>
#include <BRepPrimAPI_MakeBox.hxx>
#include <BRepPrimAPI_MakeCylinder.hxx>
#include <ShapeUpgrade_ShapeDivideAngle.hxx>
#include <ShapeUpgrade_UnifySameDomain.hxx>
#include <cmath>
#include <gp_Ax2.hxx>
#include <numbers>
#include <utility>
#include <vector>

#include "hal/angles.h"
#include "hal/tube_features.h"
#include "made_files.h"
#include "run_nominal.h"

namespace bendloop {
namespace {

using Eigen::Vector3d;
using test::Nominal;
using ::testing::HasSubstr;
using ::testing::Not;
using Json = nlohmann::json;

constexpr double kRadiusMm = 8, kWallMm = 1.5;

hal::Tube Elbows() {
  hal::Tube tube;
  tube.pipe_radius_mm = kRadiusMm;
  tube.program = {{{80, 0, 70, 35.0}, {90, 50, 80, 35.0}, {70, 0, 0, std::nullopt}}};
  return tube;
}

gp_Pnt Point(const Vector3d& p) { return {p.x(), p.y(), p.z()}; }
gp_Dir Direction(const Vector3d& d) { return {d.x(), d.y(), d.z()}; }

// A round bar from `from` along `way`.
TopoDS_Shape Bar(const Vector3d& from, const Vector3d& way, double radius_mm, double length_mm) {
  return BRepPrimAPI_MakeCylinder(gp_Ax2(Point(from), Direction(way)), radius_mm, length_mm)
      .Shape();
}

// A bar whose section is a slot's, its length along `along`.
TopoDS_Shape SlotBar(const Vector3d& from, const Vector3d& way, const Vector3d& along,
                     double length_mm, double width_mm, double deep_mm) {
  const double half_mm = (length_mm - width_mm) / 2;
  const Vector3d a = from - half_mm * along;
  const Vector3d corner = a - width_mm / 2 * way.cross(along);
  const TopoDS_Shape box =
      BRepPrimAPI_MakeBox(gp_Ax2(Point(corner), Direction(way), Direction(along)), 2 * half_mm,
                          width_mm, deep_mm)
          .Shape();
  const TopoDS_Shape ends =
      BRepAlgoAPI_Fuse(Bar(a, way, width_mm / 2, deep_mm),
                       Bar(from + half_mm * along, way, width_mm / 2, deep_mm))
          .Shape();
  ShapeUpgrade_UnifySameDomain one(BRepAlgoAPI_Fuse(box, ends).Shape());
  one.Build();
  return one.Shape();
}

// Each round face in quarters, as some systems write them.
TopoDS_Shape InQuarters(const TopoDS_Shape& shape) {
  ShapeUpgrade_ShapeDivideAngle divide(std::numbers::pi / 2, shape);
  divide.Perform();
  return divide.Result();
}

hal::SurfaceFrame FrameOf(const hal::Tube& tube, double along_mm, double around_deg) {
  return hal::FrameAt(hal::SpineSegments(tube.program, tube.X_WT), along_mm, around_deg);
}

struct Milled {
  double along_mm, around_deg, length_mm, width_mm, axis_deg;
};

// A tube with that slot, milled radially to its centre line.
TopoDS_Shape WithSlot(const hal::Tube& tube, const Milled& slot) {
  const hal::SurfaceFrame at = FrameOf(tube, slot.along_mm, slot.around_deg);
  const double axis = slot.axis_deg * hal::kRadiansPerDegree;
  const Vector3d along = std::cos(axis) * at.tangent + std::sin(axis) * at.sideways();
  return test::Without(test::Pipe(tube, {.wall_mm = kWallMm}),
                       SlotBar(at.spine_mm, at.outward, along, slot.length_mm, slot.width_mm, 20));
}

void ExpectSlot(const test::Outcome& done, const Milled& slot) {
  ASSERT_EQ(done.code, 0) << done.err;
  ASSERT_EQ(done.json["openings"].size(), 1U) << done.out;
  const Json found = done.json["openings"][0];
  EXPECT_EQ(found["kind"], "slot");
  EXPECT_NEAR(found["along_mm"].get<double>(), slot.along_mm, 1e-4);
  EXPECT_NEAR(found["around_deg"].get<double>(), slot.around_deg, 1e-3);
  EXPECT_NEAR(found["length_mm"].get<double>(), slot.length_mm, 1e-4);
  EXPECT_NEAR(found["width_mm"].get<double>(), slot.width_mm, 1e-4);
  EXPECT_NEAR(std::remainder(found["axis_deg"].get<double>() - slot.axis_deg, 180), 0, 1e-3);
  EXPECT_FALSE(found.contains("lean_along_deg")) << done.out;
  EXPECT_EQ(done.part->slots.size(), 1U);
}

TEST(CadOpenings, SlotsAreFoundWhateverWayTheyLie) {
  for (const Milled& slot : std::vector<Milled>{{40, 100, 11, 4, 90},
                                                {40, 100, 11, 4, 80},
                                                {40, 100, 16, 5, 70},  // wider than the bore
                                                {40, 100, 9, 2, 90},
                                                {30, -20, 14, 5, 0},
                                                {78, 0, 16, 4, 0},  // into the bend
                                                {100, 150, 10, 4, 40}}) {
    SCOPED_TRACE(slot.axis_deg);
    ExpectSlot(Nominal(test::WriteStepFile({{"slot", WithSlot(Elbows(), slot)}})), slot);
  }
}

TEST(CadOpenings, SlotsAreFoundHoweverTheFileHasTheirFaces) {
  const Milled slot{40, 100, 11, 4, 80};
  const TopoDS_Shape shape = WithSlot(Elbows(), slot);
  ExpectSlot(Nominal(test::WriteStepFile({{"quarters", InQuarters(shape)}})), slot);
  ExpectSlot(Nominal(test::WriteStepFile({{"inch", shape}}, "AP203", "INCH")), slot);
  ExpectSlot(Nominal(test::WriteIgesFile(shape)), slot);
  ExpectSlot(Nominal(test::WriteStepFile({{"loose", test::LooseFaces(shape)}})), slot);
}

TEST(CadOpenings, WhatIsNoHoleAndNoSlotIsTold) {
  const hal::Tube tube = Elbows();
  const hal::SurfaceFrame at = FrameOf(tube, 40, 30);
  const Vector3d corner = at.spine_mm - 4 * at.tangent + 2 * at.sideways();
  const TopoDS_Shape box =
      BRepPrimAPI_MakeBox(gp_Ax2(Point(corner), Direction(at.outward), Direction(at.tangent)), 8, 4,
                          20)
          .Shape();
  const TopoDS_Shape pipe = test::Pipe(tube, {.wall_mm = kWallMm});
  // The box goes from its corner towards growing angles or against them: the middle is told.
  const auto window = Nominal(test::WriteStepFile({{"window", test::Without(pipe, box)}}));
  EXPECT_THAT(window.out, HasSubstr("an opening of 8.0 mm along by 4."));
  EXPECT_THAT(window.out, HasSubstr("at 40.0 mm of the developed length"));
  EXPECT_THAT(window.out, HasSubstr("is no plain hole or slot: the part file does not have it"));
  EXPECT_EQ(window.json["openings"].size(), 0U);
  // A flat that is milled into the wall and not through it.
  const Vector3d above = at.spine_mm + (kRadiusMm - 0.5) * at.outward - 10 * at.tangent;
  const TopoDS_Shape slab =
      BRepPrimAPI_MakeBox(gp_Ax2(Point(above - 20 * at.outward.cross(at.tangent)),
                                 Direction(at.outward), Direction(at.tangent)),
                          20, 40, 5)
          .Shape();
  const auto flat = Nominal(test::WriteStepFile({{"flat", test::Without(pipe, slab)}}));
  EXPECT_THAT(flat.out, HasSubstr("a recess of 20.0 mm along by 5."));
  EXPECT_THAT(flat.out, HasSubstr("at 40.0 mm of the developed length, 30 degrees around, does not "
                                  "go through the wall"));
  // And a tube that is whole has none.
  EXPECT_THAT(Nominal(test::WriteStepFile({{"whole", pipe}})).out, Not(HasSubstr("does not have")));
}

// Of a drill beside the axis by `off_mm` towards growing angles, and leaning by `lean_deg` along.
TopoDS_Shape Drilled(const hal::Tube& tube, double along_mm, double around_deg, double off_mm,
                     double lean_deg) {
  const hal::SurfaceFrame at = FrameOf(tube, along_mm, around_deg);
  const Vector3d on_wall = at.spine_mm - off_mm * at.sideways() +
                           std::sqrt(kRadiusMm * kRadiusMm - off_mm * off_mm) * at.outward;
  const double lean = lean_deg * hal::kRadiansPerDegree;
  const Vector3d way = std::cos(lean) * at.outward + std::sin(lean) * at.tangent;
  return test::Without(test::Pipe(tube, {.wall_mm = kWallMm}), Bar(on_wall - 6 * way, way, 2, 20));
}

TEST(CadOpenings, AHoleLiesWhereItsDrillsAxisMeetsTheWall) {
  const hal::Tube tube = Elbows();
  for (const auto& [off_mm, lean_deg] :
       {std::pair{0.0, 0.0}, {1.0, 0.0}, {3.0, 0.0}, {-4.5, 0.0}, {0.0, 20.0}, {2.0, -25.0}}) {
    for (const bool split : {false, true}) {
      SCOPED_TRACE(std::to_string(off_mm) + " " + std::to_string(lean_deg));
      const TopoDS_Shape shape = Drilled(tube, 40, 100, off_mm, lean_deg);
      const auto done = Nominal(test::WriteStepFile({{"hole", split ? InQuarters(shape) : shape}}));
      ASSERT_EQ(done.code, 0) << done.err;
      ASSERT_EQ(done.json["openings"].size(), 1U) << done.out;
      const Json hole = done.json["openings"][0];
      const double turn_deg = std::asin(off_mm / kRadiusMm) / hal::kRadiansPerDegree;
      EXPECT_EQ(hole["kind"], "hole");
      EXPECT_NEAR(hole["along_mm"].get<double>(), 40, 1e-4);
      EXPECT_NEAR(hole["around_deg"].get<double>(), 100 + turn_deg, 1e-3);
      EXPECT_NEAR(hole["width_mm"].get<double>(), 4, 1e-6);
      const bool leans = off_mm != 0 || lean_deg != 0;
      EXPECT_EQ(hole.contains("lean_along_deg"), leans);
      if (!leans) continue;
      // The drill goes out as the wall's normal does at 100 degrees, turned back by `turn_deg`.
      const double out = std::cos(turn_deg * hal::kRadiansPerDegree);
      const double along_deg =
          std::atan(std::tan(lean_deg * hal::kRadiansPerDegree) / out) / hal::kRadiansPerDegree;
      EXPECT_NEAR(hole["lean_along_deg"].get<double>(), along_deg, 1e-3);
      EXPECT_NEAR(hole["lean_around_deg"].get<double>(), -turn_deg, 1e-3);
      EXPECT_THAT(done.out, HasSubstr("its drill leaning "));
      ASSERT_EQ(done.part->holes.size(), 1U);
      EXPECT_NEAR(done.part->holes[0].lean_along_deg, along_deg, 1e-3);
      EXPECT_NEAR(done.part->holes[0].lean_around_deg, -turn_deg, 1e-3);
    }
  }
}

TEST(CadOpenings, ADrillThroughBothWallsMakesTwoHoles) {
  const hal::Tube tube = Elbows();
  const hal::SurfaceFrame at = FrameOf(tube, 110, 25);  // in the bend
  const TopoDS_Shape bar = Bar(at.spine_mm - 20 * at.outward, at.outward, 2.5, 40);
  const auto done = Nominal(
      test::WriteStepFile({{"both", test::Without(test::Pipe(tube, {.wall_mm = 1}), bar)}}));
  ASSERT_EQ(done.json["openings"].size(), 2U) << done.out;
  for (const Json& hole : done.json["openings"]) {
    EXPECT_NEAR(hole["along_mm"].get<double>(), 110, 1e-4);
    EXPECT_NEAR(std::remainder(hole["around_deg"].get<double>() - 25, 180), 0, 1e-3);
    EXPECT_FALSE(hole.contains("lean_along_deg"));
  }
}

// No scan sees the wall's hole below a bung, and none judges its bore or a flange's.
TEST(CadOpenings, BoresOfWhatStandsOnTheTubeAreToldAlone) {
  const hal::Tube tube = Elbows();
  const hal::SurfaceFrame at = FrameOf(tube, 40, 100);
  const TopoDS_Shape bore = Bar(at.spine_mm + 5 * at.outward, at.outward, 2.5, 20);
  const TopoDS_Shape boss =
      test::Without(Bar(at.spine_mm + 6.8 * at.outward, at.outward, 4, 12), bore);
  const TopoDS_Shape pipe = test::Pipe(tube, {.wall_mm = kWallMm});
  const auto bung =
      Nominal(test::WriteStepFile({{"bung", test::Without(test::Joined(pipe, boss), bore)}}));
  EXPECT_EQ(bung.json["openings"].size(), 0U) << bung.out;
  EXPECT_THAT(bung.out, HasSubstr("a branch of 8.000 mm in diameter leaves it at 40.0 mm"));
  EXPECT_THAT(bung.out, HasSubstr("a bore of 5.000 mm at 40.0 mm of the developed length, 100 "));

  TopoDS_Shape flanged = test::WithCollar(pipe, {0, 0, 0}, {6, 0, 0}, 22, kRadiusMm - kWallMm);
  for (const double turn : {0.3, 1.87, 3.44, 5.01}) {
    flanged = test::Without(flanged,
                            Bar({-1, 17 * std::cos(turn), 17 * std::sin(turn)}, {1, 0, 0}, 2, 10));
  }
  EXPECT_THAT(Nominal(test::WriteStepFile({{"flange", flanged}})).out,
              HasSubstr("4 bores of 4.000 mm along the tube in the flange at the first end: the "
                        "part file does not have them"));
}

}  // namespace
}  // namespace bendloop
