// SPDX-License-Identifier: Apache-2.0
// Nominals from STEP and IGES files as other systems write them.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <iterator>
#include <map>
#include <nlohmann/json.hpp>
#include <random>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "config/load.h"
#include "firmware-host/cad/export_command.h"
#include "firmware-host/cad/tube_chain.h"
#include "hal/bend_program.h"
#include "hal/spine.h"
#include "made_files.h"
#include "pipeline/tube/representations.h"
#include "run_nominal.h"

namespace bendloop::host {
namespace {

using ::testing::HasSubstr;
using Json = nlohmann::json;
using test::DemoTube;
using test::ExpectRows;
using test::Nominal;
using test::Pipe;

TEST(Nominal, ReadsEverySchemaAndUnit) {
  for (const std::string schema : {"AP203", "AP214IS", "AP242DIS"}) {
    for (const std::string unit : {"MM", "INCH", "M"}) {
      SCOPED_TRACE(schema + " " + unit);
      const auto done =
          Nominal(test::WriteStepFile({{"Rohr \xc3\x84 1", Pipe(DemoTube())}}, schema, unit));
      ExpectRows(done, DemoTube().program);
      EXPECT_EQ(done.part->name, "Rohr \xc3\x84 1");
      EXPECT_NEAR(done.part->pipe_radius_mm, 5, 1e-6);
      EXPECT_NEAR(done.part->wall_mm.value_or(0), 1, 1e-6);
    }
  }
}

TEST(Nominal, ReadsBarsSplitFacesLooseFacesAndCentreLines) {
  const hal::Tube tube = DemoTube();
  const std::vector<std::pair<const char*, TopoDS_Shape>> shapes = {
      {"bar", Pipe(tube, {.wall_mm = 0})},
      {"halves", Pipe(tube, {.cuts = 1})},
      {"quarters", Pipe(tube, {.cuts = 2})},
      {"loose faces", test::LooseFaces(Pipe(tube))},
      {"a face is missing", test::LooseFaces(Pipe(tube), {2})},
      {"another face is missing", test::LooseFaces(Pipe(tube), {7})},
      {"reversed", Pipe(tube).Reversed()},
      {"centre line", test::CentreLine(tube)}};
  for (const auto& [what, shape] : shapes) {
    SCOPED_TRACE(what);
    const bool wire = what == std::string("centre line");
    const std::vector<std::string> words =
        wire ? std::vector<std::string>{"--pipe-diameter", "10"} : std::vector<std::string>{};
    const auto done = Nominal(test::WriteStepFile({{"tube", shape}}), words);
    ExpectRows(done, tube.program);
    if (done.code == 0) {
      EXPECT_NEAR(done.part->pipe_radius_mm, 5, 1e-6);
    }
    ExpectRows(Nominal(test::WriteIgesFile(shape), words), tube.program, 1e-5);
  }
}

TEST(Nominal, TakesTheOtherEndWhenAsked) {
  const auto file = test::WriteStepFile({{"tube", Pipe(DemoTube())}});
  ExpectRows(Nominal(file, {"--reverse"}), pipeline::ReverseProgram(DemoTube().program));
}

TEST(Nominal, ListsTheTubesOfAnAssembly) {
  hal::Tube other = DemoTube();
  other.program.rows.pop_back();
  other.program.rows.back() = {70, 0, 0, std::nullopt};
  hal::Tube straight;
  straight.pipe_radius_mm = 8;
  straight.program = {{{200, 0, 0, std::nullopt}}};
  const auto file = test::WriteStepFile(
      {{"feed", Pipe(DemoTube())},
       {"return", Pipe(other)},
       {"rail", Pipe(straight)},
       {"block", test::Drilled(Pipe(straight, {.wall_mm = 0}), {50, -20, 0}, {50, 20, 0}, 3)}});
  const auto none = Nominal(file);
  EXPECT_EQ(none.code, 2);
  EXPECT_THAT(none.err, HasSubstr("return"));
  EXPECT_EQ(Nominal(file, {"--body", "retrun"}).code, 2);
  const auto feed = Nominal(file, {"--body", "feed"});
  const bool turned = feed.code == 0 && std::abs(feed.part->rows.rows[0].length_mm - 60) > 1;
  ExpectRows(feed, turned ? pipeline::ReverseProgram(DemoTube().program) : DemoTube().program);
  EXPECT_EQ(Nominal(file, {"--body", "2"}).part->rows.rows.size(), other.program.rows.size());
  // A part file has at least one bend.
  EXPECT_THAT(Nominal(file, {"--body", "rail"}).err, HasSubstr("it is straight"));
}

TEST(Nominal, FindsHolesSlotsObliqueCutsAndFittings) {
  hal::Tube tube;
  tube.pipe_radius_mm = 10;
  tube.program = {{{100, 0, 90, 30.0}, {80, 0, 0, std::nullopt}}};
  // A hole on the outside of the bend's plane (-y), a cut 20 degrees oblique at the first end.
  TopoDS_Shape shape = test::Drilled(Pipe(tube, {.wall_mm = 2}), {40, 0, 0}, {40, -30, 0}, 3);
  shape = test::Drilled(shape, {70, 0, 0}, {70, 0, 30}, 2);
  const double a = 20 * M_PI / 180;
  shape = test::Cut(shape, {10, 0, 0}, {-std::cos(a), std::sin(a), 0});
  shape = test::WithCollar(shape, {130, 95, 0}, {130, 110, 0}, 15, 8);
  const auto done = Nominal(test::WriteStepFile({{"tube", shape}}));
  ExpectRows(done, {{{90, 0, 90, 30.0}, {80, 0, 0, std::nullopt}}});
  ASSERT_EQ(done.code, 0) << done.err;
  EXPECT_NEAR(done.json["ends"][0]["oblique_deg"].get<double>(), 20, 1e-3) << done.out;
  EXPECT_THAT(done.out, HasSubstr("first end: cut 20.000 degrees oblique, longest at 90.00 degrees "
                                  "around; the length is along the axis"));
  EXPECT_THAT(done.out, HasSubstr("degrees around are right-handed about the feed, from the normal "
                                  "of the bend there or last before (before the first bend: of "
                                  "the first); 90 is that bend's outside"));
  EXPECT_NEAR(done.part->ends.first.obliquity_deg, 20, 1e-3);
  EXPECT_NEAR(done.part->ends.first.around_deg, 90, 1e-2);
  EXPECT_EQ(done.part->ends.last, hal::EndCut());
  EXPECT_NEAR(done.json["ends"][1]["plain_tube_ends_before_mm"].get<double>(), 15, 1e-3)
      << done.out;
  ASSERT_EQ(done.json["openings"].size(), 2U) << done.out;
  const Json hole = done.json["openings"][0];
  EXPECT_NEAR(hole["along_mm"].get<double>(), 30, 1e-3);
  EXPECT_NEAR(hole["around_deg"].get<double>(), 90, 1e-2);
  EXPECT_NEAR(hole["width_mm"].get<double>(), 6, 1e-6);
  EXPECT_NEAR(done.json["openings"][1]["around_deg"].get<double>(), 0, 1e-2);
  ASSERT_EQ(done.part->holes.size(), 2U);
  EXPECT_NEAR(done.part->holes[0].from_start_mm.value_or(0), 30, 1e-3);
  EXPECT_NEAR(done.part->holes[0].around_deg, 90, 1e-2);
  EXPECT_NEAR(done.part->holes[1].width_mm, 4, 1e-6);
}

// Not 3.1999999999999997.
TEST(Nominal, APartFileShowsNoMoreDecimalsThanItHas) {
  hal::Tube tube;
  tube.pipe_radius_mm = 24.15;
  tube.program = {{{200, 0, 75, 124.15}, {300, 0, 0, std::nullopt}}};
  const auto done = Nominal(test::WriteStepFile({{"tube", Pipe(tube, {.wall_mm = 3.2})}}));
  ASSERT_TRUE(done.part) << done.err;
  EXPECT_EQ(done.part->wall_mm, 3.2);
}

TEST(Nominal, HalfATurnAroundIsPositive) {
  hal::Tube tube;
  tube.pipe_radius_mm = 10;
  tube.program = {{{100, 0, 90, 30.0}, {80, 0, 0, std::nullopt}}};
  // Opposite the bend's normal, and a hair beyond it.
  for (const double y : {0.0, 1e-9, -1e-9}) {
    const auto done = Nominal(test::WriteStepFile(
        {{"tube", test::Drilled(Pipe(tube, {.wall_mm = 2}), {40, 0, 0}, {40, y, -30}, 3)}}));
    ASSERT_EQ(done.json["openings"].size(), 1U) << done.out;
    EXPECT_EQ(done.json["openings"][0]["around_deg"].get<double>(), 180) << y;
  }
}

// What the file shows is not talked over.
TEST(Nominal, TakesNoWallAndDiameterWhereTheFileHasThem) {
  const auto file = test::WriteStepFile({{"tube", Pipe(DemoTube())}});
  const auto wall = Nominal(file, {"--wall", "2"});
  EXPECT_EQ(wall.code, 2);
  EXPECT_THAT(wall.err,
              HasSubstr("--wall 2.000: the file shows a wall of 1.000 mm; leave --wall out"));
  const auto wide = Nominal(file, {"--pipe-diameter", "30"});
  EXPECT_EQ(wide.code, 2);
  EXPECT_THAT(wide.err,
              HasSubstr("--pipe-diameter 30.000: the file shows a pipe of 10.000 mm; leave "
                        "--pipe-diameter out"));
  EXPECT_EQ(Nominal(file, {"--wall", "1", "--pipe-diameter", "10"}).code, 0);
}

TEST(Nominal, SaysWhatIsNoTubeOfLinesAndArcs) {
  // A mitre: two straights without a bend.
  hal::Tube a, b;
  a.pipe_radius_mm = b.pipe_radius_mm = 5;
  a.program = b.program = {{{100, 0, 0, std::nullopt}}};
  b.X_WT.position_mm = {100, 0, 0};
  b.X_WT.orientation = Eigen::AngleAxisd(M_PI / 3, Eigen::Vector3d::UnitZ());
  const Eigen::Vector3d mitre(std::cos(M_PI / 6), std::sin(M_PI / 6), 0);
  a.program.rows[0].length_mm = 110;
  b.X_WT.position_mm -= 10 * (b.X_WT.orientation * Eigen::Vector3d::UnitX());
  b.program.rows[0].length_mm = 110;
  const TopoDS_Shape left = test::Cut(Pipe(a), {100, 0, 0}, mitre);
  const TopoDS_Shape right = test::Cut(Pipe(b), {100, 0, 0}, -mitre);
  const auto kink = Nominal(test::WriteStepFile({{"frame", test::Joined(left, right)}}));
  EXPECT_EQ(kink.code, 3);
  EXPECT_THAT(kink.err, HasSubstr("kink of 60.000 degrees (a mitre) at x "));
  // The lines and arcs nearest to it end where it does, and not where it is broken.
  const auto nearest =
      Nominal(test::WriteStepFile({{"frame", test::Joined(left, right)}}), {"--nearest"});
  ASSERT_EQ(nearest.code, 0) << nearest.err;
  EXPECT_THAT(nearest.out, HasSubstr("first end: square\nlast end: square\n"));
  const auto& rows = nearest.part->rows.rows;
  ASSERT_EQ(rows.size(), 2U);
  const double corner_mm = *rows[0].bend_radius_mm * std::tan(M_PI / 6);
  EXPECT_NEAR(rows[0].length_mm + corner_mm, 100, 0.02);
  EXPECT_NEAR(rows[1].length_mm + corner_mm, 100, 0.02);
  EXPECT_EQ(Nominal("/no/such/file.step").code, 3);
  const std::string file = test::TemporaryFile("bad.step");
  std::ofstream(file) << "ISO-10303-21;\nHEADER;\nnonsense";
  EXPECT_EQ(Nominal(file).code, 3);
}

TEST(Nominal, GivesTheNearestArcsOfWhatHasNone) {
  const auto file = test::WriteStepFile({{"hose", test::SplineHose(5)}});
  const auto refused = Nominal(file);
  EXPECT_EQ(refused.code, 3);
  EXPECT_THAT(refused.err, HasSubstr("--nearest"));
  const auto nearest = Nominal(file, {"--nearest"});
  ASSERT_EQ(nearest.code, 0) << nearest.err;
  EXPECT_NEAR(nearest.part->pipe_radius_mm, 5, 0.05);
  EXPECT_THAT(nearest.out, HasSubstr("these are the nearest"));
  // The quartic through its points is 284.4 mm long; once 7 bends of 790 mm were "0.4 mm off".
  EXPECT_NEAR(hal::SpineLength(nearest.part->rows), 284.4, 6);
}

// `bendloop export` of a part file, with its files beside it.
int Export(const std::string& file, const std::string& folder, std::string& said) {
  CLI::App app("test");
  app.name("bendloop");
  std::function<int()> run;
  std::ostringstream err;
  AddExportCommand(app, run, err);
  std::vector<std::string> words = {"export",         file,           "--step",
                                    folder + ".step", "--dxf",        folder + ".dxf",
                                    "--csv",          folder + ".csv"};
  std::reverse(words.begin(), words.end());
  app.parse(words);
  const int code = run();
  said = err.str();
  return code;
}

TEST(Export, ComesBackAsTheSameTube) {
  hal::Tube tube = DemoTube();
  tube.program.rows[3].angle_deg = 170;
  const auto first = Nominal(test::WriteStepFile({{"Rohr \xc3\x84 1", Pipe(tube)}}));
  ASSERT_EQ(first.code, 0) << first.err;
  const std::string out = test::TemporaryFile("out");
  std::string said;
  ASSERT_EQ(Export(first.part->file.string(), out, said), 0) << said;
  const auto again = Nominal(out + ".step");
  ExpectRows(again, first.part->rows, 2e-7);
  ASSERT_EQ(again.code, 0) << again.err;
  EXPECT_EQ(again.part->name, "Rohr \xc3\x84 1");
  EXPECT_NEAR(again.part->wall_mm.value_or(0), 1, 1e-6);
  const auto wire = Nominal(out + ".step", {"--body", "2", "--pipe-diameter", "10"});
  ExpectRows(wire, first.part->rows, 2e-7);
  std::ifstream csv(out + ".csv"), dxf(out + ".dxf");
  const std::string corners{std::istreambuf_iterator<char>(csv), {}};
  EXPECT_EQ(std::count(corners.begin(), corners.end(), '\n'), 7);
  const std::string drawing{std::istreambuf_iterator<char>(dxf), {}};
  EXPECT_THAT(drawing, HasSubstr("\nARC\n8\nCENTRELINE\n"));
  EXPECT_THAT(drawing, HasSubstr("\nPOLYLINE\n8\nCORNERS\n"));
}

using Groups = std::vector<std::pair<int, std::string>>;

// The group codes of a DXF file with their values.
Groups ReadDxf(const std::string& file) {
  Groups groups;
  std::ifstream in(file);
  for (std::string code, value; std::getline(in, code) && std::getline(in, value);) {
    groups.emplace_back(std::stoi(code), value);
  }
  return groups;
}

Eigen::Vector3d PointAt(const std::map<int, double>& values, int code) {
  return {values.at(code), values.at(code + 10), values.at(code + 20)};
}

// Both ends of a LINE or an ARC, whose frame the DXF reference derives from its normal.
std::pair<Eigen::Vector3d, Eigen::Vector3d> EndsOf(const std::string& kind,
                                                   const std::map<int, double>& values) {
  if (kind == "LINE") return {PointAt(values, 10), PointAt(values, 11)};
  const Eigen::Vector3d n = PointAt(values, 210), c = PointAt(values, 10);
  const bool near_z = std::abs(n.x()) < 1.0 / 64 && std::abs(n.y()) < 1.0 / 64;
  Eigen::Matrix3d frame;
  frame.col(0) =
      (near_z ? Eigen::Vector3d::UnitY() : Eigen::Vector3d::UnitZ()).cross(n).normalized();
  frame.col(1) = n.cross(frame.col(0));
  frame.col(2) = n;
  const auto at = [&](double deg) -> Eigen::Vector3d {
    const double a = deg * M_PI / 180, r = values.at(40);
    return frame * (c + Eigen::Vector3d(r * std::cos(a), r * std::sin(a), 0));
  };
  return {at(values.at(50)), at(values.at(51))};
}

TEST(Export, DrawingsAreTheCentreLineToAMillionth) {
  const hal::Tube tube = DemoTube();
  const auto first = Nominal(test::WriteStepFile({{"tube", Pipe(tube)}}));
  ASSERT_EQ(first.code, 0) << first.err;
  const std::string out = test::TemporaryFile("drawn");
  std::string said;
  ASSERT_EQ(Export(first.part->file.string(), out, said), 0) << said;
  std::vector<std::pair<Eigen::Vector3d, Eigen::Vector3d>> drawn;
  const Groups groups = ReadDxf(out + ".dxf");
  for (std::size_t i = 0; i < groups.size(); ++i) {
    if (groups[i].first != 0 || (groups[i].second != "LINE" && groups[i].second != "ARC")) continue;
    std::map<int, double> values;
    for (std::size_t k = i + 1; k < groups.size() && groups[k].first != 0; ++k) {
      if (groups[k].first >= 10) values[groups[k].first] = std::stod(groups[k].second);
    }
    drawn.push_back(EndsOf(groups[i].second, values));
  }
  const Spine spine = SpineOf(tube);
  std::vector<Eigen::Vector3d> joints{spine.start};
  for (const SpineArc& arc : spine.arcs) {
    if ((arc.from - joints.back()).norm() > 1e-9) joints.push_back(arc.from);
    joints.push_back(arc.to);
  }
  joints.push_back(spine.end);
  ASSERT_EQ(drawn.size() + 1, joints.size());
  for (std::size_t i = 0; i < drawn.size(); ++i) {
    SCOPED_TRACE(i);
    EXPECT_LT((drawn[i].first - joints[i]).norm(), 1e-6);
    EXPECT_LT((drawn[i].second - joints[i + 1]).norm(), 1e-6);
  }
  // The corners: each line is a point, but for what says what it is.
  const auto polygon = pipeline::PolygonFromTube(tube);
  ASSERT_TRUE(polygon);
  std::ifstream csv(out + ".csv");
  std::vector<Eigen::Vector3d> corners;
  for (std::string line; std::getline(csv, line);) {
    Eigen::Vector3d p;
    if (std::sscanf(line.c_str(), "%lf,%lf,%lf", &p.x(), &p.y(), &p.z()) == 3) corners.push_back(p);
  }
  ASSERT_EQ(corners.size(), polygon->points_mm.size());
  for (std::size_t i = 0; i < corners.size(); ++i) {
    EXPECT_LT((corners[i] - polygon->points_mm[i]).norm(), 1e-6);
  }
}

constexpr const char* kUnits[] = {"MM", "INCH", "M"};

void ExpectSameRows(const hal::BendProgram& rows, const hal::BendProgram& expected) {
  ASSERT_EQ(rows.rows.size(), expected.rows.size());
  for (std::size_t i = 0; i < rows.rows.size(); ++i) {
    const hal::BendRow &row = rows.rows[i], &other = expected.rows[i];
    EXPECT_NEAR(row.length_mm, other.length_mm, 1e-6);
    EXPECT_NEAR(row.angle_deg, other.angle_deg, 1e-6);
    EXPECT_NEAR(hal::WrapRotationDeg(row.rotation_deg - other.rotation_deg), 0, 1e-6);
    EXPECT_NEAR(row.bend_radius_mm.value_or(0), other.bend_radius_mm.value_or(0), 1e-6);
  }
}

// XYZ, LRA, YBC and STEP of one part are one nominal.
TEST(Nominal, IsTheSameFromEveryRepresentation) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> unit(0, 1);
  for (int k = 0; k < 12; ++k) {
    SCOPED_TRACE(k);
    hal::Tube tube;
    tube.pipe_radius_mm = 2 + 8 * unit(random);
    const int bends = 1 + k % 5;
    for (int i = 0; i < bends; ++i) {
      // Between bends straights may be short, in every other tube.
      const double straight = i > 0 && k % 2 == 1 ? 2 * unit(random) : 20 + 100 * unit(random);
      tube.program.rows.push_back({straight, i == 0 ? 0 : 360 * unit(random) - 180,
                                   5 + 140 * unit(random),
                                   tube.pipe_radius_mm * (1.5 + 2 * unit(random))});
    }
    tube.program.rows.push_back({20 + 100 * unit(random), 0, 0, std::nullopt});
    // Random tubes run into themselves, which a solid bar may.
    const auto file =
        test::WriteStepFile({{"tube", Pipe(tube, {.wall_mm = 0})}}, "AP214IS", kUnits[k % 3]);
    ExpectRows(Nominal(file), tube.program, 2e-6);
    const auto polygon = pipeline::PolygonFromTube(tube);
    ASSERT_TRUE(polygon);
    const auto from_xyz = pipeline::TubeFromPolygon(*polygon);
    ASSERT_TRUE(from_xyz);
    const auto ybc = pipeline::YbcFromProgram(from_xyz->program, {});
    ASSERT_TRUE(ybc);
    const auto from_ybc = pipeline::ProgramFromYbc(*ybc, {});
    ASSERT_TRUE(from_ybc);
    ExpectSameRows(from_xyz->program, tube.program);
    ExpectSameRows(*from_ybc, tube.program);
  }
}

}  // namespace
}  // namespace bendloop::host
