// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "config/load.h"
#include "config_text.h"

namespace bendloop::config {
namespace {

using ::testing::HasSubstr;

const std::string kHead = R"(schema = "bendloop.part/1"
name = "part"
part_number = 7
pipe_radius_mm = 5
bend_radius_mm = 20
)";
const std::string kRows = R"([[row]]
length_mm = 50
angle_deg = 90
[[row]]
length_mm = 0
rotation_deg = -180
angle_deg = 190.5
bend_radius_mm = 30
[[row]]
length_mm = 40
)";
const std::string kPoints = R"([nominal]
xyz_mm = [[0, 0, 0],
 [100, 0, 0],
 [100, 80.5, 0]]
)";

std::string PartErrorOf(const std::string& toml) {
  const auto part = ParsePart(toml, "part.toml");
  EXPECT_FALSE(part) << toml;
  return part ? "" : part.error().message;
}

TEST(Part, ReadsRows) {
  const auto part = ParsePart(kHead + kRows +
                                  "[tolerance]\nangle_deg = 0.2\n[material]\n"
                                  "springback_at_120_deg = 3\n",
                              "part.toml");
  ASSERT_TRUE(part) << part.error().message;
  EXPECT_EQ(part->part_number, 7u);
  ASSERT_EQ(part->rows.rows.size(), 3u);
  EXPECT_EQ(part->rows.rows[0], (hal::BendRow{50, 0, 90, 20.0}));
  EXPECT_EQ(part->rows.rows[1], (hal::BendRow{0, 180, 190.5, 30.0}));
  EXPECT_EQ(part->rows.rows[2], (hal::BendRow{40, 0, 0, {}}));
  EXPECT_TRUE(part->xyz_mm.empty());
  EXPECT_EQ(part->tolerance.angle_deg, 0.2);
  EXPECT_EQ(part->tolerance.length_mm, Tolerances().length_mm);
  EXPECT_EQ(part->material.springback_at_120_deg, 3.0);
}

TEST(Part, ReadsHolesSlotsAndEnds) {
  const auto part = ParsePart(kHead + kRows + R"([[hole]]
from_start_mm = 20
around_deg = 90
diameter_mm = 4
lean_around_deg = -22.5
[[slot]]
from_end_mm = 15
around_deg = -30
length_mm = 9
width_mm = 3
axis_deg = 45
size_tolerance_mm = 0.1
[end]
last_obliquity_deg = 30
last_around_deg = 180
obliquity_tolerance_deg = 1
)",
                              "part.toml");
  ASSERT_TRUE(part) << part.error().message;
  ASSERT_EQ(part->holes.size(), 1u);
  EXPECT_EQ(part->holes[0].from_start_mm, 20.0);
  EXPECT_EQ(part->holes[0].length_mm, 4);
  EXPECT_EQ(part->holes[0].width_mm, 4);
  EXPECT_EQ(part->holes[0].lean_along_deg, 0);
  EXPECT_EQ(part->holes[0].lean_around_deg, -22.5);
  ASSERT_EQ(part->slots.size(), 1u);
  EXPECT_EQ(part->slots[0].from_end_mm, 15.0);
  EXPECT_EQ(part->slots[0].axis_deg, 45);
  EXPECT_EQ(part->slots[0].size_tolerance_mm, 0.1);
  EXPECT_EQ(part->ends.last, (hal::EndCut{30, 180}));
  EXPECT_EQ(part->ends.first, hal::EndCut());
  EXPECT_EQ(part->ends.obliquity_tolerance_deg, 1.0);
}

TEST(Part, NamesHolesAndSlotsThatCannotBe) {
  const std::string hole = "[[hole]]\naround_deg = 0\n";
  EXPECT_THAT(PartErrorOf(kHead + kRows + hole + "diameter_mm = 4\n"),
              HasSubstr("hole[1].from_start_mm"));
  EXPECT_THAT(
      PartErrorOf(kHead + kRows + hole + "diameter_mm = 4\nfrom_start_mm = 1\nfrom_end_mm = 2\n"),
      HasSubstr("found it and from_end_mm"));
  EXPECT_THAT(PartErrorOf(kHead + kRows + hole + "diameter_mm = 11\nfrom_start_mm = 1\n"),
              HasSubstr("less than the pipe's diameter of 10 mm"));
  EXPECT_THAT(
      PartErrorOf(kHead + kRows +
                  "[[slot]]\naround_deg = 0\nfrom_end_mm = 9\nlength_mm = 3\nwidth_mm = 3\n"),
      HasSubstr("is a [[hole]]"));
}

TEST(Part, ReadsPoints) {
  const auto part =
      ParsePart(With(kHead, "pipe_radius_mm = 5", "pipe_diameter_mm = 9") + kPoints, "part.toml");
  ASSERT_TRUE(part) << part.error().message;
  EXPECT_EQ(part->pipe_radius_mm, 4.5);
  EXPECT_TRUE(part->rows.rows.empty());
  ASSERT_EQ(part->xyz_mm.size(), 3u);
  EXPECT_EQ(part->xyz_mm[2], Eigen::Vector3d(100, 80.5, 0));
}

