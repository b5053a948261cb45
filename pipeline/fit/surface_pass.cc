// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/surface_pass.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>

#include "pipeline/fit/nearest_lanes.h"
#include "pipeline/math/simd.h"

namespace bendloop::pipeline {
namespace {

struct PassSettings {
  // Points at a time: what they need stays in the processor's cache.
  std::size_t chunk = 8192;
  // Each holds sums of its own. By trial.
  std::size_t most_rounds = 16;
  // A segment's room to begin with: so many times its share of the points, and so many points at
  // least. Less is copied time and again as it grows, far more is memory that is handed out and
  // taken back with every tube. By trial.
  std::size_t first_room = 2, least_room = 1024;
};
constexpr PassSettings kPass;

// Two loops, because this is one of those that take the time: where all points are alike, nothing
// looks at `certainties`.
template <bool kWeighted>
void AssignBatch(const NearestLanes& nearest, std::span<const std::int32_t> candidates,
                 double pipe_radius_mm, double reach_mm, std::size_t count,
                 const float* certainties, SurfaceAssignment& result) {
  for (std::size_t i = 0; i < count; ++i) {
    const std::size_t c = nearest.Candidate(i);
    const auto k = static_cast<std::size_t>(candidates[c]);
    const double certainty = kWeighted ? certainties[i] : 1.0;
    const double d = certainty * (nearest.Local(c).distance[i] - pipe_radius_mm);
    if (!(d < std::numeric_limits<double>::max())) continue;  // beyond the tube's ends
    const double magnitude = std::min(std::abs(d), reach_mm);
    result.segment_count[k] += 1.0;
    result.segment_sum_mm2[k] += magnitude * magnitude;
    if (!(magnitude < reach_mm)) continue;
    result.distances_mm.push_back(d);
    SegmentPoints& points = result.segments[k];
    if (kWeighted) points.weight[static_cast<Eigen::Index>(points.size)] = certainty * certainty;
    points.Add(nearest.Local(c), i, d);
  }
}

// Distances of a batch from the surface; how many are out of reach.
BENDLOOP_LOOP int FromSurfaceBody(const LocalLanes& local, double pipe_radius_mm, double reach_mm,
                                  std::size_t count, std::array<double, kBatch>& distance_mm) {
  int far = 0;
#pragma omp simd reduction(+ : far)
  for (std::size_t i = 0; i < count; ++i) {
    distance_mm[i] = local.distance[i] - pipe_radius_mm;
    far += std::abs(distance_mm[i]) < reach_mm ? 0 : 1;
  }
  return far;
}
BENDLOOP_MULTIVERSION(int, FromSurface,
                      (const LocalLanes& local, double pipe_radius_mm, double reach_mm,
                       std::size_t count, std::array<double, kBatch>& distance_mm),
                      (local, pipe_radius_mm, reach_mm, count, distance_mm))

// Takes a batch over as a whole where all its points are alike certain, nearest to one segment and
// within reach, as most are. The same as AssignBatch, to the bit.
bool AssignTogether(const NearestLanes& nearest, std::span<const std::int32_t> candidates,
                    double pipe_radius_mm, double reach_mm, std::size_t count,
                    SurfaceAssignment& result) {
  const std::size_t c = nearest.Candidate(0);
  if (candidates.size() > 1) {
    std::size_t others = 0;
    for (std::size_t i = 1; i < count; ++i) others |= nearest.Candidate(i) ^ c;
    if (others != 0) return false;
  }
  const LocalLanes& local = nearest.Local(c);
  alignas(32) std::array<double, kBatch> distance_mm;
  if (FromSurface(local, pipe_radius_mm, reach_mm, count, distance_mm) > 0) return false;
  const auto k = static_cast<std::size_t>(candidates[c]);
  double sum_mm2 = result.segment_sum_mm2[k];
  for (std::size_t i = 0; i < count; ++i) sum_mm2 += distance_mm[i] * distance_mm[i];
  result.segment_sum_mm2[k] = sum_mm2;
  result.segment_count[k] += static_cast<double>(count);
  result.distances_mm.insert(result.distances_mm.end(), distance_mm.data(),
                             distance_mm.data() + count);
  result.segments[k].AddFirst(local, count, distance_mm);
  return true;
}

}  // namespace

void AssignPoints(std::span<const SegmentFrame> frames, double pipe_radius_mm,
                  std::span<const PointBlock> blocks, double reach_mm, SurfaceAssignment& result) {
  result.segments.resize(frames.size());
  const bool weighted = AreWeighted(blocks);
  for (SegmentPoints& points : result.segments) points.Clear(weighted);
  result.distances_mm.clear();
  result.total = 0;
  result.segment_count.assign(frames.size(), 0.0);
  result.segment_sum_mm2.assign(frames.size(), 0.0);
  const std::size_t share = CountPoints(blocks) / std::max<std::size_t>(1, frames.size());
  for (SegmentPoints& points : result.segments) {
    if (points.x.size() == 0) points.MakeRoom(std::max(kPass.first_room * share, kPass.least_room));
  }
  std::vector<std::int32_t> candidates;
  NearestLanes nearest;
  for (const PointBlock& block : blocks) {
    result.total += block.points.size();
    CandidateSegments(block, frames, pipe_radius_mm + reach_mm, candidates);
    if (candidates.empty()) continue;
    for (std::size_t first = 0; first < block.points.size(); first += kBatch) {
      const std::size_t count = std::min(kBatch, block.points.size() - first);
      nearest.Find(block.points.subspan(first, count), frames, pipe_radius_mm, candidates);
      for (const std::int32_t k : candidates) {
        result.segments[static_cast<std::size_t>(k)].MakeRoom(count);
      }
      if (weighted) {
        AssignBatch<true>(nearest, candidates, pipe_radius_mm, reach_mm, count,
                          block.certainties.data() + first, result);
      } else if (!AssignTogether(nearest, candidates, pipe_radius_mm, reach_mm, count, result)) {
        AssignBatch<false>(nearest, candidates, pipe_radius_mm, reach_mm, count, nullptr, result);
      }
    }
  }
}

void SurfacePass::Add(const SurfacePass& other) {
  for (std::size_t k = 0; k < sums.size(); ++k) {
    sums[k] += other.sums[k];
    segment_count[k] += other.segment_count[k];
    segment_sum_mm2[k] += other.segment_sum_mm2[k];
  }
  magnitudes.Add(other.magnitudes);
  design_effect.Add(other.design_effect);
  total += other.total;
}

SurfacePass PassOverSurface(std::span<const SegmentFrame> frames, double pipe_radius_mm,
                            std::span<const PointBlock> blocks, double reach_mm, double sigma_mm,
                            Workers* workers) {
  const std::vector<BlockRange> rounds = EvenRounds(blocks, kPass.chunk, kPass.most_rounds);
  std::vector<SurfacePass> passes(rounds.size());
  ParallelFor(workers, rounds.size(), [&](std::size_t round) {
    SurfacePass& pass = passes[round];
    pass.sums.assign(frames.size(), CondensedSum::Zero());
    pass.segment_count.assign(frames.size(), 0.0);
    pass.segment_sum_mm2.assign(frames.size(), 0.0);
    SurfaceAssignment chunk;
    for (std::size_t begin = rounds[round].begin; begin < rounds[round].end;) {
      std::size_t end = begin;
      for (std::size_t points = 0; end < rounds[round].end && points < kPass.chunk; ++end) {
        points += blocks[end].points.size();
      }
      AssignPoints(frames, pipe_radius_mm, blocks.subspan(begin, end - begin), reach_mm, chunk);
      for (std::size_t k = 0; k < frames.size(); ++k) {
        if (chunk.segments[k].size > 0) {
          pass.sums[k] += SumOfRows(chunk.segments[k], frames[k], pipe_radius_mm, sigma_mm);
        }
        pass.segment_count[k] += chunk.segment_count[k];
        pass.segment_sum_mm2[k] += chunk.segment_sum_mm2[k];
      }
      for (const double d : chunk.distances_mm) pass.magnitudes.Add(d);
      pass.design_effect.Add(chunk.segments, frames, pipe_radius_mm, kNoWeight * sigma_mm);
      pass.total += chunk.total;
      begin = end;
    }
  });
  for (std::size_t round = 1; round < passes.size(); ++round) passes[0].Add(passes[round]);
  return std::move(passes[0]);
}

}  // namespace bendloop::pipeline
