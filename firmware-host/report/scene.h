// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <string>
#include <vector>

#include "firmware-host/report/tube_mesh.h"
#include "firmware-host/result/json.h"
#include "firmware-host/result/run_result.h"

namespace bendloop::host {

// A scanned point in the picture's frame with its signed deviation, outside positive.
struct ScenePoint {
  Eigen::Vector3d position_mm = Eigen::Vector3d::Zero();
  double deviation_mm = 0;
};

// A part as the pictures show it: in the nominal's frame after alignment, or in the tube's own
// frame when there is nothing to compare with.
struct Scene {
  bool compared = false;  // deviations are from the nominal; else residuals of the fit
  TubeMesh measured;
  std::vector<double> deviation_mm;  // of measured.vertices; empty when not compared
  TubeMesh nominal;                  // empty when there is none
  std::vector<ScenePoint> points;
};

Scene MakeScene(const RunResult& run, std::size_t most_points);

// The deviation at the ends of the colour bar: a round number that nearly all deviations of `scene`
// stay below.
double ScaleMm(const Scene& scene);

// The scale that all parts share: twice the tolerance, so that strong colours are out of tolerance;
// without one, the largest of the scenes' own.
double SharedScaleMm(std::span<const Scene> scenes, double tolerance_mm);

// What report.js draws.
Json SceneJson(const Scene& scene);

// Colour for a deviation as "#rrggbb": blue inside, grey none, red outside (RdBu, which readers
// with any colour vision can tell apart). The same table stands in report.js.
std::string DeviationColour(double deviation_mm, double scale_mm);

}  // namespace bendloop::host
