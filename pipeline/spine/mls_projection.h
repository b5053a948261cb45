// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <unordered_map>
#include <unordered_set>
#include <vector>

#include "pipeline/math/workers.h"
#include "pipeline/points/sample_grid.h"
#include "pipeline/spine/spine_node.h"

namespace bendloop::pipeline {

// Samples onto the spine (sections 3.2 to 3.4), while they arrive. Each block's samples start at
// p - r_P nu with the direction of least curvature as tangent; starts that share a cube of the
// spine share one cylinder fit. Everything is a pure function of the samples present: it is
// computed again only where they changed, so the order and the moment of calls do not matter.
// Source: Bauer & Polthier 2009, section 3; outlier rules of section 7.
class MlsProjection {
 public:
  explicit MlsProjection(double pipe_radius_mm) : radius_mm_(pipe_radius_mm) {}

  // Edge of the blocks that the grid must have: the paraboloid's radius, 2/3 r_P (section 7).
  static double BlockMm(double pipe_radius_mm) { return 2.0 / 3.0 * pipe_radius_mm; }

  // Computes the starts of blocks again, from the samples that they and their neighbours now hold.
  void UpdateBlocks(const SampleGrid& grid, std::span<const std::int32_t> blocks,
                    Workers* workers = nullptr);
  // Fits cylinders again where starts changed.
  void UpdateNodes(const SampleGrid& grid, Workers* workers = nullptr);
  // The same, and where samples further away changed since: on the tube's far side, and two blocks
  // from a sparse one. Blocks whose own or neighbouring samples changed must be updated before.
  void FinishNodes(const SampleGrid& grid, Workers* workers = nullptr);

  // True where most samples of the block lie on a plane, as of a table or a clamp: no part of a
  // tube of this radius, even where the plane passes through the tube's surface.
  bool IsPlanar(std::int32_t block) const { return planar_.contains(block); }

  // All accepted nodes, in a fixed order (by place, not by time).
  std::vector<SpineNode> Nodes() const;

 private:
  struct Start {
    Eigen::Vector3d point_mm;
    Eigen::Vector3d tangent;
  };
  struct Cube {
    std::vector<std::pair<std::int32_t, Start>> starts;   // by block
    Eigen::Vector3d center_mm = Eigen::Vector3d::Zero();  // of the ball that the fit saw
    double ball_mm = 0;
    std::uint64_t versions = 0;  // of the samples in it
    bool changed = false;
    bool accepted = false;
    SpineNode node;
  };

  // What the samples of a block and around it say.
  struct BlockStarts {
    std::vector<Start> starts;
    bool planar = false;
    bool wide = false;  // needed the wider paraboloid
  };
  struct Scratch {
    std::vector<Eigen::Vector3d> around, ball;
  };

  BlockStarts StartsOf(const SampleGrid& grid, std::int32_t block, Scratch& scratch) const;
  void Take(const SampleGrid& grid, std::int32_t block, const BlockStarts& found);
  std::uint64_t WideVersion(const SampleGrid& grid, std::int32_t block) const;
  std::uint64_t KeyOf(const Eigen::Vector3d& point) const;
  void MarkChanged(std::uint64_t key, Cube& cube);
  void Fit(const SampleGrid& grid, Cube& cube, Scratch& scratch) const;

  double radius_mm_;
  std::unordered_map<std::uint64_t, Cube> cubes_;
  std::vector<std::uint64_t> changed_;
  std::unordered_map<std::int32_t, std::vector<std::uint64_t>> cubes_of_block_;
  std::unordered_set<std::int32_t> planar_;
  // Blocks that needed the wider paraboloid, which sees two blocks far: versions of what it saw.
  std::unordered_map<std::int32_t, std::uint64_t> wide_blocks_;
};

}  // namespace bendloop::pipeline
