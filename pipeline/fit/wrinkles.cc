// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/wrinkles.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <numbers>
#include <utility>

#include "hal/spine.h"
#include "pipeline/fit/place_sums.h"
#include "pipeline/fit/surface_pass.h"
#include "pipeline/fit/wrinkle_fit.h"
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
  double least_points = 12;  // of a piece
  std::size_t least_pieces = 4;
  // Logarithms of the inner pieces' variances beyond the outer ones': [sigma] and at least.
  double insist = 5.0, more = 0.25;
  // [of their height] Waves fade out along the bend's ends, and pieces hide some of them: where no
  // wave could be fitted. By trial.
  double unlike = 0.2;
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

// A piece of a bend's wall: its points' scatter about what easing and ovality leave, which is even
// along it and around.
class Piece {
 public:
  // Along and around: from -1 to 1 over the piece.
  void Add(double along, double around, double distance_mm) {
    Terms terms;
    terms << 1.0, along, along * along, along * along * along, around, along * around;
    matrix_ += terms * terms.transpose();
    right_ += distance_mm * terms;
    squares_mm2_ += distance_mm * distance_mm;
  }
  double points() const { return matrix_(0, 0); }
  double Variance() const {
    const double left_mm2 = squares_mm2_ - right_.dot(matrix_.ldlt().solve(right_));
    return std::max(1e-18, left_mm2 / (points() - kTerms));
  }

 private:
  static constexpr int kTerms = 6;
  using Terms = Eigen::Matrix<double, kTerms, 1>;
  Eigen::Matrix<double, kTerms, kTerms> matrix_ = Eigen::Matrix<double, kTerms, kTerms>::Zero();
  Terms right_ = Terms::Zero();
  double squares_mm2_ = 0;
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
    const double along = TurnOf(points.x[i], points.y[i], bend) / bend.angle_rad() * rows;
    if (!(along >= 0 && along < rows)) continue;
    const double outward_mm = std::hypot(points.x[i], points.y[i]) - bend.bend_radius_mm;
    const double around = (std::atan2(points.z[i], outward_mm) + std::numbers::pi) /
                          (2.0 * std::numbers::pi) * kSides;
    const auto row = static_cast<int>(along), side = std::min(kSides - 1, static_cast<int>(around));
    pieces[static_cast<std::size_t>(row * kSides + side)].Add(
        2.0 * (along - row) - 1.0, 2.0 * (around - side) - 1.0, points.distance[i]);
  }
  Scatter scatter;
  for (std::size_t i = 0; i < pieces.size(); ++i) {
    if (pieces[i].points() < kWrinkles.least_points) continue;
    // Sides are counted from the innermost line on.
    const double middle = (static_cast<double>(i % kSides) + 0.5) * 2.0 * std::numbers::pi / kSides;
    const double from_inside = std::min(middle, 2.0 * std::numbers::pi - middle);
    if (from_inside < kInner) scatter.inner.push_back(pieces[i].Variance());
    if (from_inside > kOuter) scatter.outer.push_back(pieces[i].Variance());
  }
  return scatter;
}

std::vector<BendSample> SamplesOf(const SegmentPoints& points, const hal::SpineSegment& bend) {
  std::vector<BendSample> samples;
  samples.reserve(points.size);
  for (Eigen::Index i = 0; i < static_cast<Eigen::Index>(points.size); ++i) {
    const double inward_mm = bend.bend_radius_mm - std::hypot(points.x[i], points.y[i]);
    const double certainty = points.Certainty(i);
    samples.push_back({TurnOf(points.x[i], points.y[i], bend) * bend.bend_radius_mm,
                       std::atan2(points.z[i], inward_mm), points.distance[i] / certainty});
  }
  return samples;
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
    // Waves go on all along a bend, a dent does not.
    const double least = std::log(Quantile(scatter.inner, 0.25)) - outer.value;
    if (std::min(more, least) < kWrinkles.more || more < kWrinkles.insist * sigma) continue;
    const double noise_mm2 = std::exp(outer.value), waves_mm2 = std::exp(inner.value) - noise_mm2;
    // A wave's variance is half the square of its height above the wall.
    const double height_mm = 2.0 * std::sqrt(2.0 * waves_mm2 / kOfHighest);
    const double by_chance_mm = 0.5 * height_mm * sigma * std::exp(inner.value) / waves_mm2;
    const auto waves = FitWaves(SamplesOf(points.segments[k], segments[k]), segments[k].length_mm,
                                r_mm, height_mm, std::sqrt(noise_mm2));
    const Waves by_scatter{height_mm, std::hypot(by_chance_mm, kWrinkles.unlike * height_mm)};
    const auto [told_mm, sigma_mm] = waves.value_or(by_scatter);
    found.push_back({k / 2, told_mm, sigma_mm, segments[k].PointAt(0.5 * segments[k].length_mm)});
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
    const double along_rad = TurnOf(from.x(), from.y(), bend);
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

void KeepThoseOf(const hal::Tube& tube, std::span<const DentFound> dents,
                 std::vector<WrinklesFound>& wrinkles) {
  const auto segments = hal::SpineSegments(tube.program, tube.X_WT);
  const double r_mm = tube.pipe_radius_mm;
  std::erase_if(wrinkles, [&](WrinklesFound& of) {
    double nearest_mm = std::numeric_limits<double>::infinity();
    for (std::size_t k = 1; k < segments.size(); k += 2) {
      const double from_mm =
          (segments[k].PointAt(0.5 * segments[k].length_mm) - of.middle_mm).norm();
      if (from_mm < nearest_mm) nearest_mm = from_mm, of.bend = k / 2;
    }
    if (!std::isfinite(nearest_mm)) return true;
    const hal::SpineSegment& bend = segments[2 * of.bend + 1];
    return nearest_mm > 0.5 * bend.length_mm + r_mm ||
           std::any_of(dents.begin(), dents.end(), [&](const DentFound& dent) {
             return dent.along_mm > bend.from_start_mm &&
                    dent.along_mm < bend.from_start_mm + bend.length_mm;
           });
  });
  const auto same = [](const WrinklesFound& a, const WrinklesFound& b) { return a.bend == b.bend; };
  wrinkles.erase(std::unique(wrinkles.begin(), wrinkles.end(), same), wrinkles.end());
}

}  // namespace bendloop::pipeline
