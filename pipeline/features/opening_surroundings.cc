// SPDX-License-Identifier: Apache-2.0
#include "pipeline/features/opening_surroundings.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numeric>

#include "hal/angles.h"
#include "pipeline/features/opening_lines.h"
#include "pipeline/features/unrolled_wall.h"

namespace bendloop::pipeline {
namespace {

struct LookSettings {
  // [of r_P] Samples further in are not the wall's; further out nothing hides it.
  double inside = 0.3, outside = 1.0;
  // Cameras look at a laser line from so far beside it, along the tube; and how far off parts of
  // the tube are that hide a place. Steps of the search [deg, and of r_P].
  double camera_deg = 45.0, camera_step_deg = 6.0, hides_mm = 400.0, way_step = 0.2;
  // [of the way] What is so near to it hides the place, too: edges of shadows are not sharp.
  double beside = 0.05;
  // So many samples of a pass are asked whether a camera would have seen them; of these so many may
  // be wrong. [of r_P] So deep in the tube a way is certainly hidden.
  std::size_t asked = 60;
  double most_hidden = 0.03, deep = 0.1;
};
constexpr LookSettings kLook;

// What of a tube stands between its own wall and a scanner: the laser above a place, or its camera,
// which looks at the line from somewhere before or behind.
class Shadows {
 public:
  Shadows(std::span<const SegmentFrame> frames, double pipe_radius_mm)
      : frames_(frames), r_mm_(pipe_radius_mm), all_(frames.size()) {
    std::iota(all_.begin(), all_.end(), 0);
  }

  // Where the camera of a pass may stand: what it saw is not hidden from there. `places`: samples
  // of the wall.
  std::vector<double> WaysOf(std::span<const SeenWall* const> seen,
                             const Eigen::Vector3d& tangent) const {
    const std::size_t stride = StrideTo(seen.size(), kLook.asked);
    std::vector<double> turns;
    for (double turn_deg = -kLook.camera_deg; turn_deg <= kLook.camera_deg;
         turn_deg += kLook.camera_step_deg) {
      const double turn = turn_deg * hal::kRadiansPerDegree;
      double hidden = 0, count = 0;
      for (std::size_t i = 0; i < seen.size(); i += stride) {
        const Eigen::Vector3d way = Way(seen[i]->to_sensor, tangent, turn);
        hidden += IsHidden(seen[i]->point_mm, way, -kLook.deep * r_mm_, 0.0) ? 1 : 0;
        count += 1;
      }
      if (turn == 0 || hidden <= kLook.most_hidden * count) turns.push_back(turn);
    }
    return turns;
  }

  bool MayHide(const Eigen::Vector3d& place, SensorDirection to_sensor,
               const Eigen::Vector3d& tangent, std::span<const double> turns) const {
    return std::any_of(turns.begin(), turns.end(), [&](double turn) {
      return IsHidden(place, Way(to_sensor, tangent, turn), 0.0, kLook.beside);
    });
  }

 private:
  static Eigen::Vector3d Way(SensorDirection to_sensor, const Eigen::Vector3d& tangent,
                             double turn) {
    return (std::cos(turn) * TowardsSensor(to_sensor) + std::sin(turn) * tangent).normalized();
  }
  // Whether the tube comes nearer to the way than this, and than this part of how far it is.
  bool IsHidden(const Eigen::Vector3d& place, const Eigen::Vector3d& way, double least_mm,
                double least_part) const {
    for (double at_mm = 0.5 * r_mm_; at_mm < kLook.hides_mm;) {
      const double free_mm = NearestSegment(place + at_mm * way, frames_, all_).distance_mm - r_mm_;
      if (free_mm < least_mm + least_part * at_mm) return true;
      at_mm += std::max(free_mm, kLook.way_step * r_mm_);
    }
    return false;
  }

  std::span<const SegmentFrame> frames_;
  double r_mm_;
  std::vector<std::int32_t> all_;
};

}  // namespace

Surroundings LookedAtTube::LookAt(const hal::SurfaceFrame& frame, double reach_mm,
                                  double wall_mm) const {
  const double r_mm = pipe_radius_mm;
  Surroundings around;
  const Eigen::Vector3d middle = frame.spine_mm + r_mm * frame.outward;
  const Eigen::Vector3d sideways = frame.sideways();
  const double ball_mm = std::hypot(reach_mm, (1.0 + kLook.outside) * r_mm);
  std::vector<std::int32_t> candidates;
  for (const PointBlock& block : blocks) {
    const double near_mm = ball_mm + block.half_diagonal_mm;
    if ((block.center_mm - middle).squaredNorm() > near_mm * near_mm) continue;
    CandidateSegments(block, frames, 2.5 * r_mm, candidates);
    if (candidates.empty()) continue;
    for (std::size_t i = 0; i < block.points.size(); ++i) {
      const Eigen::Vector3d& point = block.points[i];
      const Eigen::Vector3d from = point - frame.spine_mm;
      const Eigen::Vector2d place(from.dot(frame.tangent), from.dot(sideways));
      if (place.norm() > reach_mm || from.dot(frame.outward) < 0) continue;
      const NearSegment near = NearestSegment(point, frames, candidates);
      const double off_mm = near.distance_mm - r_mm;
      if (off_mm < -kLook.inside * r_mm || off_mm > kLook.outside * r_mm) continue;
      around.present.push_back(place);
      if (std::abs(off_mm) >= wall_mm) continue;
      around.wall.push_back(place);
      if (i < block.to_sensor.size() && block.to_sensor[i].known()) {
        around.seen.push_back({point, block.to_sensor[i], near.segment});
      }
    }
  }
  return around;
}

LineSurroundings LookedAtTube::FindLines(const hal::SurfaceFrame& frame,
                                         std::span<const SeenWall> seen) const {
  const UnrolledWall unrolled(segments, frame, pipe_radius_mm);
  std::vector<WallSample> wall;
  wall.reserve(seen.size());
  for (const SeenWall& sample : seen) {
    const std::array<std::int32_t, 1> own = {sample.segment};
    const SpineFoot foot = NearestFoot(sample.point_mm, segments, frames, own);
    wall.push_back({unrolled.PlaceOf(sample.point_mm, foot), sample.to_sensor});
  }
  const MissedRays missed = FindMissed(wall, pipe_radius_mm, frame.outward, frame.sideways());
  LineSurroundings lines;
  lines.has_lines = missed.has_lines;
  if (missed.rays.empty()) return lines;
  std::map<unsigned, std::vector<const SeenWall*>> passes;
  for (const SeenWall& sample : seen) passes[PassOf(sample.to_sensor)].push_back(&sample);
  const Shadows shadows(frames, pipe_radius_mm);
  std::map<unsigned, std::vector<double>> ways;
  for (const auto& [pass, samples] : passes) ways[pass] = shadows.WaysOf(samples, frame.tangent);
  for (const MissedRay& ray : missed.rays) {
    const Eigen::Vector3d place = unrolled.PointAt(ray.place_mm);
    const auto& turns = ways[PassOf(ray.to_sensor)];
    if (shadows.MayHide(place, ray.to_sensor, frame.tangent, turns)) continue;
    const Eigen::Vector3d from = place - frame.spine_mm;
    lines.missed.push_back(
        {{from.dot(frame.tangent), from.dot(frame.sideways())}, ray.sideways_sigma_mm});
    lines.cell_mm2.push_back(ray.cell_mm2);
  }
  return lines;
}

}  // namespace bendloop::pipeline
