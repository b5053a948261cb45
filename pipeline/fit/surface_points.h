// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <limits>
#include <optional>
#include <span>
#include <vector>

#include "hal/spine.h"
#include "pipeline/points/sensor_direction.h"
#include "pipeline/tube/easing.h"
#include "pipeline/tube/flattening.h"

namespace bendloop::pipeline {

// Points near each other, so that they share the question which segments may be theirs. Another
// object holds them.
struct PointBlock {
  Eigen::Vector3d center_mm;
  double half_diagonal_mm = 0;
  std::span<const Eigen::Vector3d> points;
  // How certain each is: the standard deviation of a point of mean weight over its own. Of all
  // blocks or of none: then all are alike.
  std::span<const float> certainties = {};
  std::span<const SensorDirection> to_sensor = {};  // one each, or none: not known
};
std::size_t CountPoints(std::span<const PointBlock> blocks);
bool AreWeighted(std::span<const PointBlock> blocks);  // whether points have certainties

// Blocks with their points.
class OwnedBlocks {
 public:
  // `points`: as many as all blocks will hold, or more. `weighted`: they have certainties.
  explicit OwnedBlocks(std::size_t points, bool weighted = false) {
    points_.reserve(points);
    if (weighted) certainties_.reserve(points);
  }
  OwnedBlocks(OwnedBlocks&&) = default;
  OwnedBlocks& operator=(OwnedBlocks&&) = default;

  // A new block; Add() goes to it.
  void Begin(const Eigen::Vector3d& center_mm, double half_diagonal_mm);
  void Add(const Eigen::Vector3d& point);
  void Add(const PointBlock& from, std::size_t i);  // with its certainty
  // Every `stride`-th of the block's points from `next` on; becomes where that of a block behind it
  // is.
  void AddEvery(std::size_t stride, const PointBlock& from, std::size_t& next);

  std::size_t point_count() const { return points_.size(); }
  operator std::span<const PointBlock>() const { return blocks_; }

 private:
  // Neither grows beyond what was reserved: blocks look at it.
  std::vector<Eigen::Vector3d> points_;
  std::vector<float> certainties_;
  std::vector<PointBlock> blocks_;
};

// The points that `leaves_out(block, point)` is false of.
template <typename LeavesOut>
OwnedBlocks PointsWithout(std::span<const PointBlock> blocks, const LeavesOut& leaves_out) {
  OwnedBlocks left(CountPoints(blocks), AreWeighted(blocks));
  for (const PointBlock& block : blocks) {
    left.Begin(block.center_mm, block.half_diagonal_mm);
    for (std::size_t i = 0; i < block.points.size(); ++i) {
      if (!leaves_out(block, block.points[i])) left.Add(block, i);
    }
  }
  return left;
}

// Every so-manieth of `count` is to be taken for at most `enough`.
inline std::size_t StrideTo(std::size_t count, std::size_t enough) {
  return count > enough ? (count - 1) / enough + 1 : 1;
}
// Every `stride`-th point, counted over all blocks, so that small ones do not weigh more.
OwnedBlocks Thinned(std::span<const PointBlock> blocks, std::size_t stride);
// The same in cubes of twice the edge, where few points are left in one: what is worked out once
// for a cube is worth it for dozens only. `blocks`: cubes of a grid through the origin.
OwnedBlocks Gathered(std::span<const PointBlock> blocks, std::size_t stride);
// The points in two halves, drawn by lot (always the same), each thinned to about `enough`.
std::array<OwnedBlocks, 2> HalvesOf(std::span<const PointBlock> blocks, std::size_t enough);
// Blocks [begin, end) of a list.
struct BlockRange {
  std::size_t begin = 0, end = 0;
};
// Parts the blocks, in their order, into rounds with about as many points each, at most
// `most_rounds` and no more than one for every `least_points`. At least one.
std::vector<BlockRange> EvenRounds(std::span<const PointBlock> blocks, std::size_t least_points,
                                   std::size_t most_rounds);

// Where a point belongs on a spine.
struct SpineFoot {
  std::int32_t segment = -1;  // -1: none near
  double along_mm = 0;        // on the segment, within [0, length] but for the two end straights
  double distance_mm = 0;     // from the spine
};

struct NearSegment {
  std::int32_t segment = -1;
  double distance_mm = 0;  // from the spine
};

// How far a section has risen, [halves of its rise] behind the middle of that: 0 up to -1, 1 from 1
// on, a cubic between.
inline double Risen(double t) {
  const double inside = t < -1.0 ? -1.0 : (t > 1.0 ? 1.0 : t);
  return 0.25 * (2.0 + inside * (3.0 - inside * inside));
}

// What the bend beyond a line's end makes of the line's section, if it rises by itself.
struct SectionBeside {
  Flattening of_bend;
  double towards = 0;  // 1: the bend lies behind it, -1: before; 0: there is none
  // Along the line, straight on: where it is half risen, and half fallen behind the bend.
  double half_risen_mm = 0, half_fallen_mm = 0;
  double out_y = 1, out_z = 0;  // its outer side, across and normal
};

// A segment with what the distance from it needs, worked out once for many points.
struct SegmentFrame {
  // `beyond_mm`: how far an open end goes on.
  SegmentFrame(const hal::SpineSegment& segment, bool open_before, bool open_after,
               double beyond_mm = std::numeric_limits<double>::infinity(),
               const std::optional<Flattening>& of_bend = std::nullopt);
  // From the segment's spine; beyond its ends from them, unless it is open there: then infinite
  // where it no longer goes on.
  double Distance(const Eigen::Vector3d& point) const;
  bool is_flattened() const {
    return flattening || beside[0].towards != 0 || beside[1].towards != 0;
  }

