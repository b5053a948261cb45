// SPDX-License-Identifier: Apache-2.0
#include "pipeline/structure/local_gain.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <unordered_map>
#include <vector>

#include "hal/spine.h"
#include "pipeline/fit/surface_points.h"
#include "pipeline/points/point_index.h"

namespace bendloop::pipeline {
namespace {

struct LocalGainSettings {
  // [of r_P] Edge of the cubes that places are told by: a dent is about as long. By trial.
  double place = 1.0;
  // [variances] Of a place's mean, that noise explains: three sigma.
  double chance = 9.0;
};
constexpr LocalGainSettings kLocal;

struct Place {
  double samples = 0, sum_mm = 0, gain_mm2 = 0;
};

std::vector<SegmentFrame> FramesOf(const SurfaceFit& fit) {
  return SegmentFrames(hal::SpineSegments(fit.tube.program, fit.tube.X_WT),
                       kBeyond * fit.tube.pipe_radius_mm, fit.flattening);
}

}  // namespace

double LocalGain(const SurfaceFit& better, const SurfaceFit& rival,
                 std::span<const PointBlock> blocks, double variance_mm2, double limit_mm) {
  const auto frames_better = FramesOf(better), frames_rival = FramesOf(rival);
  const double r_mm = better.tube.pipe_radius_mm;
  std::unordered_map<std::uint64_t, Place> places;
  std::vector<std::int32_t> near_better, near_rival;
  const auto distance_mm = [](const Eigen::Vector3d& point, std::span<const SegmentFrame> frames,
                              std::span<const std::int32_t> candidates, double radius_mm,
                              double most_mm) {
    if (candidates.empty()) return most_mm;
    const double from_spine_mm = NearestSegment(point, frames, candidates).distance_mm;
    return std::clamp(from_spine_mm - radius_mm, -most_mm, most_mm);
  };
  for (const PointBlock& block : blocks) {
    CandidateSegments(block, frames_better, r_mm + limit_mm, near_better);
    CandidateSegments(block, frames_rival, r_mm + limit_mm, near_rival);
    if (near_better.empty() && near_rival.empty()) continue;
    for (const Eigen::Vector3d& point : block.points) {
      const double a = distance_mm(point, frames_better, near_better, r_mm, limit_mm);
      const double b =
          distance_mm(point, frames_rival, near_rival, rival.tube.pipe_radius_mm, limit_mm);
      if (std::abs(a) >= limit_mm && std::abs(b) >= limit_mm) continue;
      Place& place = places[CellKey(CellOf(point, kLocal.place * r_mm))];
      place.samples += 1;
      place.sum_mm += a;
      place.gain_mm2 += b * b - a * a;
    }
  }
  double gain = 0;
  for (const auto& [key, place] : places) {
    const double together_mm2 = place.sum_mm * place.sum_mm / place.samples;
    gain += place.gain_mm2 /
            (variance_mm2 + std::max(0.0, together_mm2 - kLocal.chance * variance_mm2));
  }
  return gain;
}

}  // namespace bendloop::pipeline
