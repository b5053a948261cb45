// SPDX-License-Identifier: Apache-2.0
// Borders as B-splines: what stands in the file is the curve, piece by piece.
#include <gtest/gtest.h>

#include <BRep_Tool.hxx>
#include <STEPControl_Reader.hxx>
#include <TopExp_Explorer.hxx>
#include <TopoDS.hxx>
#include <cmath>
#include <string>
#include <vector>

#include "firmware-host/cad/step_file.h"
#include "made_files.h"

namespace bendloop::host {
namespace {

// Two pieces with a common tangent in (10, 5, 1), of weights that are not 1.
pipeline::RationalBezier TwoPieces() {
  pipeline::RationalBezier curve;
  curve.pieces.resize(2);
  curve.pieces[0].control_mm = {Eigen::Vector3d(0, 0, 0), Eigen::Vector3d(2, 5, 0),
                                Eigen::Vector3d(6, 5, 1), Eigen::Vector3d(10, 5, 1)};
  curve.pieces[0].weight = {1, 1.4, 0.7, 1};
  curve.pieces[1].control_mm = {Eigen::Vector3d(10, 5, 1), Eigen::Vector3d(12, 5, 1),
                                Eigen::Vector3d(15, 2, 3), Eigen::Vector3d(15, 0, 4)};
  curve.pieces[1].weight = {2, 1.1, 2.6, 2};
  return curve;
}

TEST(BordersStep, ReadBackTheyAreTheSameCurves) {
  const pipeline::RationalBezier curve = TwoPieces();
  const std::string file = test::TemporaryFile("borders.step");
  const std::vector<const pipeline::RationalBezier*> curves = {&curve, &curve};
  const auto written = WriteCurvesStep(curves, "borders", file);
  ASSERT_TRUE(written) << written.error().message;
  STEPControl_Reader reader;
  ASSERT_EQ(reader.ReadFile(file.c_str()), IFSelect_RetDone);
  reader.TransferRoots();
  int edges = 0;
  for (TopExp_Explorer edge(reader.OneShape(), TopAbs_EDGE); edge.More(); edge.Next(), ++edges) {
    double from = 0, to = 0;
    const auto read = BRep_Tool::Curve(TopoDS::Edge(edge.Current()), from, to);
    ASSERT_FALSE(read.IsNull());
    EXPECT_NEAR(to - from, 2, 1e-9);
    for (int i = 0; i <= 40; ++i) {
      const double at = 2.0 * i / 40;
      const auto piece = static_cast<std::size_t>(std::min(1.0, std::floor(at)));
      const Eigen::Vector3d is = curve.pieces[piece].At(at - static_cast<double>(piece));
      const gp_Pnt found = read->Value(from + at);
      EXPECT_LT((Eigen::Vector3d(found.X(), found.Y(), found.Z()) - is).norm(), 1e-6) << i;
    }
  }
  EXPECT_EQ(edges, 2);
}

}  // namespace
}  // namespace bendloop::host