  Eigen::Vector3d start_mm, tangent, across, normal;
  double low_mm, high_mm;          // of a line
  double cut_low_mm, cut_high_mm;  // of a line: nothing is near beyond
  double bend_radius_mm;           // 0: a line
  double sine, cosine;             // of an arc's angle
  bool beyond_half_turn;
  Eigen::Vector3d middle_mm;  // a ball that the segment lies in
  double around_mm;
  std::optional<Flattening> flattening;  // of an arc
  double half_sine, half_cosine;         // of the angle from its start to the bend's middle
  double bump_floor;                     // cosine of half the bend's angle
  double bump_scale;                     // B = (cos(angle from the middle) - bump_floor) * this
  double share = 1;                      // of the bend's curvature
  // Where the bend's section rises by itself: how far it is half risen before this arc begins, and
  // half fallen behind where this arc ends.
  double since_risen_mm = 0, until_fallen_mm = 0;
  std::array<SectionBeside, 2> beside;  // of a line
};
// Of r_P: how far the end straights may go on beyond the nodes; further out another part of the
// tube may lie in their way.
constexpr double kBeyond = 3.0;
// All segments of a tube; the end straights go on beyond their ends, as far as `beyond_mm`.
// `flattening`: bend by bend, or none: the bends are round.
std::vector<SegmentFrame> SegmentFrames(std::span<const hal::SpineSegment> segments,
                                        double beyond_mm = std::numeric_limits<double>::infinity(),
                                        std::span<const Flattening> flattening = {});
// The same of a tube whose bends may be eased.
std::vector<SegmentFrame> SegmentFrames(const EasedSpine& spine, double beyond_mm,
                                        std::span<const Flattening> flattening);
NearSegment NearestSegment(const Eigen::Vector3d& point, std::span<const SegmentFrame> frames,
                           std::span<const std::int32_t> candidates);
// Segments whose spine passes within `reach_mm` of the block's centre plus its half diagonal.
void CandidateSegments(const PointBlock& block, std::span<const SegmentFrame> frames,
                       double reach_mm, std::vector<std::int32_t>& out);

// Nearest segment among `candidates` and where on it; `frames` belong to `segments`.
SpineFoot NearestFoot(const Eigen::Vector3d& point, std::span<const hal::SpineSegment> segments,
                      std::span<const SegmentFrame> frames,
                      std::span<const std::int32_t> candidates);

}  // namespace bendloop::pipeline
