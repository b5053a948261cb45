// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <cmath>
#include <cstddef>
#include <span>
#include <vector>

#include "pipeline/fit/surface_points.h"

namespace bendloop::pipeline {

// A segment's local state, which its surface depends on: velocity of its start (3), angular
// velocity (3), both in the frame (tangent, normal x tangent, normal), bend radius, pipe radius,
// flattening (4): of an arc its own; of a line, of the bend before it and of the one behind it,
// constant and what sinks in, of either width alike.
constexpr int kPipeRadiusState = 7;
constexpr int kFlatteningState = 8;  // the first of it
constexpr int kLocalState = kFlatteningState + kFlatteningParameters;
constexpr int kCondensedRow = kLocalState + 1;  // and the residual
using CondensedSum = Eigen::Matrix<double, kCondensedRow, kCondensedRow>;

// Full weight up to 3.5 sigma, none beyond 5: keeps 99.9 % of the efficiency under normal noise.
constexpr double kFullWeight = 3.5;
constexpr double kNoWeight = 5.0;

// Points as arrays, so that roots, quotients and sums run several points at a time.
constexpr std::size_t kBatch = 64;
struct PointLanes {
  alignas(32) std::array<double, kBatch> x{}, y{}, z{};
};
// The same in a segment's frame (tangent, normal x tangent, normal; an arc's y from its centre),
// with the distance from its spine; beyond its ends from them, unless it is open there.
struct LocalLanes : PointLanes {
  alignas(32) std::array<double, kBatch> distance{};
};
void ToSegment(const SegmentFrame& frame, const PointLanes& points, std::size_t count,
               LocalLanes& local);

// How far inside the round surface the flattened one lies at the places of points [mm]; `local` as
// from ToSegment, `frame` flattened.
void FlattenedBy(const SegmentFrame& frame, double pipe_radius_mm, const LocalLanes& local,
                 std::array<double, kBatch>& inside_mm);
// The same at a place of a line's frame.
double FlattenedBy(const SegmentFrame& line, double pipe_radius_mm, double x, double y, double z);

// Any number of points of one segment in its frame, with their distance from the surface times
// their certainty.
struct SegmentPoints {
  // Grows without being filled: most fits are short, and zeros would cost as much as the points.
  using Lane = Eigen::ArrayXd;

  std::size_t size = 0;
  Lane x, y, z, distance;  // at least `size` long
  bool weighted = false;
  Lane weight;  // the certainties' squares; if not `weighted`, all are one

  void Clear(bool with_weights = false) {
    size = 0;
    weighted = with_weights;
  }
  void MakeRoom(std::size_t more);
  double Certainty(Eigen::Index i) const { return weighted ? std::sqrt(weight[i]) : 1.0; }
  void Add(const SegmentPoints& from, Eigen::Index i) {
    const auto at = static_cast<Eigen::Index>(size);
    if (at == x.size()) MakeRoom(kBatch);
    x[at] = from.x[i];
    y[at] = from.y[i];
    z[at] = from.z[i];
    if (weighted) weight[at] = from.weight[i];
    distance[at] = from.distance[i];
    ++size;
  }
  // The first `count` of a batch, which are all alike certain; has room for them.
  void AddFirst(const LocalLanes& from, std::size_t count,
                const std::array<double, kBatch>& from_surface_mm);
  void Add(const LocalLanes& from, std::size_t i, double from_surface_mm) {
    const auto at = static_cast<Eigen::Index>(size);
    x[at] = from.x[i];
    y[at] = from.y[i];
    z[at] = from.z[i];
    distance[at] = from_surface_mm;
    ++size;
  }
};

// Sum over the points of weight * row * row^T, where a row is the derivative of the point's
// distance from the segment's surface by the local state, then that distance. The weight is the
// point's own, and fades with the distance in units of its own sigma: `sigma_mm` over its
// certainty.
CondensedSum SumOfRows(const SegmentPoints& points, const SegmentFrame& frame,
                       double pipe_radius_mm, double sigma_mm);

// What least squares with these weights make less: the sum of squares of distance over sigma, less
// and less steep where the weight fades. `reach_mm` bounds the distances.
double RobustSum(std::span<const double> distances_mm, double sigma_mm);
double RobustSum(double distance_mm, double sigma_mm);
double RobustWeight(double distance_mm, double sigma_mm);

}  // namespace bendloop::pipeline
