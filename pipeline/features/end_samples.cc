// SPDX-License-Identifier: Apache-2.0
#include "pipeline/features/end_samples.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <functional>
#include <numbers>

#include "hal/tube_features.h"
#include "pipeline/features/sampling.h"
#include "pipeline/fit/facing_ends.h"
#include "pipeline/math/arc_tangents.h"
#include "pipeline/math/quantiles.h"
#include "pipeline/math/simd.h"

namespace bendloop::pipeline {
namespace {

struct NearSettings {
  // [of r_P] How far beyond the end that was found the long side of a cut may lie. By trial.
  double beyond = 2.0;
  // [of r_P] Samples beside the wall: so far before the end, and between these radii.
  double before = 1.0, innermost = 0.4, outermost = 2.0;
  // Samples above the wall of a sector, that they hide it.
  int hide = 3;
  // [of r_P] Of the slices in which the wall may be missing all round, and how long it is then;
  // and so many times as long as the next longest such places but one.
  double slice = 0.01, least_gap = 0.15, times_others = 5.0;
  // Of the sectors that the wall has before a gap: so many it has beyond it; and [of its samples in
  // as long a piece] so many of them.
  double beyond_sectors = 0.75, beyond_samples = 0.3;
  // [of the scan's noise] By chance an end has no less.
  double quieter = 0.7;
};
constexpr NearSettings kNear;

// `frame`: the end, and the directions of x, y and along the tube from it.
BENDLOOP_LOOP void FindPlacesBody(const double* points, const Eigen::Vector3d* frame,
                                  std::size_t count, double* x, double* y, double* at,
                                  double* square) {
  const double end0 = frame[0][0], end1 = frame[0][1], end2 = frame[0][2];
  const double x0 = frame[1][0], x1 = frame[1][1], x2 = frame[1][2];
  const double y0 = frame[2][0], y1 = frame[2][1], y2 = frame[2][2];
  const double at0 = frame[3][0], at1 = frame[3][1], at2 = frame[3][2];
#pragma omp simd
  for (std::size_t i = 0; i < count; ++i) {
    const double a = points[3 * i] - end0, b = points[3 * i + 1] - end1,
                 c = points[3 * i + 2] - end2;
    const double of_x = a * x0 + b * x1 + c * x2, of_y = a * y0 + b * y1 + c * y2;
    x[i] = of_x;
    y[i] = of_y;
    at[i] = a * at0 + b * at1 + c * at2;
    square[i] = of_x * of_x + of_y * of_y;
  }
}
BENDLOOP_MULTIVERSION(void, FindPlaces,
                      (const double* points, const Eigen::Vector3d* frame, std::size_t count,
                       double* x, double* y, double* at, double* square),
                      (points, frame, count, x, y, at, square))

// Points of a block, as an end sees them.
struct EndPlaces {
  std::vector<double> x, y, at, square;

