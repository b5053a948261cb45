// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/surface_points.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <tuple>

#include "pipeline/math/divisible_by.h"

namespace bendloop::pipeline {
namespace {

// Points in a block on the average: of fewer, half a batch (kBatch), blocks are better joined.
constexpr std::size_t kFewInBlock = 32;
constexpr double kNever = std::numeric_limits<double>::infinity();

double AlongOf(const Eigen::Vector3d& point, const hal::SpineSegment& segment, bool open_before,
               bool open_after) {
  const Eigen::Vector3d v = point - segment.start_mm;
  const double x = v.dot(segment.tangent);
  if (!segment.is_arc()) {
    const double low = open_before ? x : std::max(x, 0.0);
    return open_after ? low : std::min(low, segment.length_mm);
  }
  const double radius = segment.bend_radius_mm;
  const double y = radius - v.dot(segment.normal.cross(segment.tangent));
  const double angle = segment.angle_rad();
  // Outside the arc the nearer of its two ends is meant: cut the turn opposite to its middle.
  const double middle = 0.5 * angle;
  const double phi = middle + std::remainder(std::atan2(x, y) - middle, 2.0 * std::numbers::pi);
  return radius * std::clamp(phi, 0.0, angle);
}

// A bend as so many pieces from the segment `first` on, of a sharp arc so long.
struct BendPieces {
  std::size_t first = 0, count = 1;
  double arc_mm = 0;
};

// Its section, along its pieces and on the lines beside it.
void LetRise(std::span<const hal::SpineSegment> segments, const BendPieces& bend,
             const Flattening& flattening, std::vector<SegmentFrame>& frames) {
  const std::size_t behind = bend.first + bend.count;
  double pieces_mm = 0, turn_rad = 0, turn_mm = 0;
  for (std::size_t k = bend.first; k < behind; ++k) {
    turn_rad += segments[k].angle_rad();
    turn_mm += segments[k].angle_rad() * (pieces_mm + 0.5 * segments[k].length_mm);
    pieces_mm += segments[k].length_mm;
  }
  // From where the pieces begin. The sharp arc lies about where they turn on average: skewed ones
  // reach further beyond it on one side.
  const double half_mm = 0.5 * bend.arc_mm + flattening.rise.before_mm;
  const double middle_mm = turn_mm / std::max(1e-12, turn_rad);
  const double risen_mm = middle_mm - half_mm, fallen_mm = middle_mm + half_mm;
  double at_mm = 0;
  for (std::size_t k = bend.first; k < behind; ++k) {
    frames[k].since_risen_mm = at_mm - risen_mm;
    at_mm += segments[k].length_mm;
    frames[k].until_fallen_mm = fallen_mm - at_mm;
  }
  const auto out_of = [](const hal::SpineSegment& piece, double along_mm) {
    return Eigen::Vector3d(-piece.normal.cross(piece.TangentAt(along_mm)).normalized());
  };
  const auto beside = [&](std::size_t line, double towards, double begin_mm, double end_mm,
                          const Eigen::Vector3d& out) {
    return SectionBeside{flattening,
                         towards,
                         begin_mm,
                         end_mm,
                         out.dot(frames[line].across),
                         out.dot(frames[line].normal)};
  };
  const double line_mm = segments[bend.first - 1].length_mm;
  frames[bend.first - 1].beside[1] = beside(bend.first - 1, 1.0, line_mm + risen_mm,
                                            line_mm + fallen_mm, out_of(segments[bend.first], 0.0));
  const hal::SpineSegment& last = segments[behind - 1];
  frames[behind].beside[0] = beside(behind, -1.0, fallen_mm - pieces_mm, risen_mm - pieces_mm,
                                    out_of(last, last.length_mm));
}

}  // namespace

void OwnedBlocks::Begin(const Eigen::Vector3d& center_mm, double half_diagonal_mm) {
  blocks_.push_back({center_mm,
                     half_diagonal_mm,
                     {points_.data() + points_.size(), 0},
                     {certainties_.data() + certainties_.size(), 0}});
}

void OwnedBlocks::Add(const Eigen::Vector3d& point) {
  if (points_.size() == points_.capacity()) return;  // more than promised
  points_.push_back(point);
  auto& held = blocks_.back().points;
  held = {held.data(), held.size() + 1};
}

void OwnedBlocks::Add(const PointBlock& from, std::size_t i) {
  if (!from.certainties.empty() && certainties_.size() < certainties_.capacity()) {
    certainties_.push_back(from.certainties[i]);
    auto& held = blocks_.back().certainties;
    held = {held.data(), held.size() + 1};
  }
  Add(from.points[i]);
}

void OwnedBlocks::AddEvery(std::size_t stride, const PointBlock& from, std::size_t& next) {
  const std::size_t size = from.points.size(), held = points_.size();
  const std::size_t count = next < size ? (size - next - 1) / stride + 1 : 0;
  if (count > points_.capacity() - held || !from.certainties.empty()) {
    for (std::size_t i = next; i < size; i += stride) Add(from, i);
  } else if (count > 0) {
    points_.resize(held + count);
    const Eigen::Vector3d* point = &from.points[next];
    for (std::size_t i = 0; i < count; ++i) points_[held + i] = point[i * stride];
    auto& of_block = blocks_.back().points;
    of_block = {of_block.data(), of_block.size() + count};
  }
  next += count * stride;
  next -= size;
}

bool AreWeighted(std::span<const PointBlock> blocks) {
  return std::any_of(blocks.begin(), blocks.end(),
                     [](const PointBlock& block) { return !block.certainties.empty(); });
}

std::size_t CountPoints(std::span<const PointBlock> blocks) {
  std::size_t count = 0;
  for (const PointBlock& block : blocks) count += block.points.size();
  return count;
}

std::vector<BlockRange> EvenRounds(std::span<const PointBlock> blocks, std::size_t least_points,
                                   std::size_t most_rounds) {
  const std::size_t all = CountPoints(blocks);
  const std::size_t rounds = std::clamp<std::size_t>(all / least_points, 1, most_rounds);
  std::vector<BlockRange> ranges;
  std::size_t points = 0, begin = 0;
  for (std::size_t i = 0; i < blocks.size(); ++i) {
    points += blocks[i].points.size();
    if (ranges.size() + 1 < rounds && points * rounds >= (ranges.size() + 1) * all) {
      ranges.push_back({begin, i + 1});
      begin = i + 1;
    }
  }
  ranges.push_back({begin, blocks.size()});
  return ranges;
}

OwnedBlocks Thinned(std::span<const PointBlock> blocks, std::size_t stride) {
  OwnedBlocks thinned(CountPoints(blocks) / stride + 1, AreWeighted(blocks));
  std::size_t next = 0;
  for (const PointBlock& block : blocks) {
    thinned.Begin(block.center_mm, block.half_diagonal_mm);
    thinned.AddEvery(stride, block, next);
  }
  return thinned;
}

OwnedBlocks Gathered(std::span<const PointBlock> blocks, std::size_t stride) {
  const std::size_t count = CountPoints(blocks);
  if (count >= blocks.size() * stride * kFewInBlock) return Thinned(blocks, stride);
  const double half_mm = 2.0 * blocks.front().half_diagonal_mm;
  const double edge_mm = 2.0 * half_mm / std::sqrt(3.0);
  struct Placed {
    std::array<double, 3> cube;
    std::size_t block;
    bool operator<(const Placed& other) const {
      return std::tie(cube, block) < std::tie(other.cube, other.block);
    }
  };
  std::vector<Placed> placed;
  placed.reserve(blocks.size());
  for (std::size_t i = 0; i < blocks.size(); ++i) {
    const Eigen::Array3d cube = (blocks[i].center_mm / edge_mm).array().floor();
    placed.push_back({{cube.x(), cube.y(), cube.z()}, i});
  }
  std::sort(placed.begin(), placed.end());
  OwnedBlocks gathered(count / stride + 1, AreWeighted(blocks));
  std::size_t next = 0;
  for (auto from = placed.begin(); from != placed.end();) {
    const auto to = std::find_if(from, placed.end(),
                                 [&](const Placed& place) { return place.cube != from->cube; });
    const auto& [x, y, z] = from->cube;
    const Eigen::Vector3d center_mm = edge_mm * Eigen::Vector3d(x + 0.5, y + 0.5, z + 0.5);
    // Points of passes that were moved reach out of their cubes.
    double reach_mm = half_mm;
    for (auto at = from; at != to; ++at) {
      const PointBlock& block = blocks[at->block];
      reach_mm = std::max(reach_mm, (block.center_mm - center_mm).norm() + block.half_diagonal_mm);
    }
    gathered.Begin(center_mm, reach_mm);
    for (; from != to; ++from) gathered.AddEvery(stride, blocks[from->block], next);
  }
  return gathered;
}

std::array<OwnedBlocks, 2> HalvesOf(std::span<const PointBlock> blocks, std::size_t enough) {
  const std::size_t count = CountPoints(blocks);
  const std::size_t stride = count / (2 * enough) + 1, most = std::min(count, 2 * enough);
  const bool are_weighted = AreWeighted(blocks);
  std::array<OwnedBlocks, 2> halves{OwnedBlocks(most, are_weighted),
                                    OwnedBlocks(most, are_weighted)};
  const DivisibleBy is_taken(stride);
  std::uint64_t index = 0;
  for (const PointBlock& block : blocks) {
    for (OwnedBlocks& half : halves) half.Begin(block.center_mm, block.half_diagonal_mm);
    for (std::size_t i = 0; i < block.points.size(); ++i) {
      // Fibonacci hashing: evenly spread, without a pattern that a scanner could share.
      const std::uint64_t lot = ++index * 0x9E3779B97F4A7C15U;
      // Which half is as hard to foresee as a coin; of many points few are taken.
      if (is_taken(lot >> 20)) halves[lot >> 63].Add(block, i);
    }
  }
  return halves;
}

SegmentFrame::SegmentFrame(const hal::SpineSegment& segment, bool open_before, bool open_after,
                           double beyond_mm, const std::optional<Flattening>& of_bend)
    : start_mm(segment.start_mm),
      tangent(segment.tangent),
      across(segment.normal.cross(segment.tangent)),
      normal(segment.normal),
      low_mm(open_before ? -std::numeric_limits<double>::infinity() : 0.0),
      high_mm(open_after ? std::numeric_limits<double>::infinity() : segment.length_mm),
      cut_low_mm(open_before ? -beyond_mm : low_mm - kNever),
      cut_high_mm(open_after ? segment.length_mm + beyond_mm : high_mm + kNever),
      bend_radius_mm(segment.is_arc() ? segment.bend_radius_mm : 0.0),
      sine(segment.is_arc() ? std::sin(segment.angle_rad()) : 0.0),
      cosine(segment.is_arc() ? std::cos(segment.angle_rad()) : 1.0),
      beyond_half_turn(segment.angle_rad() > std::numbers::pi),
      middle_mm(segment.PointAt(0.5 * segment.length_mm)),
      around_mm(open_before || open_after ? std::numeric_limits<double>::infinity()
                                          : 0.5 * segment.length_mm),
      flattening(segment.is_arc() ? of_bend : std::nullopt),
      half_sine(std::sin(0.5 * segment.angle_rad())),
      half_cosine(std::cos(0.5 * segment.angle_rad())),
      bump_floor(half_cosine),
      bump_scale(segment.is_arc() ? 1.0 / std::max(1e-12, 1.0 - half_cosine) : 0.0) {}

double SegmentFrame::Distance(const Eigen::Vector3d& point) const {
  const Eigen::Vector3d v = point - start_mm;
  const double x = v.dot(tangent);
  if (bend_radius_mm <= 0) {
    if (x < cut_low_mm || x > cut_high_mm) return kNever;
    return (v - std::min(std::max(x, low_mm), high_mm) * tangent).norm();
  }
  const double h = v.dot(normal);
  const double y = bend_radius_mm - v.dot(across);  // from the centre
  // Inside the sector: after the first plane and before the last, or either beyond a half turn.
  const bool after_first = x >= 0;
  const bool before_last = x * cosine - y * sine <= 0;
  if (beyond_half_turn ? after_first || before_last : after_first && before_last) {
    const double u = std::sqrt(x * x + y * y) - bend_radius_mm;
    return std::sqrt(u * u + h * h);
  }
  const double ex = x - bend_radius_mm * sine;
  const double ey = y - bend_radius_mm * cosine;
  return std::sqrt(std::min(v.squaredNorm(), ex * ex + ey * ey + h * h));
}

std::vector<SegmentFrame> SegmentFrames(std::span<const hal::SpineSegment> segments,
                                        double beyond_mm, std::span<const Flattening> flattening) {
  std::vector<SegmentFrame> frames;
  frames.reserve(segments.size());
  for (std::size_t k = 0; k < segments.size(); ++k) {
    std::optional<Flattening> of_bend;
    if (k % 2 == 1 && k / 2 < flattening.size()) of_bend = flattening[k / 2];
    frames.emplace_back(segments[k], k == 0, k + 1 == segments.size(), beyond_mm, of_bend);
  }
  for (std::size_t k = 1; k + 1 < segments.size() && k / 2 < flattening.size(); k += 2) {
    const Flattening& of_bend = flattening[k / 2];
    if (!of_bend.rise.is_none()) LetRise(segments, {k, 1, segments[k].length_mm}, of_bend, frames);
  }
  return frames;
}

std::vector<SegmentFrame> SegmentFrames(const EasedSpine& spine, double beyond_mm,
                                        std::span<const Flattening> flattening) {
  if (spine.pieces == 1) return SegmentFrames(spine.segments, beyond_mm, flattening);
  std::vector<SegmentFrame> frames;
  frames.reserve(spine.segments.size());
  double half_rad = 0, to_middle_rad = 0;  // of the bend; from the piece's start
  for (std::size_t k = 0; k < spine.segments.size(); ++k) {
    std::optional<Flattening> of_piece;
    if (!spine.is_line(k) && !flattening.empty()) of_piece = flattening[spine.row(k)];
    SegmentFrame& frame = frames.emplace_back(spine.segments[k], k == 0,
                                              k + 1 == spine.segments.size(), beyond_mm, of_piece);
    if (spine.is_line(k)) continue;
    if (spine.is_line(k - 1)) {
      half_rad = 0;
      for (std::size_t i = k; i < k + spine.pieces; ++i) {
        half_rad += 0.5 * spine.segments[i].angle_rad();
      }
      to_middle_rad = half_rad;
    }
    frame.half_sine = std::sin(to_middle_rad);
    frame.half_cosine = std::cos(to_middle_rad);
    frame.bump_floor = std::cos(half_rad);
    frame.bump_scale = 1.0 / std::max(1e-12, 1.0 - frame.bump_floor);
    to_middle_rad -= spine.segments[k].angle_rad();
    frame.share = spine.share[k];
  }
  for (std::size_t k = 1; k < spine.segments.size() && !flattening.empty(); k += spine.pieces + 1) {
    const Flattening& of_bend = flattening[spine.row(k)];
    if (of_bend.rise.is_none()) continue;
    double turn_rad = 0;
    for (std::size_t i = k; i < k + spine.pieces; ++i) turn_rad += spine.segments[i].angle_rad();
    const double radius_mm = spine.share[k] * spine.segments[k].bend_radius_mm;
    LetRise(spine.segments, {k, spine.pieces, turn_rad * radius_mm}, of_bend, frames);
  }
  return frames;
}

NearSegment NearestSegment(const Eigen::Vector3d& point, std::span<const SegmentFrame> frames,
                           std::span<const std::int32_t> candidates) {
  NearSegment best{-1, std::numeric_limits<double>::infinity()};
  for (const std::int32_t k : candidates) {
    const double distance = frames[static_cast<std::size_t>(k)].Distance(point);
    if (distance < best.distance_mm) best = {k, distance};
  }
  return best;
}

void CandidateSegments(const PointBlock& block, std::span<const SegmentFrame> frames,
                       double reach_mm, std::vector<std::int32_t>& out) {
  out.clear();
  const double reach = reach_mm + block.half_diagonal_mm;
  for (std::size_t k = 0; k < frames.size(); ++k) {
    const double most_mm = frames[k].around_mm + reach;
    if ((block.center_mm - frames[k].middle_mm).squaredNorm() > most_mm * most_mm) continue;
    if (frames[k].Distance(block.center_mm) <= reach) out.push_back(static_cast<std::int32_t>(k));
  }
}

SpineFoot NearestFoot(const Eigen::Vector3d& point, std::span<const hal::SpineSegment> segments,
                      std::span<const SegmentFrame> frames,
                      std::span<const std::int32_t> candidates) {
  const NearSegment near = NearestSegment(point, frames, candidates);
  const auto last = static_cast<std::int32_t>(segments.size()) - 1;
  if (near.segment < 0) return {};
  return {near.segment,
          AlongOf(point, segments[static_cast<std::size_t>(near.segment)], near.segment == 0,
                  near.segment == last),
          near.distance_mm};
}

}  // namespace bendloop::pipeline
