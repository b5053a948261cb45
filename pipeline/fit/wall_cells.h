// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "hal/tube.h"
#include "pipeline/fit/nearest_lanes.h"
#include "pipeline/fit/surface_points.h"
#include "pipeline/fit/surface_sums.h"

namespace bendloop::pipeline {

// Points of a tube counted by place on its unrolled surface: rows along it, columns around it, in
// the turn that goes on over all segments.
struct WallCells {
  int rows = 0, columns = 0;
  double row_mm = 0;
  std::vector<std::uint32_t> count;  // none: too few points tell of the wall

  // `column`: anywhere in turns that go on.
  std::size_t At(int row, int column) const {
    if (column < 0 || column >= columns) column = (column % columns + columns) % columns;
    return static_cast<std::size_t>(row) * static_cast<std::size_t>(columns) +
           static_cast<std::size_t>(column);
  }
  void Add(const WallCells& others);  // of the same size
  WallCells Coarser() const;          // four cells in one
};
// Both numbers of cells can be halved for so many grids, each coarser than the one before; fewer
// columns tell of no turn.
constexpr int kWallGrids = 4;
constexpr int kLeastColumns = 12;

// The finest cells of a tube: a few points in each of them, so that those without any are few.
struct EmptyWallCells {
  WallCells cells;         // all 0
  std::size_t stride = 1;  // every so-manieth point is counted
};
EmptyWallCells EmptyCellsOf(const hal::Tube& tube, std::span<const PointBlock> blocks);

// The cells of a batch's points, as if all were nearest to one segment. [mm], where nothing is
// said.
struct CellLoop {
  double r_mm = 0;
  double from_start_mm = 0;   // of the segment
  double bend_radius_mm = 0;  // 0: a line
  double turned = 0;          // of a turn: its normal, in the turn that goes on
  double rows_per_mm = 0, rows = 0, columns = 0;
};

// Counts the points of blocks: in a walk of its own, or in that of another who looks for their
// nearest segments, too.
class WallCellCounter {
 public:
  static constexpr double kNearSegment = 2.0;  // [of r_P] From the spine: as far as anything counts
  using AlongArcs = std::vector<std::array<double, kBatch>>;

  WallCellCounter(const hal::Tube& tube, const EmptyWallCells& empty);

  // Whether another's lanes do, who has the same tube of sharp bends, but ends that go on further,
  // and whose candidates for the block's points are all within kNearSegment.
  bool Shares(const PointBlock& block, std::span<const std::int32_t> candidates) const;
  // The first `count` points of a batch of a block that is shared. `along_mm`: of candidates that
  // are arcs; `index`: of the first point among all.
  void AddShared(const NearestLanes& nearest, std::span<const std::int32_t> candidates,
                 const AlongArcs& along_mm, std::size_t count, std::size_t index);
  // `index`: of the block's first point among all.
  void Add(const PointBlock& block, std::size_t index);
  WallCells TakeCells();

 private:
  // Of the points of a batch those from `first` on, `step` apart.
  void Count(const NearestLanes& nearest, std::span<const std::int32_t> candidates,
             const AlongArcs& along_mm, std::size_t count, std::size_t first, std::size_t step);
  std::size_t FirstCounted(std::size_t index) const {
    return (stride_ - index % stride_) % stride_;
  }

  std::size_t stride_;
  double r_mm_;
  std::vector<SegmentFrame> frames_;
  WallCells cells_;
  std::vector<CellLoop> loops_;
  std::vector<std::int32_t> candidates_;
  NearestLanes nearest_;
  std::vector<Eigen::Vector3d> taken_;
  AlongArcs along_mm_;
  std::vector<std::array<std::int32_t, kBatch>> at_;  // of a batch, by candidate
  // Those that are counted of a batch, one behind the other.
  LocalLanes some_;
  std::array<double, kBatch> some_along_mm_{};
};

}  // namespace bendloop::pipeline
