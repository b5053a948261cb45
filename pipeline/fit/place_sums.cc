// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/place_sums.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "pipeline/fit/surface_pass.h"

namespace bendloop::pipeline {
namespace {

// Points at a time: what they need stays small, however many there are.
constexpr std::size_t kPointsOfRound = 32'768;
constexpr std::size_t kMostRounds = 1024;
constexpr double kFelt = 1e-6;  // of the direction that points feel most: less is not felt

// The places of one segment among all.
struct PlaceRange {
  std::size_t first = 0, count = 1;
  double step_mm = 1;
};

}  // namespace

double TurnOf(double x, double y, const hal::SpineSegment& arc) {
  const double middle = 0.5 * arc.angle_rad();
  return middle + std::remainder(std::atan2(x, -y) - middle, 2.0 * std::numbers::pi);
}

double AlongOf(const SegmentPoints& points, Eigen::Index i, const hal::SpineSegment& segment) {
  if (!segment.is_arc()) return points.x[i];
  return segment.bend_radius_mm * TurnOf(points.x[i], points.y[i], segment);
}

void Straighten(const Bow& bow, const SegmentFrame& line, double length_mm, double pipe_radius_mm,
                SegmentPoints& points) {
  if (bow.is_none()) return;
  for (Eigen::Index i = 0; i < static_cast<Eigen::Index>(points.size); ++i) {
    const double x = bow.At(points.x[i], length_mm);
    Eigen::Vector2d beside_mm = Eigen::Vector2d(points.y[i], points.z[i]) - bow.Beside(x);
    // The nearest place of a spine that leans by `slope` is nearer: 1 - slope^2 / 2 at L / 500 are
    // a third of a percent of what the bow itself does.
    const Eigen::Vector2d slope = 2.0 / bow.LengthMm(length_mm) * bow.SlopeAt(x);
    const double leans_mm = slope.dot(beside_mm);
    beside_mm *= 1.0 - 0.5 * leans_mm * leans_mm / std::max(1e-12, beside_mm.squaredNorm());
    points.y[i] = beside_mm[0];
    points.z[i] = beside_mm[1];
    double off_mm = beside_mm.norm() - pipe_radius_mm;
    if (line.is_flattened()) {
      off_mm += FlattenedBy(line, pipe_radius_mm, points.x[i], points.y[i], points.z[i]);
    }
    points.distance[i] = points.Certainty(i) * off_mm;
  }
}

PlaceInverse InverseOf(const CondensedSum& sum) {
  const LocalMatrix information = sum.topLeftCorner<kLocalState, kLocalState>();
  const LocalVector scale =
      information.diagonal().unaryExpr([](double d) { return d > 0 ? 1.0 / std::sqrt(d) : 0.0; });
  const Eigen::SelfAdjointEigenSolver<LocalMatrix> eigen(scale.asDiagonal() * information *
                                                         scale.asDiagonal());
  const double least = kFelt * eigen.eigenvalues()[kLocalState - 1];
  LocalVector inverse = LocalVector::Zero();
  PlaceInverse result;
  for (int i = 0; i < kLocalState; ++i) {
    if (!(eigen.eigenvalues()[i] > least)) continue;
    inverse[i] = 1.0 / eigen.eigenvalues()[i];
    result.rank += 1;
  }
  const LocalMatrix turned = scale.asDiagonal() * eigen.eigenvectors();
  result.of_felt = turned * inverse.asDiagonal() * turned.transpose();
  return result;
}

std::vector<PlaceSum> SumPlaces(const EasedSpine& spine, std::span<const SegmentFrame> frames,
                                double pipe_radius_mm, double place_mm,
                                std::span<const PointBlock> blocks, double reach_mm,
                                double sigma_mm, std::span<const Bow> bows) {
  std::vector<PlaceSum> places;
  std::vector<PlaceRange> ranges;
  for (std::size_t k = 0; k < frames.size(); ++k) {
    const double length_mm = spine.segments[k].length_mm;
    const auto count = static_cast<std::size_t>(std::max(1.0, std::round(length_mm / place_mm)));
    const double step_mm = length_mm / static_cast<double>(count);
    ranges.push_back({places.size(), count, step_mm});
    for (std::size_t i = 0; i < count; ++i) {
      places.push_back({k, (static_cast<double>(i) + 0.5) * step_mm, CondensedSum::Zero()});
    }
  }
  SurfaceAssignment points;
  std::vector<SegmentPoints> parts;
  for (const BlockRange& round : EvenRounds(blocks, kPointsOfRound, kMostRounds)) {
    AssignPoints(frames, pipe_radius_mm, blocks.subspan(round.begin, round.end - round.begin),
                 reach_mm, points);
    for (std::size_t k = 0; k < frames.size(); ++k) {
      SegmentPoints& of_segment = points.segments[k];
      const PlaceRange& range = ranges[k];
      if (k < bows.size()) {
        Straighten(bows[k], frames[k], spine.segments[k].length_mm, pipe_radius_mm, of_segment);
      }
      parts.resize(std::max(parts.size(), range.count));
      for (std::size_t i = 0; i < range.count; ++i) parts[i].Clear(of_segment.weighted);
      const auto last = static_cast<double>(range.count - 1);
      for (Eigen::Index i = 0; i < static_cast<Eigen::Index>(of_segment.size); ++i) {
        const double at = AlongOf(of_segment, i, spine.segments[k]) / std::max(1e-9, range.step_mm);
        parts[static_cast<std::size_t>(std::clamp(std::floor(at), 0.0, last))].Add(of_segment, i);
      }
      for (std::size_t i = 0; i < range.count; ++i) {
        if (parts[i].size == 0) continue;
        places[range.first + i].sum += SumOfRows(parts[i], frames[k], pipe_radius_mm, sigma_mm);
      }
    }
  }
  return places;
}

}  // namespace bendloop::pipeline
