// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/wrinkles.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <utility>

#include "hal/spine.h"
#include "pipeline/fit/surface_pass.h"
#include "pipeline/math/quantiles.h"

namespace bendloop::pipeline {
namespace {

// By trial where nothing else is said.
struct WrinkleSettings {
  std::size_t enough_points = 100'000;
  // [of the straights' mean square distance] Bends that fit better have none.
  double bends_worse = 1.1;
  // [of r_P] Of a piece along the bend: more than a wave, and easing or ovality is even over it.
  double long_part = 1.5;
  double least_points = 8;  // of a piece
  std::size_t least_pieces = 4;
  // Logarithms of the inner pieces' variances beyond the outer ones': [sigma] and at least.
  double insist = 5.0, more = 0.25;
  // [of the noise] So high waves may still be where points begin to count, and [rad] how far around
  // that is from the innermost line, at least and at most.
  double rim = 0.15, least_rad = 0.9, most_rad = 1.4;
  // [of r_P] Where the bend eases they go on beyond its tangent points.
  double beyond = 1.0;
};
constexpr WrinkleSettings kWrinkles;

constexpr int kSides = 16;
constexpr double kInner = 0.25 * std::numbers::pi, kOuter = 0.5 * std::numbers::pi;
// Mean of cos^4 over the inner pieces: waves fade out as cos^2 of the angle around.
constexpr double kOfHighest = 0.693;

// From a bend's innermost line, around [rad]: 0 to pi.
double FromInside(double outward_mm, double z_mm) {
  return std::atan2(std::abs(z_mm), -outward_mm);
}

// A piece of a bend's wall: its points' scatter about what is even along it.
struct Piece {
  double n = 0, x = 0, xx = 0, d = 0, xd = 0, dd = 0;

