// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/without_dents.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numeric>
#include <vector>

#include "pipeline/fit/along_wall.h"
#include "pipeline/fit/surface_form.h"

namespace bendloop::pipeline {
namespace {

struct DentSettings {
  // [of the noise] So deep the surface may still be where points begin to count again: a hundred of
  // them together do not feel it.
  double rim = 0.15;
  // [of r_P] Of the circle that is left out: more than the cells that dents are found in
  // (surface_form.cc) blur.
  double least = 1.2;
  // [of the points] With more left out too little of the tube would be left.
  double most_points = 0.3;
  // [of r_P] So far from the surface a point may belong to a dent.
  double deep = 0.5;
  // [of r_P] About the middle of one that is left out there are no points.
  double middle = 0.5;
  // [of its depth] On an end straight a dent lies at least so far below the tube: beside a flare
  // all that is not flared looks like one. By trial.
  double below = 0.3;
};
constexpr DentSettings kDents;

constexpr double kHalfWidth = 1.1774;  // [standard deviations] where a Gaussian is half as high

// Where a point lies on the tube.
struct SurfacePlace {
  double along_mm = 0;  // of the spine
  Eigen::Vector3d tangent, outward;
  double distance_mm = 0;  // from the spine
  bool on_end = false;     // on the first straight or the last
};

// A circle on the wall, unrolled about its middle.
struct DentCircle {
  Eigen::Vector3d middle_mm;
  SurfacePlace middle;
  double radius_mm;
  double half_mm, depth_mm;  // of the dent: to where it is half as deep

  bool Has(const SurfacePlace& place, double pipe_radius_mm) const {
    if (std::abs(place.distance_mm - pipe_radius_mm) > kDents.deep * pipe_radius_mm) return false;
    const auto back = Eigen::Quaterniond::FromTwoVectors(place.tangent, middle.tangent);
    const Eigen::Vector3d out = back * place.outward;
    const double around = std::atan2(out.cross(middle.outward).norm(), out.dot(middle.outward));
    const double shorter_mm = ShorterByMm(middle.tangent, place.tangent, out, pipe_radius_mm);
    // A dent is even along the wall; of a bend that there may not be it is along the spine.
    const double spine_mm = place.along_mm - middle.along_mm;
    const double along_mm = std::min(std::abs(spine_mm), std::abs(spine_mm - shorter_mm));
    return std::hypot(along_mm, pipe_radius_mm * around) < radius_mm;
  }
};

class Spine {
 public:
  explicit Spine(const BowedTubeState& state)
      : spine_(SpineOf(state)),
        frames_(SegmentFrames(spine_, kBeyond * state.tube.pipe_radius_mm, state.flattening)),
        all_(frames_.size()) {
    std::iota(all_.begin(), all_.end(), 0);
  }
  std::optional<SurfacePlace> PlaceOf(const Eigen::Vector3d& point) const {
    const SpineFoot foot = NearestFoot(point, spine_.segments, frames_, all_);
    if (foot.segment < 0) return std::nullopt;
    const hal::SpineSegment& segment = spine_.segments[static_cast<std::size_t>(foot.segment)];
    const Eigen::Vector3d out = point - segment.PointAt(foot.along_mm);
    return SurfacePlace{segment.from_start_mm + foot.along_mm, segment.TangentAt(foot.along_mm),
                        out.normalized(), foot.distance_mm,
                        foot.segment == 0 || foot.segment == all_.back()};
  }

