// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/report/scene.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>

#include "firmware-host/report/html.h"

namespace bendloop::host {
namespace {

void AddFloats(std::vector<float>& out, const Eigen::Vector3d& p) {
  for (int i = 0; i < 3; ++i) out.push_back(static_cast<float>(p[i]));
}

std::string Positions(const std::vector<Eigen::Vector3d>& points) {
  std::vector<float> floats;
  floats.reserve(3 * points.size());
  for (const auto& p : points) AddFloats(floats, p);
  return Base64(floats);
}

// A spine that can be drawn: rows that are not finite give none.
std::vector<hal::SpineSegment> DrawableSpine(const hal::BendProgram& program,
                                             const hal::Pose& pose) {
  auto spine = hal::SpineSegments(program, pose);
  const bool finite = std::all_of(spine.begin(), spine.end(), [](const hal::SpineSegment& s) {
    return s.start_mm.allFinite() && s.tangent.allFinite() && s.normal.allFinite() &&
           std::isfinite(s.length_mm) && s.length_mm >= 0;
  });
  if (!finite) spine.clear();
  return spine;
}

}  // namespace

Scene MakeScene(const RunResult& run, std::size_t most_points) {
  Scene scene;
  const auto& m = run.measurement;
  scene.compared = run.nominal && run.inspection && !run.inspection->rows.empty() &&
                   run.inspection->measured.program.rows.size() == run.nominal->rows.size();
  const hal::Tube& tube = scene.compared ? run.inspection->measured : m.tube;
  const hal::Pose X_NW = scene.compared ? run.inspection->alignment.X_NW : m.tube.X_WT.Inverse();

  const auto measured = DrawableSpine(tube.program, X_NW * tube.X_WT);
  const auto nominal =
      run.nominal ? DrawableSpine(*run.nominal, hal::Pose{}) : std::vector<hal::SpineSegment>{};
  scene.compared = scene.compared && measured.size() == nominal.size() && !measured.empty();
  // The nominal's own pipe radius is in the inspection only; without one the measured is shown.
  double nominal_radius_mm = tube.pipe_radius_mm;
  if (scene.compared && run.inspection->pipe_radius_mm.nominal > 0) {
    nominal_radius_mm = run.inspection->pipe_radius_mm.nominal;
  }

  const auto counts = scene.compared ? RingCounts({measured, nominal}) : RingCounts({measured});
  scene.measured = MakeTubeMesh(measured, tube.pipe_radius_mm, counts);
  if (!nominal.empty()) {
    scene.nominal =
        MakeTubeMesh(nominal, nominal_radius_mm, scene.compared ? counts : RingCounts({nominal}));
  }
  if (scene.compared) {
    for (const auto& vertex : scene.measured.vertices) {
      scene.deviation_mm.push_back(DistanceFromSpine(nominal, vertex) - nominal_radius_mm);
    }
  }

  static const std::vector<double> kNone;
  const auto& distances = run.inspection ? run.inspection->surface.distance_mm : kNone;
  // Every k-th sample: they are spread evenly in their own order.
  const std::size_t step = most_points ? (m.surface.size() + most_points - 1) / most_points : 0;
  for (std::size_t i = 0; step > 0 && i < m.surface.size(); i += step) {
    const auto& sample = m.surface[i];
    ScenePoint point{X_NW * sample.position_mm, sample.distance_mm};
    if (scene.compared) {
      point.deviation_mm = i < distances.size()
                               ? distances[i]
                               : DistanceFromSpine(nominal, point.position_mm) - nominal_radius_mm;
    }
    if (point.position_mm.allFinite() && std::isfinite(point.deviation_mm)) {
      scene.points.push_back(point);
    }
  }
  return scene;
}

double ScaleMm(const Scene& scene) {
  std::vector<double> sizes;
  for (const double d : scene.deviation_mm) sizes.push_back(std::abs(d));
  if (!scene.compared) {
    for (const auto& point : scene.points) sizes.push_back(std::abs(point.deviation_mm));
  }
  double most = 0;
  if (!sizes.empty()) {
    const auto at = sizes.begin() + static_cast<long>(0.98 * static_cast<double>(sizes.size() - 1));
    std::nth_element(sizes.begin(), at, sizes.end());
    if (std::isfinite(*at)) most = *at;
  }
  for (double decade = 0.01; decade < 1e6; decade *= 10) {
    for (const double step : {1.0, 2.0, 5.0}) {
      if (most <= step * decade && step * decade >= 0.05) return step * decade;
    }
  }
  return 1e6;
}

double SharedScaleMm(std::span<const Scene> scenes, double tolerance_mm) {
  if (tolerance_mm > 0 && std::isfinite(tolerance_mm)) return 2 * tolerance_mm;
  double most = 0.05;
  for (const Scene& scene : scenes) most = std::max(most, ScaleMm(scene));
  return most;
}

Json SceneJson(const Scene& scene) {
  Json json = {{"compared", scene.compared},
               {"scale_mm", ScaleMm(scene)},
               {"sides", TubeMesh::kSides},
               {"measured", Positions(scene.measured.vertices)},
               {"centers", Positions(scene.measured.centers)},
               {"segments", scene.measured.segments},
               {"nominal", Positions(scene.nominal.vertices)}};
  std::vector<float> deviation(scene.deviation_mm.begin(), scene.deviation_mm.end());
  json["deviation"] = Base64(deviation);
  std::vector<float> points;
  for (const auto& point : scene.points) {
    AddFloats(points, point.position_mm);
    points.push_back(static_cast<float>(point.deviation_mm));
  }
  json["points"] = Base64(points);
  return json;
}

std::string DeviationColour(double deviation_mm, double scale_mm) {
  using Rgb = std::array<double, 3>;
  static constexpr std::array<Rgb, 7> kStops = {{{5, 72, 145},
                                                 {67, 147, 195},
                                                 {158, 202, 225},
                                                 {216, 216, 211},
                                                 {246, 178, 138},
                                                 {214, 96, 77},
                                                 {150, 10, 38}}};
  const double at = 3 + 3 * std::clamp(deviation_mm / scale_mm, -1.0, 1.0);
  const auto low = static_cast<std::size_t>(std::clamp(std::floor(at), 0.0, 5.0));
  const double part = at - static_cast<double>(low);
  char text[8];
  int rgb[3];
  for (std::size_t i = 0; i < 3; ++i) {
    rgb[i] = static_cast<int>(std::lround((1 - part) * kStops[low][i] + part * kStops[low + 1][i]));
  }
  std::snprintf(text, sizeof text, "#%02x%02x%02x", rgb[0] & 255, rgb[1] & 255, rgb[2] & 255);
  return text;
}

}  // namespace bendloop::host
