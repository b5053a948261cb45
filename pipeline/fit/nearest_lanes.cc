// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/nearest_lanes.h"

#include <algorithm>
#include <cmath>
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
  for (std::size_t i = 0; i < count; ++i) {
    lanes_.x[i] = points[i].x();
    lanes_.y[i] = points[i].y();
    lanes_.z[i] = points[i].z();
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
    if (!frame.flattening) continue;
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
