// SPDX-License-Identifier: Apache-2.0
#include "pipeline/structure/structure_window.h"

#include <algorithm>
#include <limits>
#include <numeric>

#include "hal/spine.h"

namespace bendloop::pipeline {
namespace {

// How much of the tube beside a window is looked at with it. By trial.
struct WindowSettings {
  // [of r_P] A straight so long keeps what is beyond it from mattering.
  double long_enough = 4.0;
  // Arcs on either side.
  std::size_t most_context = 2;
};
constexpr WindowSettings kWindow;

}  // namespace

StructureWindow Widened(StructureWindow window, const ArcLineSpline& spline,
                        double pipe_radius_mm) {
  const auto straight_mm = [&spline](std::size_t arcs_before) {  // one between two arcs
    return (spline.arcs[arcs_before].begin_mm - spline.arcs[arcs_before - 1].end_mm).norm();
  };
  const double enough_mm = kWindow.long_enough * pipe_radius_mm;
  for (std::size_t i = 0;
       i < kWindow.most_context && window.first > 0 && straight_mm(window.first) < enough_mm; ++i) {
    --window.first;
  }
  for (std::size_t i = 0; i < kWindow.most_context && window.last < spline.arcs.size() &&
                          straight_mm(window.last) < enough_mm;
       ++i) {
    ++window.last;
  }
  return window;
}

ArcLineSpline PartOf(const ArcLineSpline& spline, StructureWindow window) {
  const auto at = [&spline](std::size_t i) {
    return spline.arcs.begin() + static_cast<std::ptrdiff_t>(i);
  };
  ArcLineSpline part;
  part.arcs.assign(at(window.first), at(window.last));
  if (window.first > 0) {
    part.start_mm = spline.arcs[window.first - 1].end_mm;
    part.tangent = spline.arcs[window.first - 1].tangent_out;
  } else {
    part.start_mm = spline.start_mm;
    part.tangent = spline.tangent;
  }
  part.end_mm =
      window.last < spline.arcs.size() ? spline.arcs[window.last].begin_mm : spline.end_mm;
  return part;
}

ArcLineSpline WithPart(const ArcLineSpline& spline, StructureWindow window,
                       const ArcLineSpline& part) {
  ArcLineSpline whole = spline;
  const auto at = [&whole](std::size_t i) {
    return whole.arcs.begin() + static_cast<std::ptrdiff_t>(i);
  };
  if (window.first == 0) {
    whole.start_mm = part.start_mm;
    whole.tangent = part.tangent;
  }
  if (window.last == spline.arcs.size()) whole.end_mm = part.end_mm;
  whole.arcs.insert(whole.arcs.erase(at(window.first), at(window.last)), part.arcs.begin(),
                    part.arcs.end());
  return whole;
}

NearestSegments::NearestSegments(const hal::Tube& tube, std::span<const PointBlock> blocks)
    : blocks_(blocks) {
  const auto segments = hal::SpineSegments(tube.program, tube.X_WT);
  const auto frames = SegmentFrames(segments, kBeyond * tube.pipe_radius_mm);
  nearest_.reserve(CountPoints(blocks));
  std::vector<double> from_center(frames.size());
  std::vector<std::int32_t> candidates;
  for (const PointBlock& block : blocks) {
    double least = std::numeric_limits<double>::infinity();
    for (std::size_t k = 0; k < frames.size(); ++k) {
      from_center[k] = frames[k].Distance(block.center_mm);
      least = std::min(least, from_center[k]);
    }
    candidates.clear();
    for (std::size_t k = 0; k < frames.size(); ++k) {
      const bool open = k == 0 || k + 1 == frames.size();
      // Where an open end stops its distance jumps: what is true of the centre says nothing there.
      if (open || from_center[k] <= least + 2.0 * block.half_diagonal_mm) {
        candidates.push_back(static_cast<std::int32_t>(k));
      }
    }
    for (const Eigen::Vector3d& point : block.points) {
      nearest_.push_back(NearestSegment(point, frames, candidates).segment);
    }
  }
}

OwnedBlocks NearestSegments::Of(StructureWindow window, std::size_t enough) const {
  const auto first = static_cast<std::int32_t>(window.first_segment());
  const auto last = static_cast<std::int32_t>(window.last_segment());
  const auto inside = [first, last](std::int32_t k) { return k >= first && k <= last; };
  const auto count =
      static_cast<std::size_t>(std::count_if(nearest_.begin(), nearest_.end(), inside));
  const std::size_t stride = StrideTo(count, enough);
  OwnedBlocks result(count / stride + 1);
  std::size_t index = 0;   // of the point
  std::size_t number = 0;  // of those inside
  for (const PointBlock& block : blocks_) {
    bool begun = false;
    for (const Eigen::Vector3d& point : block.points) {
      if (!inside(nearest_[index++]) || number++ % stride != 0) continue;
      if (!begun) result.Begin(block.center_mm, block.half_diagonal_mm);
      begun = true;
      result.Add(point);
    }
  }
  return result;
}

SpinePolygon NodesAlong(const SpinePolygon& polygon, const hal::Tube& tube,
                        StructureWindow window) {
  const auto frames = SegmentFrames(hal::SpineSegments(tube.program, tube.X_WT));
  std::vector<std::int32_t> all(frames.size());
  std::iota(all.begin(), all.end(), 0);
  std::size_t first = polygon.size(), last = 0;
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const auto k =
        static_cast<std::size_t>(NearestSegment(polygon[i].position_mm, frames, all).segment);
    if (k < window.first_segment() || k > window.last_segment()) continue;
    first = std::min(first, i);
    last = i;
  }
  if (first >= last) return {};
  return {polygon.begin() + static_cast<std::ptrdiff_t>(first),
          polygon.begin() + static_cast<std::ptrdiff_t>(last) + 1};
}

}  // namespace bendloop::pipeline
