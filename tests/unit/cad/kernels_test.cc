// SPDX-License-Identifier: Apache-2.0
// Nominals from STEP as kernels other than OpenCASCADE write it.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <string>

#include "made_files.h"
#include "run_nominal.h"
#include "step_text.h"

namespace bendloop::host {
namespace {

using test::BodyStyle;
using test::DemoTube;
using test::FaceStyle;
using test::Nominal;
using test::StepStyle;
using test::SurfaceStyle;
using ::testing::HasSubstr;

std::string Written(const std::string& text, const std::string& name = "kernel.step") {
  const std::string file = test::TemporaryFile(name);
  std::ofstream(file, std::ios::binary) << text;
  return file;
}

test::Outcome NominalOf(const StepStyle& style, const hal::Tube& tube = DemoTube()) {
  return Nominal(Written(test::StepText(tube, style)));
}

TEST(Kernels, FacesWithAndWithoutSeams) {
  for (const FaceStyle faces : {FaceStyle::kNoSeam, FaceStyle::kHalves}) {
    SCOPED_TRACE(int(faces));
    StepStyle style;
    style.faces = faces;
    test::ExpectRows(NominalOf(style), DemoTube().program);
    style.body = BodyStyle::kOpenShell;
    test::ExpectRows(NominalOf(style), DemoTube().program);
  }
  // A bend of more than half a turn leaves two ways to close a face without seam.
  hal::Tube hook = DemoTube();
  hook.program.rows[0].angle_deg = 200;
  test::ExpectRows(NominalOf({}, hook), hook.program);
}

TEST(Kernels, SurfacesThatComeNearToCylindersAndTori) {
  StepStyle style;
  style.surfaces = SurfaceStyle::kPolynomial;
  style.span_deg = 90;
  const auto coarse = NominalOf(style);
  test::ExpectRows(coarse, DemoTube().program, 0.02);
  EXPECT_THAT(coarse.out, HasSubstr("mm off the straights and bends they stand for"));
  // One surface from end to end, its pieces around and along cut at every knot. Cubics of 45
  // degrees lie up to 1e-4 mm off a bend of 25 mm, which is 0.0003 degrees at each of its ends,
  // and more where the fit leans.
  style.one_face = true;
  style.faces = FaceStyle::kSeam;
  style.span_deg = 45;
  test::ExpectRows(NominalOf(style), DemoTube().program, 1.5e-3);
  style.surfaces = SurfaceStyle::kRational;
  test::ExpectRows(NominalOf(style), DemoTube().program, 1e-5);
}

TEST(Kernels, NumbersUnitsAndNames) {
  StepStyle style;
  style.faces = FaceStyle::kHalves;
  style.digits = 5;
  test::ExpectRows(NominalOf(style), DemoTube().program, 0.02);
  style.digits = 15;
  style.unit_mm = 0.001;
  style.unit = "(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT(.MICRO.,.METRE.))";
  style.name = "R\\X2\\00F6\\X0\\hre";
  const auto tiny = NominalOf(style);
  test::ExpectRows(tiny, DemoTube().program, 1e-5);
  EXPECT_THAT(tiny.out, HasSubstr("R\xc3\xb6hre"));
  style = {};
  style.unit = "(LENGTH_UNIT()NAMED_UNIT(*))";
  const auto none = NominalOf(style);
  test::ExpectRows(none, DemoTube().program);
  EXPECT_THAT(none.out, HasSubstr("names no unit of length"));
  test::ExpectRows(Nominal(Written("\xef\xbb\xbf" + test::StepText(DemoTube()))),
                   DemoTube().program);
}

TEST(Kernels, SaysWhatIsNoStepFile) {
  const std::pair<std::string, const char*> files[] = {{"PK\x03\x04 and so on", "unpack it first"},
                                                       {"\x1f\x8b\x08", "gunzip"},
                                                       {"solid x\nfacet normal 0 0 1", "STL"},
                                                       {"\xd0\xcf\x11\xe0", "STEP AP214"}};
  for (const auto& [text, mend] : files) {
    const auto done = Nominal(Written(text));
    EXPECT_EQ(done.code, 3);
    EXPECT_THAT(done.err, HasSubstr(mend));
  }
}

TEST(Kernels, SaysWhyNoPartFileHoldsIt) {
  hal::Tube elbow = DemoTube();
  elbow.program.rows[0].length_mm = 0;
  const auto early = NominalOf({}, elbow);
  EXPECT_EQ(early.code, 3);
  EXPECT_THAT(early.err, HasSubstr("begins with a bend"));
  EXPECT_THAT(early.out, HasSubstr("45.0000"));  // what the file holds is shown all the same
  hal::Tube straight = DemoTube();
  straight.program = {{{200, 0, 0, std::nullopt}}};
  const auto bar = NominalOf({}, straight);
  EXPECT_EQ(bar.code, 3);
  EXPECT_THAT(bar.err, HasSubstr("it is straight"));
}

}  // namespace
}  // namespace bendloop::host