TEST(Part, EitherRadiusOrDiameterEitherRowsOrPoints) {
  EXPECT_THAT(PartErrorOf(kHead), HasSubstr("expected either [[row]] tables (LRA) or [nominal]"));
  EXPECT_THAT(PartErrorOf(kHead + kRows + kPoints), HasSubstr("found both [[row]] and [nominal]"));
  EXPECT_THAT(PartErrorOf("pipe_diameter_mm = 10\n" + kHead + kRows),
              HasSubstr("key 'pipe_radius_mm': found it and pipe_diameter_mm"));
  EXPECT_THAT(PartErrorOf(With(kHead, "pipe_radius_mm = 5\n", "") + kRows),
              HasSubstr("key 'pipe_radius_mm': found nothing, expected either"));
}

TEST(Part, RowsMustBeATube) {
  EXPECT_EQ(PartErrorOf(kHead + With(kRows, "angle_deg = 90\n", "")),
            "part.toml:6: key 'row[1].angle_deg': found 0, expected a bend of at least 0.1; only "
            "the last row has no bend");
  EXPECT_EQ(PartErrorOf(kHead + kRows + "angle_deg = 45"),
            "part.toml:16: key 'row[3].angle_deg': found 45, expected 0: the last row is the end "
            "length; add a row after this one for the straight behind the last bend");
  EXPECT_THAT(PartErrorOf(kHead + With(kRows, "length_mm = 40", "length_mm = 0")),
              HasSubstr("part.toml:15: key 'row[3].length_mm': found 0, expected more than 0"));
  EXPECT_THAT(
      PartErrorOf(kHead + With(kRows, "angle_deg = 90", "angle_deg = 90\nrotation_deg = 5")),
      HasSubstr("key 'row[1].rotation_deg': found 5, expected 0"));
  EXPECT_THAT(PartErrorOf(With(kHead, "bend_radius_mm = 20\n", "") + kRows),
              HasSubstr("key 'row[1].bend_radius_mm': found nothing, expected the bend radius"));
  EXPECT_THAT(PartErrorOf(kHead + With(kRows, "bend_radius_mm = 30", "bend_radius_mm = 4.5")),
              HasSubstr("found 4.5, expected more than the pipe radius of 5 mm"));
  EXPECT_THAT(PartErrorOf(kHead + "[[row]]\nlength_mm = 5\n"), HasSubstr("found 1 row"));
  EXPECT_THAT(PartErrorOf(kHead + "row = []\n"), HasSubstr("found no row"));
  EXPECT_THAT(PartErrorOf(kHead + With(kRows, "angle_deg = 90", "angle = 90")),
              HasSubstr("did you mean 'angle_deg'?"));
  EXPECT_THAT(PartErrorOf(kHead + With(kRows, "angle_deg = 90", "angle_deg = -inf")),
              HasSubstr("found -inf, expected a number from 0 to less than 360"));
}

TEST(Part, PointsMustLeaveRoomForTheBends) {
  EXPECT_THAT(PartErrorOf(With(kHead, "bend_radius_mm = 20", "bend_radius_mm = 90") + kPoints),
              HasSubstr("part.toml:9: key 'nominal.xyz_mm[3]': found this point 80.5 mm from the "
                        "one before, expected at least 90 mm"));
  EXPECT_THAT(PartErrorOf(kHead + With(kPoints, "[100, 0, 0]", "[0, 0, 0]")),
              HasSubstr("part.toml:8: key 'nominal.xyz_mm[2]': found the same point twice"));
  EXPECT_THAT(PartErrorOf(kHead + With(kPoints, "[100, 80.5, 0]", "[200, 0, 0]")),
              HasSubstr("key 'nominal.xyz_mm[2]': found a bend of 0 degrees"));
  EXPECT_THAT(PartErrorOf(kHead + With(kPoints, "[100, 80.5, 0]", "[100, 80.5]")),
              HasSubstr("found an array of 2, expected three numbers [x, y, z]"));
  EXPECT_THAT(PartErrorOf(kHead + With(kPoints, "[100, 80.5, 0]", "[100, \"80\", 0]")),
              HasSubstr("found the text '80' for y, expected a number"));
  EXPECT_THAT(PartErrorOf(kHead + "[nominal]\nxyz_mm = [[0, 0, 0], [1, 1, 1]]\n"),
              HasSubstr("found 2 points, expected at least 3"));
}

TEST(Part, WrongUnitsAreOutOfRange) {
  EXPECT_THAT(PartErrorOf(With(kHead, "pipe_radius_mm = 5", "pipe_radius_mm = 4000") + kRows),
              HasSubstr("found 4000, expected a number from 0.5 to 500"));
  EXPECT_THAT(PartErrorOf(With(kHead, "pipe_radius_mm = 5", "pipe_radius_mm = 0.005") + kRows),
              HasSubstr("found 0.005, expected a number from 0.5 to 500"));
}

TEST(Part, TooManyRowsAreRefused) {
  std::string rows;
  for (int i = 0; i < 300; ++i) rows += "[[row]]\nlength_mm = 50\nangle_deg = 10\n";
  EXPECT_THAT(PartErrorOf(kHead + rows + "[[row]]\nlength_mm = 5\n"),
              HasSubstr("key 'row': found 301, expected at most 200"));
}

}  // namespace
}  // namespace bendloop::config