 private:
  EasedSpine spine_;
  std::vector<SegmentFrame> frames_;
  std::vector<std::int32_t> all_;
};

std::vector<DentCircle> CirclesOf(const std::vector<DentFound>& dents, const Spine& spine,
                                  double noise_mm, double pipe_radius_mm, const DentMargin& margin,
                                  bool on_ends) {
  std::vector<DentCircle> circles;
  for (const DentFound& dent : dents) {
    const auto place = spine.PlaceOf(dent.position_mm);
    if (!place || (place->on_end && !on_ends)) continue;
    const double rim = std::max(1.0, dent.depth_mm / (kDents.rim * noise_mm));
    const double takes_mm = 0.5 * dent.size_mm / kHalfWidth * std::sqrt(2.0 * std::log(rim));
    const double radius_mm =
        std::max({kDents.least * pipe_radius_mm,
                  std::min(margin.wide * takes_mm, margin.most * pipe_radius_mm),
                  std::min(takes_mm, margin.as_seen * pipe_radius_mm)});
    circles.push_back({dent.position_mm, *place, radius_mm, 0.5 * dent.size_mm, dent.depth_mm});
  }
  return circles;
}

// Whether the points of a dent's middle lie below the tube.
bool IsBelow(const DentCircle& circle, const Spine& spine, std::span<const PointBlock> blocks,
             double pipe_radius_mm) {
  double sum_mm = 0, count = 0;
  const double deep_mm = kDents.deep * pipe_radius_mm;
  for (const PointBlock& block : blocks) {
    const double near_mm = circle.half_mm + circle.depth_mm + block.half_diagonal_mm;
    if ((block.center_mm - circle.middle_mm).squaredNorm() > near_mm * near_mm) continue;
    for (const Eigen::Vector3d& point : block.points) {
      if ((point - circle.middle_mm).norm() > circle.half_mm) continue;
      const auto place = spine.PlaceOf(point);
      if (!place || std::abs(place->distance_mm - pipe_radius_mm) > deep_mm) continue;
      sum_mm += place->distance_mm - pipe_radius_mm;
      count += 1;
    }
  }
  return count > 0 && sum_mm / count < -kDents.below * circle.depth_mm;
}

OwnedBlocks Without(std::span<const DentCircle> circles, const Spine& spine, double pipe_radius_mm,
                    std::span<const PointBlock> from) {
  return PointsWithout(from, [&](const PointBlock&, const Eigen::Vector3d& point) {
    std::optional<SurfacePlace> place;
    for (const DentCircle& circle : circles) {
      const double near_mm = circle.radius_mm + pipe_radius_mm;
      if ((point - circle.middle_mm).squaredNorm() > near_mm * near_mm) continue;
      if (!place) place = spine.PlaceOf(point);
      if (place && circle.Has(*place, pipe_radius_mm)) return true;
    }
    return false;
  });
}

bool IsClear(const DentFound& dent, double pipe_radius_mm) {
  return dent.depth_mm > kClearDents.least * pipe_radius_mm &&
         dent.depth_mm > kClearDents.scatter_sigmas * dent.sigma_mm;
}

bool HasPointsAt(const Eigen::Vector3d& place_mm, double near_mm,
                 std::span<const PointBlock> blocks) {
  return std::any_of(blocks.begin(), blocks.end(), [&](const PointBlock& block) {
    if ((block.center_mm - place_mm).norm() > near_mm + block.half_diagonal_mm) return false;
    return std::any_of(block.points.begin(), block.points.end(), [&](const Eigen::Vector3d& point) {
      return (point - place_mm).norm() < near_mm;
    });
  });
}

}  // namespace

std::optional<OwnedBlocks> WithoutDents(const BowedTubeState& state, double noise_mm,
                                        std::span<const PointBlock> blocks,
                                        std::span<const PointBlock> from, double reach_mm,
                                        const DentMargin& margin) {
  const SurfaceForm form = FindForm(state, noise_mm, blocks, reach_mm);
  if (form.dents.empty()) return std::nullopt;
  const double r_mm = state.tube.pipe_radius_mm;
  const Spine spine(state);
  const std::size_t points = CountPoints(blocks), points_from = CountPoints(from);
  std::vector<DentCircle> circles =
      CirclesOf(form.dents, spine, noise_mm, r_mm, margin, points_from == points);
  std::erase_if(circles, [&](const DentCircle& circle) {
    return circle.middle.on_end && !IsBelow(circle, spine, blocks, r_mm);
  });
  OwnedBlocks left = Without(circles, spine, r_mm, from);
  const auto out = static_cast<double>(points - left.point_count());
  if (out > kDents.most_points * static_cast<double>(points)) return std::nullopt;
  return left;
}

std::vector<DentFound> FaintDents(const BowedTubeState& state, double noise_mm,
                                  std::span<const PointBlock> blocks,
                                  std::span<const PointBlock> from, double reach_mm) {
  const double r_mm = state.tube.pipe_radius_mm;
  const bool is_undented = CountPoints(from) < CountPoints(blocks);
  std::vector<DentFound> dents = FindForm(state, noise_mm, blocks, reach_mm, kFaintDents).dents;
  std::erase_if(dents, [&](const DentFound& dent) {
    // Beside one that is left out its own edge looks like another.
    if (is_undented && IsClear(dent, r_mm)) return true;
    return !HasPointsAt(dent.position_mm, kDents.middle * r_mm, from);
  });
  return dents;
}

OwnedBlocks WithoutDentAt(const BowedTubeState& state, const DentFound& dent,
                          std::span<const PointBlock> from) {
  const double r_mm = state.tube.pipe_radius_mm;
  const Spine spine(state);
  std::vector<DentCircle> circles;
  if (const auto place = spine.PlaceOf(dent.position_mm)) {
    circles.push_back({dent.position_mm, *place, DentMargin{}.most * r_mm, 0.0, 0.0});
  }
  return Without(circles, spine, r_mm, from);
}

}  // namespace bendloop::pipeline
