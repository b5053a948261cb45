// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <bitset>
#include <cstdint>
#include <span>
#include <vector>

#include "pipeline/math/workers.h"
#include "pipeline/points/cell_numbers.h"
#include "pipeline/points/sensor_direction.h"

namespace bendloop::pipeline {

// The scanned points, sorted into cubes ("blocks") as they arrive. Each block is divided into
// kSubdivisions^3 voxels; the first point of a voxel becomes a sample, and the local estimates look
// at samples only. So the work grows with the tube's surface and not with the density of the scan.
// The other points wait for the final fit. There may be `max_points` of them; when more come, every
// block keeps every second, then every fourth and so on of its points, evenly over the whole scan,
// so that memory and the time of the final fit are bounded however long the scan is.
class SampleGrid {
 public:
  static constexpr int kSubdivisions = 5;
  // More points than these in one voxel add no information that the fit could use before the
  // scanner's own systematic errors dominate.
  static constexpr std::size_t kMaxPointsOfVoxel = 256;
  static constexpr std::size_t kMaxPoints = 4'000'000;

  struct Block {
    Eigen::Vector3i cell = Eigen::Vector3i::Zero();
    std::array<std::int32_t, 27> neighbours{};  // block indices, -1: none; 13 is the block itself
    std::bitset<kSubdivisions * kSubdivisions * kSubdivisions> seen;
    std::vector<Eigen::Vector3d> points;  // first the samples, then the others
    // Of the points, one each; none as long as nothing is known of any.
    std::vector<SensorDirection> to_sensor;
    std::uint32_t sample_count = 0;
    std::uint32_t stride = 1;   // of the others only every so many-th is kept: a power of two
    std::uint32_t arrived = 0;  // others, kept or not

    std::span<const Eigen::Vector3d> samples() const { return {points.data(), sample_count}; }
  };

  // `block_mm`: edge of a block, at least the radius of the local paraboloid.
  explicit SampleGrid(double block_mm, std::size_t max_points = kMaxPoints)
      : block_mm_(block_mm), inverse_mm_(1.0 / block_mm), max_points_(max_points) {}

  enum class Insertion { kSample, kOther, kDropped };
  // Returns what became of the point; `block` receives its block's index unless it was dropped.
  Insertion Insert(const Eigen::Vector3d& point, std::int32_t& block,
                   SensorDirection to_sensor = {});
  // The same for many points, one after the other; faster, and with the same result. `to_sensor`:
  // as many, or none.
  void InsertAll(std::span<const Eigen::Vector3d> points, Workers* workers = nullptr,
                 std::span<const SensorDirection> to_sensor = {});

  const std::vector<Block>& blocks() const { return blocks_; }
  double block_mm() const { return block_mm_; }
  Eigen::Vector3d CenterOf(const Block& block) const {
    return (block.cell.cast<double>() + Eigen::Vector3d::Constant(0.5)) * block_mm_;
  }
  std::size_t sample_count() const { return sample_count_; }
  std::size_t point_count() const { return point_count_; }                 // that came
  std::size_t kept_count() const { return sample_count_ + other_count_; }  // that are here

  // Indices of the blocks that places are in; -1: none.
  std::vector<std::int32_t> BlocksOf(std::span<const Eigen::Vector3d> points) const;
  // Samples in the 27 blocks around `block`, in a fixed order.
  void GatherNeighbourhood(std::int32_t block, std::vector<Eigen::Vector3d>& out) const;
  // Samples within `radius_mm` of `center`.
  void GatherBall(const Eigen::Vector3d& center, double radius_mm,
                  std::vector<Eigen::Vector3d>& out) const;
  // Indices of the blocks within `radius_mm` (in whole blocks) of any of the places, ascending.
  std::vector<std::int32_t> BlocksNear(std::span<const Eigen::Vector3d> places,
                                       double radius_mm) const;
  // Number of samples in the blocks that GatherBall looks at: while it stays, so do the samples.
  std::uint64_t BallVersion(const Eigen::Vector3d& center, double radius_mm) const;

 private:
  // Where a point goes: its cell, and its voxel there.
  struct Place {
    Eigen::Vector3i cell;
    std::size_t voxel = 0;
  };
  bool Locate(const Eigen::Vector3d& point, Place& place) const;  // false: nowhere
  Insertion InsertInto(Block& block, const Eigen::Vector3d& point, std::size_t voxel) const;
  // Of the point that was inserted last.
  static void SetDirection(Block& block, Insertion what, SensorDirection to_sensor);
  Eigen::Vector3i CellOf(const Eigen::Vector3d& point) const;
  std::int32_t Find(const Eigen::Vector3i& cell) const;
  std::int32_t FindOrCreate(const Eigen::Vector3i& cell);
  template <class Visit>
  void VisitBlocks(const Eigen::Vector3d& center, double radius_mm, Visit visit) const;

  // Keeps the number of others within bounds.
  void BoundOthers();
  // Drops every second of the block's others.
  static void Thin(Block& block);
  bool IsFull(const Block& block) const {
    return block.points.size() >= (points_of_voxel_ + 1) * block.sample_count;
  }

  double block_mm_, inverse_mm_;
  std::size_t max_points_;
  std::size_t points_of_voxel_ = kMaxPointsOfVoxel;  // fewer when there are too many
  CellNumbers numbers_;                              // of the blocks
  std::vector<Block> blocks_;
  std::int32_t last_block_ = -1;
  std::size_t sample_count_ = 0;
  std::size_t point_count_ = 0;
  std::size_t other_count_ = 0;
};

}  // namespace bendloop::pipeline