  void Add(double along_mm, double distance_mm) {
    n += 1;
    x += along_mm;
    xx += along_mm * along_mm;
    d += distance_mm;
    xd += along_mm * distance_mm;
    dd += distance_mm * distance_mm;
  }
  double Variance() const {
    const double spread = xx - x * x / n, slope = xd - x * d / n;
    const double left = dd - d * d / n - (spread > 0 ? slope * slope / spread : 0.0);
    return std::max(1e-18, left / (n - 2));
  }
};

struct Scatter {
  std::vector<double> inner, outer;  // variances of pieces [mm^2]
};

Scatter ScatterOf(const SegmentPoints& points, const hal::SpineSegment& bend, double r_mm) {
  const double long_mm = bend.length_mm;
  const auto rows =
      std::max(1, static_cast<int>(std::lround(long_mm / (kWrinkles.long_part * r_mm))));
  std::vector<Piece> pieces(static_cast<std::size_t>(rows * kSides));
  for (Eigen::Index i = 0; i < static_cast<Eigen::Index>(points.size); ++i) {
    const double along_mm = bend.bend_radius_mm * std::atan2(points.x[i], -points.y[i]);
    if (along_mm < 0 || along_mm >= long_mm) continue;
    const double outward_mm = std::hypot(points.x[i], points.y[i]) - bend.bend_radius_mm;
    const double around = std::atan2(points.z[i], outward_mm) + std::numbers::pi;
    const auto side =
        std::min(kSides - 1, static_cast<int>(around / (2.0 * std::numbers::pi) * kSides));
    const auto row = std::min(rows - 1, static_cast<int>(along_mm / long_mm * rows));
    pieces[static_cast<std::size_t>(row * kSides + side)].Add(along_mm, points.distance[i]);
  }
  Scatter scatter;
  for (std::size_t i = 0; i < pieces.size(); ++i) {
    if (pieces[i].n < kWrinkles.least_points) continue;
    // Sides are counted from the innermost line on.
    const double middle = (static_cast<double>(i % kSides) + 0.5) * 2.0 * std::numbers::pi / kSides;
    const double from_inside = std::min(middle, 2.0 * std::numbers::pi - middle);
    if (from_inside < kInner) scatter.inner.push_back(pieces[i].Variance());
    if (from_inside > kOuter) scatter.outer.push_back(pieces[i].Variance());
  }
  return scatter;
}

struct Mean {
  double value = 0, variance = 0;  // of one
};
Mean MeanLog(std::span<const double> variances) {
  Mean mean;
  const auto n = static_cast<double>(variances.size());
  for (const double variance : variances) mean.value += std::log(variance) / n;
  for (const double variance : variances) {
    mean.variance += std::pow(std::log(variance) - mean.value, 2) / (n - 1);
  }
  return mean;
}

}  // namespace

std::vector<WrinklesFound> FindWrinkles(const SurfaceFit& fit, std::span<const PointBlock> blocks,
                                        double reach_mm) {
  std::vector<double> of_straights;
  double of_worst = 0;
  for (std::size_t k = 0; k < fit.segment_mean_square_mm2.size(); ++k) {
    if (k % 2 == 0) of_straights.push_back(fit.segment_mean_square_mm2[k]);
    if (k % 2 == 1) of_worst = std::max(of_worst, fit.segment_mean_square_mm2[k]);
  }
  if (of_straights.size() < 2) return {};
  if (of_worst < kWrinkles.bends_worse * Median(std::move(of_straights))) return {};
  const auto segments = hal::SpineSegments(fit.tube.program, fit.tube.X_WT);
  const double r_mm = fit.tube.pipe_radius_mm;
  const OwnedBlocks few = Thinned(blocks, StrideTo(CountPoints(blocks), kWrinkles.enough_points));
  SurfaceAssignment points;
  AssignPoints(SegmentFrames(segments, 0.0, fit.flattening), r_mm, few, reach_mm, points);
  std::vector<WrinklesFound> found;
  for (std::size_t k = 1; k < segments.size(); k += 2) {
    const Scatter scatter = ScatterOf(points.segments[k], segments[k], r_mm);
    if (std::min(scatter.inner.size(), scatter.outer.size()) < kWrinkles.least_pieces) continue;
    const Mean inner = MeanLog(scatter.inner), outer = MeanLog(scatter.outer);
    const double more = inner.value - outer.value;
    const double sigma = std::sqrt(inner.variance / static_cast<double>(scatter.inner.size()) +
                                   outer.variance / static_cast<double>(scatter.outer.size()));
    if (more < kWrinkles.more || more < kWrinkles.insist * sigma) continue;
    const double noise_mm2 = std::exp(outer.value), waves_mm2 = std::exp(inner.value) - noise_mm2;
    // A wave's variance is half the square of its height above the wall.
    const double height_mm = 2.0 * std::sqrt(2.0 * waves_mm2 / kOfHighest);
    found.push_back(
        {k / 2, height_mm, 0.5 * height_mm * sigma * std::exp(inner.value) / waves_mm2});
  }
  return found;
}

OwnedBlocks WithoutWrinkles(const SurfaceFit& fit, std::span<const WrinklesFound> wrinkles,
                            std::span<const PointBlock> blocks) {
  const auto segments = hal::SpineSegments(fit.tube.program, fit.tube.X_WT);
  const double r_mm = fit.tube.pipe_radius_mm;
  const auto is_on_one = [&](const WrinklesFound& of, const Eigen::Vector3d& point) {
    const hal::SpineSegment& bend = segments[2 * of.bend + 1];
    const Eigen::Vector3d from = bend.axes().transpose() * (point - bend.center_mm());
    const double outward_mm = std::hypot(from.x(), from.y()) - bend.bend_radius_mm;
    if (std::hypot(outward_mm, from.z()) > 1.5 * r_mm) return false;
    const double beyond_rad = kWrinkles.beyond * r_mm / bend.bend_radius_mm;
    const double along_rad = std::atan2(from.x(), -from.y());
    if (along_rad < -beyond_rad || along_rad > bend.angle_rad() + beyond_rad) return false;
    const double rim = kWrinkles.rim * fit.sigma_mm / (0.5 * of.height_mm);
    const double half_rad = std::clamp(std::acos(std::sqrt(std::min(1.0, rim))),
                                       kWrinkles.least_rad, kWrinkles.most_rad);
    return FromInside(outward_mm, from.z()) < half_rad;
  };
  return PointsWithout(blocks, [&](const PointBlock&, const Eigen::Vector3d& point) {
    return std::any_of(wrinkles.begin(), wrinkles.end(),
                       [&](const WrinklesFound& of) { return is_on_one(of, point); });
  });
}

}  // namespace bendloop::pipeline
