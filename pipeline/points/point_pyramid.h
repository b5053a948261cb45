// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "pipeline/points/cell_numbers.h"

namespace bendloop::pipeline {

// Points at any resolution: sorted once along a Morton curve, on which every cube of every octave
// is one run, so that thinning them to one a voxel is a walk.
class PointPyramid {
 public:
  // At one resolution, in cells.
  class Level {
   public:
    std::size_t cell_count() const { return begin_.size(); }
    // Points within `radius_mm` of `center`, in a fixed order.
    void GatherBall(const Eigen::Vector3d& center, double radius_mm,
                    std::vector<Eigen::Vector3d>& out) const;

   private:
    friend class PointPyramid;
    Eigen::Vector3d low_mm_ = Eigen::Vector3d::Zero();
    double cell_mm_ = 0;
    int last_cell_ = 0;                    // of an axis
    std::vector<Eigen::Vector3d> points_;  // cell by cell
    CellNumbers cells_;
    std::vector<std::uint32_t> begin_;  // of the cells' points
  };

  // Finite points.
  explicit PointPyramid(std::span<const Eigen::Vector3d> points);

  std::size_t size() const { return points_.size(); }

  // One point a voxel, the first that came, the voxels' edge between a half of `voxel_mm` and the
  // whole. Made when first asked for, and lasts as long as the pyramid.
  const Level& Thinned(double voxel_mm);

 private:
  static constexpr int kBits = 16;      // an axis
  static constexpr int kVoxelBits = 3;  // a level's cells are 8 voxels wide

  Level MakeLevel(int halvings) const;  // of the edge of all to a voxel's
  Eigen::Vector3i FinestOf(const Eigen::Vector3d& point) const;

  std::span<const Eigen::Vector3d> points_;
  Eigen::Vector3d low_mm_ = Eigen::Vector3d::Zero();
  double size_mm_ = 1;  // edge of the cube that holds all
  struct Place {
    std::uint64_t key = 0;    // along the curve
    std::uint32_t index = 0;  // of the point
  };
  std::vector<Place> sorted_;
  std::array<std::optional<Level>, kBits + 1> levels_;  // by halvings
};

}  // namespace bendloop::pipeline
