// SPDX-License-Identifier: Apache-2.0
#include "pipeline/features/end_samples.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <numbers>

#include "hal/tube_features.h"
#include "pipeline/features/sampling.h"
#include "pipeline/math/arc_tangents.h"

namespace bendloop::pipeline {
namespace {

struct NearSettings {
  // [of r_P] How far beyond the end that was found the long side of a cut may lie. By trial.
  double beyond = 2.0;
  // [of r_P] Samples beside the wall: so far before the end, and between these radii.
  double before = 1.0, innermost = 0.4, outermost = 2.0;
  // Samples above the wall of a sector, that they hide it.
  int hide = 3;
};
constexpr NearSettings kNear;

}  // namespace

std::size_t EndSectorOf(double around_rad) {
  const double turn = around_rad / (2.0 * std::numbers::pi);
  const double sector = (turn - std::floor(turn)) * static_cast<double>(kEndSectors);
  return std::min(kEndSectors - 1, static_cast<std::size_t>(sector));
}

SamplesNearEnd::SamplesNearEnd(const hal::Tube& tube, bool at_start, const EndAxis& axis,
                               double sigma_mm, double window_mm,
                               std::span<const PointBlock> blocks)
    : r_mm_(tube.pipe_radius_mm) {
  const auto segments = hal::SpineSegments(tube.program, tube.X_WT);
  const std::size_t at = at_start ? 0 : segments.size() - 1;
  const Eigen::Vector3d &end = axis.end_mm, &outward = axis.outward;
  const Eigen::Vector3d tangent = at_start ? Eigen::Vector3d(-outward) : outward;
  const Eigen::Vector3d quarter = tangent.cross(hal::AroundZero(segments, at)).normalized();
  const Eigen::Vector3d zero = quarter.cross(tangent);
  const double reach_mm = kSampling.on_surface * sigma_mm, beyond_mm = kNear.beyond * r_mm_;
  const double around_mm = std::hypot(std::max(window_mm + r_mm_, beyond_mm), 1.5 * r_mm_);
  const double least_mm = std::max(0.0, r_mm_ - reach_mm), most_mm = r_mm_ + reach_mm;
  const double inner_mm = kNear.innermost * r_mm_, outer_mm = kNear.outermost * r_mm_;
  const double from_mm = std::max(-window_mm - r_mm_, -segments[at].length_mm);
  const double beside_mm = std::max(from_mm, -kNear.before * r_mm_);
  for (const PointBlock& block : blocks) {
    const double near_mm = around_mm + block.half_diagonal_mm;
    if ((block.center_mm - end).squaredNorm() > near_mm * near_mm) continue;
    for (std::size_t i = 0; i < block.points.size(); ++i) {
      const Eigen::Vector3d from = block.points[i] - end;
      const double at_mm = from.dot(outward);
      if (at_mm < from_mm || at_mm > beyond_mm) continue;
      const double x = from.dot(zero), y = from.dot(quarter);
      const double square = x * x + y * y;
      const bool is_in = square<least_mm * least_mm, is_out = square> most_mm * most_mm;
      if ((is_in || is_out) &&
          (at_mm < beside_mm || square < inner_mm * inner_mm || square > outer_mm * outer_mm)) {
        continue;
      }
      const bool known = i < block.to_sensor.size() && block.to_sensor[i].known();
      knows_passes_ |= known;
      (is_in    ? inside_
       : is_out ? outside_
                : wall_)
          .push_back({x, y, at_mm, known ? PassOf(block.to_sensor[i]) : kMostPasses});
    }
  }
}

double SamplesNearEnd::DepthMm() const {
  if (wall_.empty()) return 0.0;
  const auto [low, high] =
      std::minmax_element(wall_.begin(), wall_.end(),
                          [](const NearEnd& a, const NearEnd& b) { return a.at_mm < b.at_mm; });
  return high->at_mm - low->at_mm;
}

std::vector<EndSample> SamplesNearEnd::Every(std::size_t stride) const {
  std::vector<double> x, y;
  for (std::size_t i = 0; i < wall_.size(); i += stride) {
    x.push_back(wall_[i].x);
    y.push_back(wall_[i].y);
  }
  std::vector<double> around_rad(x.size());
  ArcTangents(y, x, around_rad);
  std::vector<EndSample> samples;
  samples.reserve(x.size());
  for (std::size_t i = 0; i < x.size(); ++i) {
    const NearEnd& near = wall_[i * stride];
    samples.push_back({around_rad[i], near.at_mm, near.pass, near.of_radius});
  }
  return samples;
}

std::vector<EndSample> SamplesNearEnd::Band(const Eigen::Vector3d& plane_mm, double below_mm,
                                            double above_mm) const {
  std::vector<EndSample> samples;
  // However the plane rises, most are further off.
  const double rise_mm = plane_mm.tail<2>().norm();
  for (const NearEnd& near : wall_) {
    const double level_mm = near.at_mm - plane_mm[0];
    if (level_mm < -below_mm - rise_mm || level_mm > above_mm + rise_mm) continue;
    const double off_mm = near.BeyondMm(plane_mm);
    if (off_mm > -below_mm && off_mm < above_mm) samples.push_back(near.Sample());
  }
  return samples;
}

EndSectors SamplesNearEnd::Hidden(const Eigen::Vector3d& plane_mm) const {
  std::array<int, kEndSectors> above{};
  for (const NearEnd& near : outside_) {
    if (std::abs(near.BeyondMm(plane_mm)) < r_mm_) ++above[EndSectorOf(near.AroundRad())];
  }
  EndSectors hidden{};
  for (std::size_t i = 0; i < kEndSectors; ++i) hidden[i] = above[i] >= kNear.hide;
  return hidden;
}

SamplesNearEnd SamplesNearEnd::With(std::span<const NearEnd> more) const {
  SamplesNearEnd with = *this;
  for (NearEnd sample : more) {
    sample.of_radius = sample.RadiusMm() / r_mm_;
    with.wall_.push_back(sample);
  }
  return with;
}

}  // namespace bendloop::pipeline
