// SPDX-License-Identifier: Apache-2.0
// What tubes are called, and files that say in their own way what they hold.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <STEPCAFControl_Writer.hxx>
#include <TDataStd_Name.hxx>
#include <TDocStd_Document.hxx>
#include <TopExp_Explorer.hxx>
#include <XCAFDoc_DocumentTool.hxx>
#include <XCAFDoc_ShapeTool.hxx>
#include <fstream>
#include <string>
#include <vector>

#include "firmware-host/console/whole_file.h"
#include "foreign_files.h"
#include "hal/spine.h"
#include "made_files.h"
#include "run_nominal.h"
#include "step_text.h"

namespace bendloop::host {
namespace {

using test::DemoTube;
using test::Nominal;
using ::testing::HasSubstr;

std::string Named(const std::string& name) {
  test::StepStyle style;
  style.name = name;
  const std::string file = test::TemporaryFile("named.step");
  std::ofstream(file) << test::StepText(DemoTube(), style);
  return file;
}

TEST(Names, OfWindows1251AreCyrillic) {
  // "Truba No. 3" in Russian, and a German word in Latin-1, as systems write them without escapes.
  const auto russian =
      Nominal(Named("\xd2\xf0\xf3\xe1\xe0 \xb9"
                    "3"));
  ASSERT_EQ(russian.code, 0) << russian.err;
  EXPECT_EQ(russian.part->name, "Труба №3");
  const auto german =
      Nominal(Named("K\xfchl\xf6lr\xfc"
                    "cklauf"));
  EXPECT_EQ(german.part->name, "Kühlölrücklauf");
}

TEST(Names, AreShortenedToWhatAPartFileHolds) {
  std::string name;
  for (int i = 0; i < 200; ++i) name += "\\X2\\00FC\\X0\\";
  const auto done = Nominal(Named(name));
  ASSERT_EQ(done.code, 0) << done.err;
  EXPECT_EQ(done.part->name.size(), 255u);
  EXPECT_THAT(done.part->name, HasSubstr("ü..."));
}

struct Part {
  std::string name, occurrence;
  TopoDS_Shape shape;
};

// An assembly of parts that lie as they are.
std::string AssemblyFile(const std::string& called, const std::vector<Part>& parts) {
  const Handle(TDocStd_Document) document = new TDocStd_Document("BinXCAF");
  const Handle(XCAFDoc_ShapeTool) tool = XCAFDoc_DocumentTool::ShapeTool(document->Main());
  const auto name = [](const TDF_Label& label, const std::string& text) {
    TDataStd_Name::Set(label, TCollection_ExtendedString(text.c_str(), true));
  };
  const TDF_Label assembly = tool->NewShape();
  name(assembly, called);
  for (const Part& part : parts) {
    const TDF_Label label = tool->AddShape(part.shape, false);
    name(label, part.name);
    name(tool->AddComponent(assembly, label, TopLoc_Location()), part.occurrence);
  }
  tool->UpdateAssemblies();
  const std::string file = test::TemporaryFile("assembly.step");
  STEPCAFControl_Writer writer;
  writer.Transfer(document);
  writer.Write(file.c_str());
  return file;
}

TEST(Names, ATubeThatAnAssemblyIsInPiecesIsCalledAsTheAssembly) {
  hal::Tube bow = DemoTube();
  bow.program.rows = {{60, 0, 45, 20.0}, {50, 0, 0, std::nullopt}};
  std::vector<Part> parts;
  const TopoDS_Shape solids = test::InSolids(bow, 1, false);
  for (TopExp_Explorer at(solids, TopAbs_SOLID); at.More(); at.Next()) {
    const std::string number = std::to_string(parts.size());
    parts.push_back({"PIECE-" + number, "PIECE-" + number, at.Current()});
  }
  const auto done = Nominal(AssemblyFile("Spool 12", parts));
  test::ExpectRows(done, bow.program);
  EXPECT_EQ(done.part->name, "Spool 12");
}

TEST(Names, ATubeIsFoundByWhatItsAssemblyCallsIt) {
  hal::Tube bow = DemoTube(), other = DemoTube();
  bow.program.rows = {{60, 0, 45, 20.0}, {50, 0, 0, std::nullopt}};
  other.X_WT.position_mm.z() = 200;
  const std::string file = AssemblyFile(
      "Rack", {{"tube", "Line A", test::Pipe(bow)}, {"tube", "Line B", test::Pipe(other)}});
  EXPECT_THAT(Nominal(file, {"--list"}).out, HasSubstr("placed as"));
  test::ExpectRows(Nominal(file, {"--body", "Line A"}), bow.program);
  test::ExpectRows(Nominal(file, {"--body", "Line B"}), other.program);
  EXPECT_EQ(Nominal(file, {"--body", "Line C"}).code, 2);
}

TEST(Names, TubesEndToEndAreListedAsThat) {
  // Each has a straight where they meet: two parts, or one that is welded.
  hal::Tube first = DemoTube(), second = DemoTube();
  first.program.rows = {{60, 0, 45, 20.0}, {50, 0, 0, std::nullopt}};
  second.program.rows = {{50, 0, 90, 20.0}, {40, 0, 0, std::nullopt}};
  const auto last = hal::SpineSegments(first.program, first.X_WT).back();
  second.X_WT.position_mm = last.PointAt(last.length_mm + 0.5);
  second.X_WT.orientation = Eigen::Quaterniond(last.axes());
  const std::string file =
      AssemblyFile("line", {{"a", "a", test::Pipe(first)}, {"b", "b", test::Pipe(second)}});
  const auto several = Nominal(file);
  EXPECT_EQ(several.code, 2);
  EXPECT_THAT(several.err, HasSubstr("end to end with 2, 0.500 mm apart"));
  EXPECT_THAT(several.err, HasSubstr("end to end with 1, 0.500 mm apart"));
  EXPECT_THAT(Nominal(file, {"--body", "a"}).out,
              HasSubstr("tube 2 of the file (--list) goes on in line at the last end, 0.500 mm "
                        "behind it: it is not in the rows"));
}

TEST(Names, AFileWithoutItsLastLineIsRead) {
  const std::string file = test::WriteStepFile({{"tube", test::Pipe(DemoTube())}});
  test::ExpectRows(Nominal(test::Edited(file, "END-ISO-10303-21;", "")), DemoTube().program);
  // What ends within its data is damaged.
  const std::string text = *ReadWholeFile(file, std::size_t{1} << 30);
  const std::string torn = test::TemporaryFile("torn.step");
  std::ofstream(torn) << text.substr(0, text.size() / 2);
  EXPECT_THAT(Nominal(torn).err, HasSubstr("is damaged"));
}

TEST(Names, ShapesThatAreNotBuiltAreNamed) {
  for (const std::string entity : {"SWEPT_DISK_SOLID", "CSG_SOLID"}) {
    const std::string file = test::Edited(test::WriteStepFile({{"tube", test::Pipe(DemoTube())}}),
                                          "MANIFOLD_SOLID_BREP", entity);
    const auto done = Nominal(file);
    EXPECT_EQ(done.code, 3);
    EXPECT_THAT(done.err, HasSubstr("has its shape as " + entity));
  }
}

}  // namespace
}  // namespace bendloop::host