  void Find(std::span<const Eigen::Vector3d> points, const Eigen::Vector3d& end,
            const Eigen::Vector3d& zero, const Eigen::Vector3d& quarter,
            const Eigen::Vector3d& outward) {
    if (points.empty()) return;
    for (std::vector<double>* numbers : {&x, &y, &at, &square}) {
      numbers->resize(std::max(numbers->size(), points.size()));
    }
    const std::array<Eigen::Vector3d, 4> frame = {end, zero, quarter, outward};
    FindPlaces(points.front().data(), frame.data(), points.size(), x.data(), y.data(), at.data(),
               square.data());
  }
};

}  // namespace

SamplesNearEnd::SamplesNearEnd(const hal::Tube& tube, bool at_start, const EndAxis& axis,
                               double sigma_mm, double window_mm,
                               std::span<const PointBlock> blocks)
    : r_mm_(tube.pipe_radius_mm), sigma_mm_(sigma_mm) {
  const auto segments = hal::SpineSegments(tube.program, tube.X_WT);
  const std::size_t at = at_start ? 0 : segments.size() - 1;
  const Eigen::Vector3d &end = axis.end_mm, &outward = axis.outward;
  const Eigen::Vector3d tangent = at_start ? Eigen::Vector3d(-outward) : outward;
  const Eigen::Vector3d quarter = tangent.cross(hal::AroundZero(segments, at)).normalized();
  const Eigen::Vector3d zero = quarter.cross(tangent);
  const double reach_mm = kSampling.on_surface * sigma_mm;
  double beyond_mm = kNear.beyond * r_mm_;
  // Further out lies what is the other end's.
  if (const auto to_mm = ToFacingEndMm(segments, at_start, r_mm_)) {
    beyond_mm = std::min(beyond_mm, 0.5 * std::max(0.0, *to_mm));
  }
  const double around_mm = std::hypot(std::max(window_mm + r_mm_, beyond_mm), 1.5 * r_mm_);
  const double least_mm = std::max(0.0, r_mm_ - reach_mm), most_mm = r_mm_ + reach_mm;
  const double inner_mm = kNear.innermost * r_mm_, outer_mm = kNear.outermost * r_mm_;
  const double from_mm = std::max(-window_mm - r_mm_, -segments[at].length_mm);
  const double beside_mm = std::max(from_mm, -kNear.before * r_mm_);
  const auto is_near = [&](const PointBlock& block) {
    const double near_mm = around_mm + block.half_diagonal_mm;
    return (block.center_mm - end).squaredNorm() <= near_mm * near_mm;
  };
  EndPlaces places;
  std::size_t most = 0;
  for (const PointBlock& block : blocks) most += is_near(block) ? block.points.size() : 0;
  wall_.reserve(most);
  for (const PointBlock& block : blocks) {
    if (!is_near(block)) continue;
    places.Find(block.points, end, zero, quarter, outward);
    for (std::size_t i = 0; i < block.points.size(); ++i) {
      const double at_mm = places.at[i], square = places.square[i];
      if (at_mm < from_mm || at_mm > beyond_mm) continue;
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
          .push_back(
              {places.x[i], places.y[i], at_mm, known ? PassOf(block.to_sensor[i]) : kMostPasses});
    }
  }
}

std::vector<EndSample> SamplesNearEnd::Every(std::size_t stride) const {
  std::vector<double> x, y;
  x.reserve(wall_.size() / stride + 1), y.reserve(x.capacity());
  for (std::size_t i = 0; i < wall_.size(); i += stride) {
    x.push_back(wall_[i].x);
    y.push_back(wall_[i].y);
  }
  constexpr double kNoWhere = 1e-300;  // mm^2: on the axis
  std::vector<double> around_rad(x.size());
  ArcTangents(y, x, around_rad);
  std::vector<EndSample> samples;
  samples.reserve(x.size());
  const double low_mm = r_mm_ - kSampling.low * sigma_mm_;
  for (std::size_t i = 0; i < x.size(); ++i) {
    const NearEnd& near = wall_[i * stride];
    const double out = 1.0 / std::sqrt(std::max(kNoWhere, near.x * near.x + near.y * near.y));
    samples.push_back({around_rad[i],
                       near.at_mm,
                       near.pass,
                       near.of_radius,
                       {out * near.x, out * near.y},
                       near.of_radius == 1.0 && out * low_mm > 1.0});
  }
  return samples;
}

std::vector<BandSample> SamplesNearEnd::Band(const Eigen::Vector3d& plane_mm, double below_mm,
                                             double above_mm) const {
  std::vector<BandSample> samples;
  // However the plane rises, most are further off.
  const double rise_mm = plane_mm.tail<2>().norm();
  for (const NearEnd& near : wall_) {
    const double level_mm = near.at_mm - plane_mm[0];
    if (level_mm < -below_mm - rise_mm || level_mm > above_mm + rise_mm) continue;
    const double off_mm = near.BeyondMm(plane_mm);
    if (!(off_mm > -below_mm && off_mm < above_mm)) continue;
    const double out = 1.0 / std::sqrt(near.x * near.x + near.y * near.y);
    samples.push_back({near.x * out, near.y * out, near.at_mm});
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

std::optional<double> SamplesNearEnd::WallBeginsMm() const {
  if (wall_.empty()) return std::nullopt;
  const auto [first, last] =
      std::minmax_element(wall_.begin(), wall_.end(),
                          [](const NearEnd& a, const NearEnd& b) { return a.at_mm < b.at_mm; });
  const double from_mm = first->at_mm, slice_mm = kNear.slice * r_mm_;
  const auto slice_of = [&](const NearEnd& near) {
    return static_cast<std::size_t>((near.at_mm - from_mm) / slice_mm);
  };
  std::vector<double> count(slice_of(*last) + 1, 0.0);
  for (const NearEnd& near : wall_) count[slice_of(near)] += 1;
  // Empty slices in a row: the longest, and where it ends.
  std::array<std::size_t, 3> longest{};
  std::size_t row = 0, behind = 0;
  for (std::size_t i = 0; i < count.size(); ++i) {
    if (count[i] == 0) {
      ++row;
      continue;
    }
    if (row > longest[0]) behind = i;
    if (row > longest[2]) longest[2] = row;
    std::sort(longest.begin(), longest.end(), std::greater<>());
    row = 0;
  }
  const auto gap = static_cast<double>(longest[0]);
  if (gap < kNear.least_gap / kNear.slice ||
      gap < kNear.times_others * static_cast<double>(longest[2])) {
    return std::nullopt;
  }
  EndSectors before{}, beyond{};
  double samples_before = 0, samples_beyond = 0;
  const std::size_t all = count.size(), reach = std::min(behind - longest[0], all - behind);
  for (const NearEnd& near : wall_) {
    const std::size_t slice = slice_of(near);
    const bool is_beyond = slice >= behind;
    (is_beyond ? beyond : before)[EndSectorOf(near.AroundRad())] = true;
    if (is_beyond ? slice < behind + reach : slice + longest[0] + reach >= behind) {
      (is_beyond ? samples_beyond : samples_before) += 1;
    }
  }
  const auto sectors = [](const EndSectors& of) {
    return static_cast<double>(std::count(of.begin(), of.end(), true));
  };
  if (sectors(beyond) < kNear.beyond_sectors * sectors(before) ||
      samples_beyond < kNear.beyond_samples * samples_before) {
    return std::nullopt;
  }
  return from_mm + static_cast<double>(behind) * slice_mm;
}

void SamplesNearEnd::LeaveOutWallBefore(double at_mm) {
  std::erase_if(wall_, [at_mm](const NearEnd& near) { return near.at_mm < at_mm; });
}

void SamplesNearEnd::LeaveOutWallFrom(double at_mm) {
  std::erase_if(wall_, [at_mm](const NearEnd& near) { return near.at_mm >= at_mm; });
}

double SamplesNearEnd::WallReachesMm(double from_mm) const {
  double most_mm = from_mm;
  for (const NearEnd& near : wall_) most_mm = std::max(most_mm, near.at_mm);
  return most_mm - from_mm;
}

double SamplesNearEnd::WallNoiseMm() const {
  std::vector<double> radii_mm;
  for (const NearEnd& near : wall_) {
    if (near.at_mm > -kNear.before * r_mm_) radii_mm.push_back(near.RadiusMm());
  }
  if (radii_mm.empty()) return sigma_mm_;
  const double noise_mm = RobustSigma(std::move(radii_mm));
  return noise_mm < kNear.quieter * sigma_mm_ ? noise_mm : sigma_mm_;
}

std::optional<double> SamplesNearEnd::FaceBeyondMm(const Eigen::Vector3d& plane_mm, double near_mm,
                                                   double least) const {
  double sum_mm = 0, count = 0;
  for (const NearEnd& near : inside_) {
    const double beyond_mm = near.BeyondInsideMm(plane_mm, r_mm_);
    if (std::abs(beyond_mm) > near_mm) continue;
    sum_mm += beyond_mm;
    count += 1;
  }
  return count < least ? std::nullopt : std::optional(sum_mm / count);
}

SamplesNearEnd SamplesNearEnd::Above(double radius_mm) const {
  SamplesNearEnd above = *this;
  std::erase_if(above.wall_, [radius_mm](const NearEnd& near) {
    return near.x * near.x + near.y * near.y <= radius_mm * radius_mm;
  });
  return above;
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
