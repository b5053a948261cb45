// SPDX-License-Identifier: Apache-2.0
#include "pipeline/tube/representations.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "hal/spine.h"

namespace bendloop::pipeline {
namespace {

using hal::BendProgram;
using hal::Tube;
using ::testing::HasSubstr;

// A CAD system's bend machine report: one tube as points and as LRA.
ControlPolygon CadPolygon() {
  return {{{0, 0, 0},
           {0, 0, 1495.39},
           {0, 10100, 1495.39},
           {0, 10100, 3989.39},
           {5718.30, 10136.89, 3989.39}},
          {560.0, 560.0, 560.0}};
}

TEST(Polygon, GivesTheLraOfTheCadReport) {
  const auto tube = TubeFromPolygon(CadPolygon());
  ASSERT_TRUE(tube) << tube.error().message;
  const auto& rows = tube->program.rows;
  ASSERT_EQ(rows.size(), 4u);
  const double lengths[] = {935.39, 8980.00, 1374.00, 5158.42};
  const double rotations[] = {0, 180.00, 90.37, 0};
  for (int i = 0; i < 4; ++i) {
    EXPECT_NEAR(rows[i].length_mm, lengths[i], 0.01) << i;
    EXPECT_NEAR(rows[i].rotation_deg, rotations[i], 0.005) << i;
    EXPECT_NEAR(rows[i].angle_deg, i < 3 ? 90 : 0, 0.005) << i;
  }
  EXPECT_EQ(rows[1].bend_radius_mm, 560.0);
  EXPECT_EQ(rows[3].bend_radius_mm, std::nullopt);
}

TEST(Polygon, ComesBackFromTheTube) {
  const auto tube = TubeFromPolygon(CadPolygon());
  ASSERT_TRUE(tube);
  const auto polygon = PolygonFromTube(*tube);
  ASSERT_TRUE(polygon);
  ASSERT_EQ(polygon->points_mm.size(), 5u);
  for (int i = 0; i < 5; ++i) {
    EXPECT_LT((polygon->points_mm[i] - CadPolygon().points_mm[i]).norm(), 1e-8) << i;
  }
  EXPECT_EQ(polygon->bend_radii_mm, CadPolygon().bend_radii_mm);
}

TEST(Polygon, OfTheTubeFrameBendsFirstTowardsPlusY) {
  const Tube tube{4, {{{50, 0, 90, 10.0}, {50, 90, 90, 10.0}, {50, 0, 0, {}}}}, {}};
  const auto polygon = PolygonFromTube(tube);
  ASSERT_TRUE(polygon);
  EXPECT_LT((polygon->points_mm[1] - Eigen::Vector3d(60, 0, 0)).norm(), 1e-9);
  EXPECT_LT((polygon->points_mm[2] - Eigen::Vector3d(60, 70, 0)).norm(), 1e-9);
  // N = z turned by +90 degrees about +y is +x, so the bend goes from +y towards x cross y = z.
  EXPECT_LT((polygon->points_mm[3] - Eigen::Vector3d(60, 70, 60)).norm(), 1e-9);
}

TEST(Polygon, KeepsTheSignOfTheRotation) {
  const ControlPolygon left{{{0, 0, 0}, {10, 0, 0}, {10, 10, 0}, {10, 10, 10}}, {{}, {}}};
  const ControlPolygon right{{{0, 0, 0}, {10, 0, 0}, {10, 10, 0}, {10, 10, -10}}, {{}, {}}};
  EXPECT_NEAR(TubeFromPolygon(left)->program.rows[1].rotation_deg, 90, 1e-9);
  EXPECT_NEAR(TubeFromPolygon(right)->program.rows[1].rotation_deg, -90, 1e-9);
}

TEST(Polygon, PointsOnAStraightAreRowsOfAngleZeroAndKeepTheRotationAcrossThem) {
  const ControlPolygon polygon{
      {{0, 0, 0}, {5, 0, 0}, {10, 0, 0}, {10, 5, 0}, {10, 10, 0}, {10, 10, 10}, {10, 10, 15}},
      {{}, {}, {}, {}, {}}};
  const auto tube = TubeFromPolygon(polygon);
  ASSERT_TRUE(tube);
  const auto& rows = tube->program.rows;
  EXPECT_EQ(rows[0].angle_deg, 0);
  EXPECT_NEAR(rows[1].angle_deg, 90, 1e-9);
  EXPECT_EQ(rows[2].angle_deg, 0);
  EXPECT_NEAR(rows[3].rotation_deg, 90, 1e-9);
  const auto back = PolygonFromTube(*tube);
  ASSERT_TRUE(back);
  for (std::size_t i = 0; i < polygon.points_mm.size(); ++i) {
    EXPECT_LT((back->points_mm[i] - polygon.points_mm[i]).norm(), 1e-9) << i;
  }
}

TEST(Polygon, OfAStraightTubeIsItsEnds) {
  const auto tube = TubeFromPolygon({{{1, 2, 3}, {1, 2, 10}}, {}});
  ASSERT_TRUE(tube);
  EXPECT_EQ(tube->program, (BendProgram{{{7, 0, 0, {}}}}));
  EXPECT_LT((tube->X_WT.orientation * Eigen::Vector3d::UnitX() - Eigen::Vector3d::UnitZ()).norm(),
            1e-12);
}

TEST(Polygon, RefusesBendsThatHaveNoIntersectionPoint) {
  for (const double angle : {180.0, 270.0}) {
    const auto polygon = PolygonFromTube({4, {{{50, 0, angle, 10.0}, {50, 0, 0, {}}}}, {}});
    ASSERT_FALSE(polygon);
    EXPECT_EQ(polygon.error().kind, hal::ErrorKind::kBadInput);
    EXPECT_THAT(polygon.error().message, HasSubstr("row 1"));
    EXPECT_THAT(polygon.error().message, HasSubstr("use LRA or pose"));
  }
}

TEST(Polygon, RefusesWhatIsNoTube) {
  const auto message = [](const ControlPolygon& polygon) {
    const auto tube = TubeFromPolygon(polygon);
    return tube ? std::string("accepted") : tube.error().message;
  };
  EXPECT_THAT(message({{{0, 0, 0}}, {}}), HasSubstr("1 point(s)"));
  EXPECT_THAT(message({{{0, 0, 0}, {1, 0, 0}, {1, 0, 0}}, {{}}}), HasSubstr("2 and 3 coincide"));
  EXPECT_THAT(message({{{0, 0, 0}, {9, 0, 0}, {3, 0, 0}}, {{}}}), HasSubstr("turns back"));
  EXPECT_THAT(message({{{0, 0, 0}, {9, 0, 0}, {9, 9, 0}}, {-2.0}}), HasSubstr("bend radius -2"));
  EXPECT_THAT(message({{{0, 0, 0}, {9, 0, 0}, {9, 9, 0}}, {}}), HasSubstr("expected one for each"));
  EXPECT_THAT(message({{{0, 0, 0}, {NAN, 0, 0}}, {}}), HasSubstr("point 2 is not a finite"));
  EXPECT_THAT(message({{{0, 0, 0}, {90, 0, 0}, {90, 15, 0}, {180, 15, 0}}, {10.0, 10.0}}),
              HasSubstr("points 2 and 3 are 15 mm apart, but the bends at them take 10 and 10 mm"));
}

TEST(Polygon, ForgivesARoundedStraightOfLengthZero) {
  const auto tube =
      TubeFromPolygon({{{0, 0, 0}, {90, 0, 0}, {90, 19.995, 0}, {180, 19.995, 0}}, {10.0, 10.0}});
  ASSERT_TRUE(tube) << tube.error().message;
  EXPECT_EQ(tube->program.rows[1].length_mm, 0);
}

TEST(Reverse, SwapsTheRowsAndKeepsTheSigns) {
  const BendProgram program{
      {{1, 0, 10, 100.0}, {2, 20, 30, 200.0}, {3, -40, 50, 300.0}, {4, 0, 0, {}}}};
  const BendProgram expected{
      {{4, 0, 50, 300.0}, {3, -40, 30, 200.0}, {2, 20, 10, 100.0}, {1, 0, 0, {}}}};
  EXPECT_EQ(ReverseProgram(program), expected);
  EXPECT_EQ(ReverseProgram(expected), program);
  EXPECT_EQ(ReverseProgram({}), BendProgram{});
}

TEST(Ybc, CountsFeedAndRotationAsTheMachineDoes) {
  const BendProgram program{
      {{100, 0, 90, 50.0}, {200, -90, 180, 50.0}, {300, -100, 45, 50.0}, {40, 0, 0, {}}}};
  const double pi = std::acos(-1.0);
  const auto along = YbcFromProgram(
      program, {FeedCount::kAlongSpine, RotationCount::kCumulative, /*rotation_sign=*/1});
  ASSERT_TRUE(along);
  EXPECT_NEAR((*along)[0].y_mm, 100, 1e-9);
  EXPECT_NEAR((*along)[1].y_mm, 300 + 25 * pi, 1e-9);
  EXPECT_NEAR((*along)[2].y_mm, 600 + 75 * pi, 1e-9);
  EXPECT_NEAR((*along)[3].y_mm, 640 + 87.5 * pi, 1e-9);
  EXPECT_NEAR((*along)[1].b_deg, 270, 1e-9);
  EXPECT_NEAR((*along)[2].b_deg, 170, 1e-9);
  EXPECT_NEAR((*along)[3].b_deg, 170, 1e-9);
  const auto mirrored = YbcFromProgram(
      program, {FeedCount::kStraights, RotationCount::kIncremental, /*rotation_sign=*/-1});
  ASSERT_TRUE(mirrored);
  EXPECT_EQ((*mirrored)[1], (YbcRow{300, 90, 180, 50.0}));
  EXPECT_EQ((*mirrored)[3].y_mm, 640);
}

TEST(Ybc, RefusesWhatItCannotCount) {
  const BendProgram no_radius{{{100, 0, 90, {}}, {40, 0, 0, {}}}};
  const auto along = YbcFromProgram(no_radius, {FeedCount::kAlongSpine, {}, 1});
  ASSERT_FALSE(along);
  EXPECT_THAT(along.error().message, HasSubstr("row 1"));
  EXPECT_THAT(along.error().message, HasSubstr("bend radius"));
  const auto back =
      ProgramFromYbc({{100, 0, 90, {}}, {40, 0, 0, {}}}, {FeedCount::kStraights, {}, 1});
  ASSERT_FALSE(back);
  EXPECT_THAT(back.error().message, HasSubstr("row 2: feed 40 mm lies before 100 mm"));
}

TEST(CheckProgram, NamesTheRowAndTheMend) {
  const auto message = [](const BendProgram& program) {
    const auto ok = CheckProgram(program);
    return ok ? std::string("accepted") : ok.error().message;
  };
  const double infinity = std::numeric_limits<double>::infinity();
  EXPECT_EQ(message({{{10, 0, 350, 20.0}, {0, 0, 0, {}}}}), "accepted");
  EXPECT_THAT(message({}), HasSubstr("no rows"));
  EXPECT_THAT(message({{{-1, 0, 0, {}}}}), HasSubstr("row 1: length -1 mm"));
  EXPECT_THAT(message({{{1, 0, 10, 5.0}, {infinity, 0, 0, {}}}}), HasSubstr("row 2: length inf"));
  EXPECT_THAT(message({{{1, NAN, 10, 5.0}, {1, 0, 0, {}}}}), HasSubstr("row 1: rotation nan"));
  EXPECT_THAT(message({{{1, 0, -10, 5.0}, {1, 0, 0, {}}}}), HasSubstr("rotation of 180 degrees"));
  EXPECT_THAT(message({{{1, 0, 360, 5.0}, {1, 0, 0, {}}}}), HasSubstr("angle 360"));
  EXPECT_THAT(message({{{1, 0, 10, 0.0}, {1, 0, 0, {}}}}), HasSubstr("bend radius 0"));
  EXPECT_THAT(message({{{1, 0, 10, 5.0}}}), HasSubstr("the last row bends by 10"));
}

}  // namespace
}  // namespace bendloop::pipeline
