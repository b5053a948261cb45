// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/nearest_lanes.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <numbers>

#include "pipeline/math/circle_sectors.h"
#include "pipeline/math/simd.h"

namespace bendloop::pipeline {
namespace {

constexpr double kPi = std::numbers::pi;

BENDLOOP_LOOP void TurnsBody(const LocalLanes& local, std::size_t count, double opposite,
                             double angle, double bend_radius_mm, double* along_mm) {
  for (std::size_t i = 0; i < count; ++i) {
    // From the centre the arc begins at -y and turns towards x.
    double turn = RoughTurn(local.x[i], -local.y[i]);
    turn = turn < opposite ? turn + 2.0 * kPi : turn;
    turn = turn > 0 ? turn : 0.0;
    along_mm[i] = bend_radius_mm * (turn < angle ? turn : angle);
  }
}
BENDLOOP_MULTIVERSION(void, Turns,
                      (const LocalLanes& local, std::size_t count, double opposite, double angle,
                       double bend_radius_mm, double* along_mm),
                      (local, count, opposite, angle, bend_radius_mm, along_mm))

using FourDoubles = double __attribute__((vector_size(32)));

// Points one behind the other to points side by side. Four at a time by hand: the compiler takes
// them number by number.
BENDLOOP_LOOP void ToLanesBody(const double* points, std::size_t count, double* x, double* y,
                               double* z) {
  std::size_t i = 0;
  for (; i + 4 <= count; i += 4) {
    FourDoubles a, b, c;  // x y z x, y z x y, z x y z
    std::memcpy(&a, points + 3 * i, sizeof a);
    std::memcpy(&b, points + 3 * i + 4, sizeof b);
    std::memcpy(&c, points + 3 * i + 8, sizeof c);
    // Of each what is where it is; then in their order. Places from 4 on are of the second.
    FourDoubles all_x = __builtin_shufflevector(a, b, 0, 1, 6, 3);
    all_x = __builtin_shufflevector(all_x, c, 0, 5, 2, 3);
    all_x = __builtin_shufflevector(all_x, all_x, 0, 3, 2, 1);
    FourDoubles all_y = __builtin_shufflevector(a, b, 4, 1, 2, 7);
    all_y = __builtin_shufflevector(all_y, c, 0, 1, 6, 3);
    all_y = __builtin_shufflevector(all_y, all_y, 1, 0, 3, 2);
    FourDoubles all_z = __builtin_shufflevector(a, b, 0, 5, 2, 3);
    all_z = __builtin_shufflevector(all_z, c, 4, 1, 2, 7);
    all_z = __builtin_shufflevector(all_z, all_z, 2, 1, 0, 3);
    std::memcpy(x + i, &all_x, sizeof all_x);
    std::memcpy(y + i, &all_y, sizeof all_y);
    std::memcpy(z + i, &all_z, sizeof all_z);
  }
  for (; i < count; ++i) {
    x[i] = points[3 * i];
    y[i] = points[3 * i + 1];
    z[i] = points[3 * i + 2];
  }
}
BENDLOOP_MULTIVERSION(void, ToLanes,
                      (const double* points, std::size_t count, double* x, double* y, double* z),
                      (points, count, x, y, z))

// Where segment `c` is nearer than any before it.
BENDLOOP_LOOP void TakeNearerBody(const double* distance_mm, std::size_t count, std::size_t c,
                                  double* least_mm, std::size_t* nearest) {
#pragma omp simd
  for (std::size_t i = 0; i < count; ++i) {
    const bool nearer = distance_mm[i] < least_mm[i];
    nearest[i] = nearer ? c : nearest[i];
    least_mm[i] = nearer ? distance_mm[i] : least_mm[i];
  }
}
BENDLOOP_MULTIVERSION(void, TakeNearer,
                      (const double* distance_mm, std::size_t count, std::size_t c,
                       double* least_mm, std::size_t* nearest),
                      (distance_mm, count, c, least_mm, nearest))

}  // namespace

void NearestLanes::Find(std::span<const Eigen::Vector3d> points,
                        std::span<const SegmentFrame> frames, double pipe_radius_mm,
                        std::span<const std::int32_t> candidates) {
  const std::size_t count = points.size();
  static_assert(sizeof(Eigen::Vector3d) == 3 * sizeof(double));
  if (count > 0) {
    ToLanes(points.front().data(), count, lanes_.x.data(), lanes_.y.data(), lanes_.z.data());
  }
  if (locals_.size() < candidates.size()) locals_.resize(candidates.size());
  for (std::size_t c = 0; c < candidates.size(); ++c) {
    ToSegment(frames[static_cast<std::size_t>(candidates[c])], lanes_, count, locals_[c]);
  }
  std::fill_n(nearest_.begin(), count, 0);
  for (std::size_t c = 1; c < candidates.size(); ++c) {
    if (c == 1) std::copy_n(locals_[0].distance.begin(), count, least_mm_.begin());
    TakeNearer(locals_[c].distance.data(), count, c, least_mm_.data(), nearest_.data());
  }
  for (std::size_t c = 0; c < candidates.size(); ++c) {
    const SegmentFrame& frame = frames[static_cast<std::size_t>(candidates[c])];
    if (!frame.is_flattened()) continue;
    FlattenedBy(frame, pipe_radius_mm, locals_[c], inside_mm_);
    for (std::size_t i = 0; i < count; ++i) locals_[c].distance[i] += inside_mm_[i];
  }
}

void AlongArc(const SegmentFrame& frame, const LocalLanes& local, std::size_t count,
              std::array<double, kBatch>& along_mm) {
  double angle = std::atan2(frame.sine, frame.cosine);
  if (angle < 0) angle += 2.0 * kPi;
  // Outside the arc the nearer of its two ends is meant: cut the turn opposite to its middle.
  Turns(local, count, 0.5 * angle - kPi, angle, frame.bend_radius_mm, along_mm.data());
}

}  // namespace bendloop::pipeline
