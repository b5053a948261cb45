// SPDX-License-Identifier: Apache-2.0
// Ends beside bends: of a tube that comes back to its own, and of one that is cut through one.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <numbers>
#include <string>
#include <vector>

#include "foreign_files.h"
#include "made_files.h"
#include "run_nominal.h"
#include "step_text.h"

namespace bendloop::host {
namespace {

using test::Nominal;
using test::Pipe;
using ::testing::HasSubstr;
using ::testing::Not;

// Goes around and comes down on its first bend, so far along it, and ends so far away from it.
hal::Tube ToItself(double beside_mm, double gap_mm) {
  constexpr double kRadiusMm = 10, kClrMm = 150;
  const double upper_mm = kClrMm - std::sqrt(kClrMm * kClrMm - beside_mm * beside_mm);
  const double slope = std::sqrt(1 - beside_mm * beside_mm / (kClrMm * kClrMm));
  // Two bends lead back, of 40 mm where there is room.
  const double turn_mm = std::min(40.0, (kClrMm - beside_mm) / 2 - 2);
  hal::Tube tube;
  tube.pipe_radius_mm = kRadiusMm;
  tube.program = {
      {{200, 0, 90, kClrMm},
       {100, 0, 90, turn_mm},
       {kClrMm - 2 * turn_mm - beside_mm, 0, 90, turn_mm},
       {kClrMm + 100 - upper_mm - 1.08 * kRadiusMm / slope - gap_mm, 0, 0, std::nullopt}}};
  return tube;
}

TEST(CutBends, AnEndBesideABendOfItsOwnHasNoFormFromIt) {
  const hal::Tube tube = ToItself(60, 12);
  for (const int cuts : {0, 1, 2}) {
    SCOPED_TRACE(cuts);
    const auto done =
        Nominal(test::WriteStepFile({{"loop", Pipe(tube, {.wall_mm = 1.5, .cuts = cuts})}}));
    test::ExpectRows(done, tube.program);
    EXPECT_THAT(done.out, HasSubstr("last end: square\n"));
    EXPECT_THAT(done.out, Not(HasSubstr("recess")));
  }
}

TEST(CutBends, ABendBesideAnEndIsNoRecess) {
  test::StepStyle style;
  style.faces = test::FaceStyle::kQuarters;
  style.wall_mm = 1.5;
  for (const double beside_mm : {22.5, 105.0}) {
    SCOPED_TRACE(beside_mm);
    const hal::Tube tube = ToItself(beside_mm, 1);
    const std::string file = test::TemporaryFile("loop.step");
    std::ofstream(file) << test::StepText(tube, style);
    const auto done = Nominal(file);
    test::ExpectRows(done, tube.program);
    EXPECT_THAT(done.out, Not(HasSubstr("recess")));
  }
}

// Vertices of an end's own edge lie off it by what a file rounds.
TEST(CutBends, WhatAFileRoundsIsNoFormOfAnEnd) {
  hal::Tube tube;
  tube.pipe_radius_mm = 10;
  tube.program.rows = {{60, 0, 90, 40.0}, {80, 45, 60, 40.0}, {70, 0, 0, std::nullopt}};
  tube.X_WT.position_mm = {11.23, -7.49, 3.17};
  tube.X_WT.orientation =
      Eigen::Quaterniond(Eigen::AngleAxisd(0.4, Eigen::Vector3d(1, 2, 3).normalized()));
  test::StepStyle style;
  style.digits = 3;
  // However a file splits its faces, the tube is as long.
  for (const auto faces :
       {test::FaceStyle::kSeam, test::FaceStyle::kHalves, test::FaceStyle::kQuarters}) {
    SCOPED_TRACE(int(faces));
    style.faces = faces;
    const std::string file = test::TemporaryFile("rounded.step");
    std::ofstream(file) << test::StepText(tube, style);
    const auto done = Nominal(file);
    ASSERT_TRUE(done.part) << done.err;
    EXPECT_THAT(done.out, HasSubstr("first end: square\nlast end: square\n"));
    EXPECT_NEAR(done.part->rows.rows.front().length_mm, 60, 0.06);
    EXPECT_NEAR(done.part->rows.rows.back().length_mm, 70, 0.06);
  }
}

hal::Tube Hook() {
  hal::Tube tube;
  tube.pipe_radius_mm = 10;
  tube.program = {{{60, 0, 90, 40.0}, {80, 0, 0, std::nullopt}}};
  return tube;
}

// Cut by a plane that leaves so much straight at its shortest side, about z or about y.
TopoDS_Shape Mitred(double angle_deg, double left_mm, bool about_y, bool open) {
  const double angle = angle_deg * std::numbers::pi / 180;
  const double x = 60 - 10 * std::tan(angle) - left_mm;
  const Eigen::Vector3d normal = about_y ? Eigen::Vector3d(-std::cos(angle), 0, std::sin(angle))
                                         : Eigen::Vector3d(-std::cos(angle), -std::sin(angle), 0);
  const TopoDS_Shape whole = Pipe(Hook(), {.wall_mm = 1.5});
  const TopoDS_Shape cut = test::Cut(whole, {x, 0, 0}, normal);
  return open ? test::WithoutEnds(cut) : cut;
}

TEST(CutBends, AMitreMayTouchTheBendOrGoIntoIt) {
  for (const bool open : {false, true}) {
    for (const bool about_y : {false, true}) {
      for (const double left_mm : {5.0, 0.01, 0.0, -3.0}) {
        SCOPED_TRACE(testing::Message() << open << about_y << " " << left_mm);
        const auto done =
            Nominal(test::WriteStepFile({{"hook", Mitred(45, left_mm, about_y, open)}}));
        hal::BendProgram expected = Hook().program;
        expected.rows[0].length_mm = 10 + left_mm;
        test::ExpectRows(done, expected, 1e-5);
        EXPECT_NEAR(done.json["ends"][0]["oblique_deg"], 45, 1e-3);
        EXPECT_EQ(done.json["ends"][0].value("cuts_bend", false), left_mm < 0);
        EXPECT_THAT(done.out, Not(HasSubstr("other faces")));  // the cut's own
        EXPECT_EQ(done.out.find("reaches into the bend") != std::string::npos, left_mm < 0);
      }
    }
  }
}

TEST(CutBends, ACutThroughTheAxisOfABendIsNoSquareEnd) {
  // On the axis 1.24 mm of the bend are missing.
  const auto part = Nominal(test::WriteStepFile({{"hook", Mitred(10, -3, false, false)}}));
  EXPECT_EQ(part.code, 3);
  EXPECT_THAT(part.err, HasSubstr("begins with a bend"));
  EXPECT_THAT(part.out, HasSubstr("first end: cut askew through the bend beside it"));
  // A bend that ends square is none that is cut through.
  hal::Tube bent = Hook();
  bent.program.rows[0].length_mm = 0;
  const auto square = Nominal(test::WriteStepFile({{"bent", Pipe(bent)}}));
  EXPECT_THAT(square.out, HasSubstr("first end: square\n"));
}

}  // namespace
}  // namespace bendloop::host
