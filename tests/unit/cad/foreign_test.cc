// SPDX-License-Identifier: Apache-2.0
// Nominals from what other CAD systems make of a tube of lines and arcs.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <string>
#include <utility>
#include <vector>

#include "foreign_files.h"
#include "made_files.h"
#include "run_nominal.h"
#include "step_text.h"

namespace bendloop::host {
namespace {

using test::Nominal;
using test::Outcome;
using ::testing::HasSubstr;
using ::testing::Not;
using Shapes = std::vector<std::pair<const char*, TopoDS_Shape>>;

hal::BendProgram InTheMirror(hal::BendProgram program) {
  for (hal::BendRow& row : program.rows) row.rotation_deg = hal::WrapRotationDeg(-row.rotation_deg);
  return program;
}

void ExpectDemo(const Shapes& shapes, double tolerance, bool has_wall) {
  for (const auto& [what, shape] : shapes) {
    SCOPED_TRACE(what);
    const Outcome done = Nominal(test::WriteStepFile({{"tube", shape}}));
    test::ExpectRows(done, test::DemoTube().program, tolerance);
    if (done.code != 0) continue;
    EXPECT_NEAR(done.part->pipe_radius_mm, 5, tolerance);
    EXPECT_NEAR(done.part->wall_mm.value_or(0), has_wall ? 1 : 0, tolerance) << done.out;
  }
}

TEST(Foreign, SurfacesThatAreCylindersAndToriByAnyName) {
  const TopoDS_Shape pipe = test::Pipe(test::DemoTube());
  ExpectDemo({{"quarters", test::WithoutSeams(pipe, 90)}}, 1e-5, true);
  ExpectDemo({{"extrusions", test::AsExtrusions(test::DemoTube())}}, 1e-5, false);
  for (const double degrees : {0.0, 4.0, 1.0, 0.2}) {
    SCOPED_TRACE(degrees);
    ExpectDemo({{"cut splines", test::AsCutSplines(test::DemoTube(), degrees)}}, 1e-5, false);
  }
  ExpectDemo({{"shell", test::AsShell(test::DemoTube())}}, 1e-5, false);
}

TEST(Foreign, BodiesOfATube) {
  const TopoDS_Shape pipe = test::Pipe(test::DemoTube());
  ExpectDemo({{"without ends, faces either way", test::WithoutEnds(pipe)},
              {"a solid each piece", test::InSolids(test::DemoTube(), 1, false)},
              {"solids with shared faces", test::InSolids(test::DemoTube(), 1, true)}},
             1e-5, true);
  ExpectDemo({{"a bar each piece", test::InSolids(test::DemoTube(), 0, false)}}, 1e-5, false);
  const Outcome mirrored = Nominal(test::WriteStepFile({{"tube", test::Mirrored(pipe)}}));
  test::ExpectRows(mirrored, InTheMirror(test::DemoTube().program));
  const auto wire =
      test::WriteStepFile({{"tube", test::AsNurbs(test::CentreLine(test::DemoTube()))}});
  test::ExpectRows(Nominal(wire, {"--pipe-diameter", "10"}), test::DemoTube().program, 1e-5);
}

// Faces that share no edges, halves beside each other, leave the ends what they are.
TEST(Foreign, EndsOfHalvesAreSquare) {
  hal::Tube flat = test::DemoTube();
  flat.program = {{{60, 0, 45, 20.0}, {40, 0, 60, 20.0}, {50, 0, 0, std::nullopt}}};
  test::StepStyle style;
  style.faces = test::FaceStyle::kHalves;
  style.body = test::BodyStyle::kLoose;
  const std::string loose = test::TemporaryFile("loose.step");
  std::ofstream(loose) << test::StepText(flat, style);
  const auto halves = Nominal(loose);
  test::ExpectRows(halves, flat.program);
  EXPECT_THAT(halves.out, HasSubstr("first end: square\nlast end: square\n"));
  const auto shells = Nominal(test::WriteStepFile({{"tube", test::InShells(test::Pipe(flat))}}));
  test::ExpectRows(shells, flat.program);
  EXPECT_THAT(shells.out, HasSubstr("first end: square\nlast end: square\n"));
}

TEST(Foreign, RingsHaveNoEnds) {
  for (const TopoDS_Shape& ring : {test::Ring(60, 5), test::WithoutSeams(test::Ring(60, 5), 90)}) {
    const Outcome done = Nominal(test::WriteStepFile({{"ring", ring}}));
    EXPECT_EQ(done.code, 3) << done.out;
    EXPECT_THAT(done.err, HasSubstr("no ends"));
  }
}

// A part placed by an operator, as systems place its mirror image.
std::string PlacedBy(const std::string& file, const char* scale, const char* third_axis) {
  std::string text;
  {
    std::ifstream in(file);
    text.assign(std::istreambuf_iterator<char>(in), {});
  }
  const std::string what = "ADVANCED_BREP_SHAPE_REPRESENTATION('',(#11,#15),";
  const std::size_t at = text.find(what);
  const std::string context =
      text.substr(at + what.size(), text.find(')', at + what.size()) - at - what.size());
  const std::string added =
      "#90000=" + what + context + ");\n#90001=REPRESENTATION_MAP(#11,#90000);\n" +
      "#90002=CARTESIAN_TRANSFORMATION_OPERATOR_3D('','',$,#90004,#90005,#90006," + scale +
      ",#90007);\n#90003=MAPPED_ITEM('',#90001,#90002);\n#90004=DIRECTION('',(1.,0.,0.));\n"
      "#90005=DIRECTION('',(0.,1.,0.));\n#90006=CARTESIAN_POINT('',(5.,6.,7.));\n"
      "#90007=DIRECTION('',(0.,0.," +
      third_axis + "));\nENDSEC;\nEND-ISO";
  const std::string placed = test::Edited(file, what, "SHAPE_REPRESENTATION('',(#11,#90003),");
  return test::Edited(placed, "ENDSEC;\nEND-ISO", added);
}

TEST(Foreign, PlacementsThatMirrorOrScaleAreRefused) {
  const hal::Tube tube = test::DemoTube();
  const auto placed = [&](const char* scale, const char* third_axis) {
    return Nominal(PlacedBy(test::WriteStepFile({{"tube", test::Pipe(tube)}}), scale, third_axis));
  };
  test::ExpectRows(placed("1.", "1."), tube.program);
  const auto mirrored = placed("1.", "-1."), scaled = placed("2.", "1.");
  EXPECT_EQ(mirrored.code, 3) << mirrored.out;
  EXPECT_THAT(mirrored.err, HasSubstr("#90002 mirrors it"));
  EXPECT_EQ(scaled.code, 3) << scaled.out;
  EXPECT_THAT(scaled.err, HasSubstr("#90002 scales it"));
}

// The file's text without the line that begins with the `number`-th entity of `kind`.
std::string Lacking(const std::string& file, const std::string& kind, int number) {
  std::ifstream in(file);
  std::string text{std::istreambuf_iterator<char>(in), {}};
  std::size_t at = 0;
  for (int i = 0; i < number; ++i) at = text.find(" = " + kind + "(", at + 1);
  const std::size_t from = text.rfind('\n', at) + 1;
  text.erase(from, text.find(";\n", at) + 2 - from);
  const std::string lacking = test::TemporaryFile("lacking.step");
  std::ofstream(lacking) << text;
  return lacking;
}

TEST(Foreign, SaysThatAFileIsDamaged) {
  const hal::Tube tube = test::DemoTube();
  const std::string file = test::WriteStepFile({{"tube", test::Pipe(tube)}});
  const auto face = Nominal(Lacking(file, "ADVANCED_FACE", 3));
  test::ExpectRows(face, tube.program, 1e-5);
  EXPECT_THAT(face.out, HasSubstr("cannot be built (it is damaged), or belong to no product: 1"));
  EXPECT_THAT(Nominal(file).out, Not(HasSubstr("damaged")));
  // Of a missing vertex or point OpenCASCADE may give up the whole product.
  for (const char* kind : {"VERTEX_POINT", "CARTESIAN_POINT", "EDGE_LOOP", "CYLINDRICAL_SURFACE"}) {
    for (const int number : {2, 5}) {
      SCOPED_TRACE(kind + std::to_string(number));
      const auto done = Nominal(Lacking(file, kind, number));
      if (done.code == 0) {
        test::ExpectRows(done, tube.program, 1e-5);
      } else {
        EXPECT_EQ(done.code, 3);
        EXPECT_THAT(done.err, HasSubstr("lacking.step: is damaged"));
      }
    }
  }
}

TEST(Foreign, TextsOfFiles) {
  const hal::Tube tube = test::DemoTube();
  const std::string file = test::WriteStepFile({{"tube", test::Pipe(tube)}}, "AP242DIS", "INCH");
  test::ExpectRows(Nominal(test::Edited(file, "SHAPE_DEFINITION_REPRESENTATION(", "COLOUR_RGB(")),
                   tube.program);
  test::ExpectRows(Nominal(test::Edited(file, "\n", "\r\n")), tube.program);
  for (const double part : {0.1, 0.9}) {
    SCOPED_TRACE(part);
    const auto size = std::filesystem::file_size(file);
    std::filesystem::copy_file(file, test::TemporaryFile("half.step"),
                               std::filesystem::copy_options::overwrite_existing);
    std::filesystem::resize_file(test::TemporaryFile("half.step"),
                                 std::uintmax_t(part * double(size)));
    const Outcome done = Nominal(test::TemporaryFile("half.step"));
    EXPECT_EQ(done.code, 3) << done.out << done.err;
    EXPECT_THAT(done.err, HasSubstr("damaged")) << done.err;
  }
}

}  // namespace
}  // namespace bendloop::host
