// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <fstream>
#include <limits>
#include <vector>

#include "hal/angles.h"
#include "hal/spine.h"
#include "hal/tube_features.h"
#include "pipeline/features/feature_borders.h"
#include "tests/bench/cut_scan.h"
#include "tests/bench/plot.h"
#include "tests/support/grooved_handle.h"

namespace bendloop::bench {
namespace {

constexpr double kWidth = 760, kHeight = 560;
constexpr const char* kSampleColour = "#c9ced3";
constexpr std::size_t kSamples = 900;  // drawn of each cloud

// Seen from the side, the near half of it.
void DrawHandle(Picture& picture) {
  const auto cloud = tests::GroovedHandle().Scan(40'000, 0.02, 1);
  const auto found = pipeline::FindFeatureBorders(cloud);
  Panel panel(picture, {60, 40, kWidth - 90, 190}, "A handle with grooves: borders of its regions",
              {"mm", 0, 100, false}, {"mm", -15, 15, false});
  std::vector<PlotPoint> samples;
  for (const Eigen::Vector3d& point : cloud) {
    if (point.x() > 0 && samples.size() < kSamples) samples.push_back({point.z(), point.y()});
  }
  panel.Dots(samples, kSampleColour);
  if (!found) return;
  std::size_t colour = 0;
  for (const auto& border : found->borders) {
    std::vector<PlotPoint> line;
    for (const Eigen::Vector3d& at : border.fit.curve.Sampled(24)) {
      if (at.x() > 0) line.push_back({at.z(), at.y()});
      if (at.x() > 0 || line.empty()) continue;
      panel.Line(line, colour::OfSeries(colour));
      line.clear();
    }
    if (border.fit.curve.closed && line.size() > 2) line.push_back(line.front());
    if (!line.empty()) panel.Line(line, colour::OfSeries(colour++));
  }
}

// Along and around of a point of the tube.
PlotPoint Unrolled(const std::vector<hal::SpineSegment>& segments, const Eigen::Vector3d& point) {
  double nearest_mm = std::numeric_limits<double>::infinity(), along_mm = 0;
  for (const hal::SpineSegment& segment : segments) {
    for (double at_mm = 0; at_mm <= segment.length_mm; at_mm += 0.25) {
      const double away_mm = (segment.PointAt(at_mm) - point).norm();
      if (away_mm < nearest_mm) nearest_mm = away_mm, along_mm = segment.from_start_mm + at_mm;
    }
  }
  const hal::SurfaceFrame frame = hal::FrameAt(segments, along_mm, 0);
  return {along_mm, hal::AroundDeg(frame.outward, frame.tangent, point - frame.spine_mm)};
}

// A closed line about a place, in parts where it goes over the edge of the paper.
template <class Place>
void DrawLoop(Panel& panel, const char* colour, Place place) {
  std::vector<PlotPoint> line;
  for (int i = 0; i <= 96; ++i) {
    PlotPoint at = place(2 * std::numbers::pi * i / 96);
    at.y = std::remainder(at.y, 360);
    if (!line.empty() && std::abs(at.y - line.back().y) > 180) {
      panel.Line(line, colour);
      line.clear();
    }
    line.push_back(at);
  }
  panel.Line(line, colour);
}

void DrawEnds(Panel& panel, const pipeline::Measurement& m) {
  const double length_mm = hal::SpineLength(m.tube.program), r_mm = m.tube.pipe_radius_mm;
  for (const bool at_start : {true, false}) {
    const auto& end = at_start ? m.features.first_end : m.features.last_end;
    if (!end) continue;
    const double slope = std::tan(end->cut.obliquity_deg * hal::kRadiansPerDegree);
    std::vector<PlotPoint> line;
    for (int around_deg = -180; around_deg <= 180; around_deg += 5) {
      const double turn = (around_deg - end->cut.around_deg) * hal::kRadiansPerDegree;
      const double beyond_mm = r_mm * slope * std::cos(turn);
      line.push_back({at_start ? -beyond_mm : length_mm + beyond_mm, double(around_deg)});
    }
    panel.Line(line, colour::OfSeries(0));
  }
}

void DrawTube(Picture& picture) {
  const auto measured = Measure(ACutTube(1, 0.5));
  if (!measured) return;
  const pipeline::Measurement& m = *measured;
  const auto segments = hal::SpineSegments(m.tube.program, m.tube.X_WT);
  const double length_mm = hal::SpineLength(m.tube.program), r_mm = m.tube.pipe_radius_mm;
  Panel panel(
      picture, {60, 300, kWidth - 90, 200}, "A tube's surface unrolled: ends, holes, slot and dent",
      {"mm along the tube", -5, length_mm + 5, false}, {"degrees around", -180, 180, false});
  std::vector<PlotPoint> samples;
  for (std::size_t i = 0; i < m.surface.size(); i += m.surface.size() / kSamples + 1) {
    samples.push_back(Unrolled(segments, m.surface[i].position_mm));
  }
  panel.Dots(samples, kSampleColour);
  DrawEnds(panel, m);
  for (const auto& found : m.features.openings) {
    const hal::WallOpening& o = found.opening;
    const double axis = o.axis_deg * hal::kRadiansPerDegree;
    DrawLoop(panel, colour::OfSeries(o.is_hole() ? 1 : 2), [&](double turn) {
      const double u = 0.5 * o.width_mm * std::cos(turn) +
                       std::copysign(0.5 * (o.length_mm - o.width_mm), std::cos(turn));
      const double v = 0.5 * o.width_mm * std::sin(turn);
      const double across = (u * std::sin(axis) + v * std::cos(axis)) / r_mm;
      return PlotPoint{
          o.along_mm + u * std::cos(axis) - v * std::sin(axis),
          o.around_deg - std::asin(std::clamp(across, -1.0, 1.0)) * hal::kDegreesPerRadian};
    });
  }
  for (const pipeline::DentFound& dent : m.dents) {
    DrawLoop(panel, colour::OfSeries(4), [&](double turn) {
      return PlotPoint{
          dent.along_mm + 0.5 * dent.size_mm * std::cos(turn),
          dent.around_deg + 0.5 * dent.size_mm * std::sin(turn) / r_mm * hal::kDegreesPerRadian};
    });
  }
}

}  // namespace

void DrawBorders(const std::string& file) {
  Picture picture(kWidth, kHeight);
  DrawHandle(picture);
  DrawTube(picture);
  std::ofstream(file) << picture.Svg();
}

}  // namespace bendloop::bench
