// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/wall_cells.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include "hal/tube_features.h"
#include "pipeline/math/circle_sectors.h"
#include "pipeline/math/simd.h"

namespace bendloop::pipeline {
namespace {

struct CellSettings {
  // Points of a cell of the finest grid, on average; each coarser one has four times as many.
  double in_cell = 3.0;
  int most_around = 512;  // cells of a turn
  std::size_t most_cells = 4'000'000;
  // [of r_P] From the surface: whatever is there hides the wall, or is the wall. What lies further
  // in may be the bore, seen through an opening.
  double inside = 0.1, outside = 1.0;
  // For each pipe radius of the tube's length so many points tell of any hole: one of a tenth of a
  // pipe radius lacks twelve of them.
  double enough_points = 10'000.0;
  double least_points = 100.0;  // of the tube
};
constexpr CellSettings kCells;
constexpr double kBeyondEnds = 1.0;  // [of r_P] So far its ends go on.

// What is in none is in the row behind the last. Without a branch, so that several points are taken
// at once.
template <bool kIsArc>
BENDLOOP_LOOP void FindCellsBody(const CellLoop& of, const LocalLanes& local,
                                 const double* along_mm, std::size_t count, std::int32_t* cell) {
  constexpr double kPerTurn = 0.5 / std::numbers::pi;
  // Of its own, so that nobody thinks that `cell` changes them.
  const auto [r_mm, from_start_mm, bend_mm, turned, rows_per_mm, rows, columns] = of;
  const double inside_mm = -kCells.inside * r_mm, outside_mm = kCells.outside * r_mm;
  const auto whole_columns = static_cast<std::int32_t>(columns);
  const std::int32_t last = whole_columns - 1;
  const double none = of.rows;  // the row behind the last takes what is in no cell
  for (std::size_t i = 0; i < count; ++i) {
    const double off_mm = local.distance[i] - r_mm;
    const double row = (from_start_mm + along_mm[i]) * rows_per_mm;
    // Right-handed about the feed from the segment's normal; an arc's y counts from its centre.
    double outward = 0;
    if constexpr (kIsArc) {
      outward = std::sqrt(local.x[i] * local.x[i] + local.y[i] * local.y[i]) - bend_mm;
    } else {
      outward = -local.y[i];
    }
    double turn = RoughTurn(outward, local.z[i]) * kPerTurn + turned;
    turn = turn < 0 ? turn + 1.0 : turn;
    turn = turn < 1 ? turn : turn - 1.0;
    const auto column = static_cast<std::int32_t>(turn * columns);
    double at = row >= 0 ? row : none;
    at = row < rows ? at : none;
    at = off_mm > inside_mm ? at : none;
    at = off_mm < outside_mm ? at : none;
    const std::int32_t whole = column < last ? column : last;
    cell[i] = static_cast<std::int32_t>(at) * whole_columns + whole;
  }
}
BENDLOOP_LOOP void FindCellsOfLineBody(const CellLoop& of, const LocalLanes& local,
                                       std::size_t count, std::int32_t* cell) {
  FindCellsBody<false>(of, local, local.x.data(), count, cell);
}
BENDLOOP_MULTIVERSION(void, FindCellsOfLine,
                      (const CellLoop& of, const LocalLanes& local, std::size_t count,
                       std::int32_t* cell),
                      (of, local, count, cell))
BENDLOOP_LOOP void FindCellsOfArcBody(const CellLoop& of, const LocalLanes& local,
                                      const double* along_mm, std::size_t count,
                                      std::int32_t* cell) {
  FindCellsBody<true>(of, local, along_mm, count, cell);
}
BENDLOOP_MULTIVERSION(void, FindCellsOfArc,
                      (const CellLoop& of, const LocalLanes& local, const double* along_mm,
                       std::size_t count, std::int32_t* cell),
                      (of, local, along_mm, count, cell))

}  // namespace

void WallCells::Add(const WallCells& others) {
  for (std::size_t cell = 0; cell < count.size(); ++cell) count[cell] += others.count[cell];
}

WallCells WallCells::Coarser() const {
  WallCells coarse{rows / 2, columns / 2, 2.0 * row_mm, {}};
  coarse.count.reserve(static_cast<std::size_t>(coarse.rows) *
                       static_cast<std::size_t>(coarse.columns));
  for (int row = 0; row < coarse.rows; ++row) {
    const std::uint32_t* first = &count[At(2 * row, 0)];
    const std::uint32_t* second = &count[At(2 * row + 1, 0)];
    for (int column = 0; column < 2 * coarse.columns; column += 2) {
      coarse.count.push_back(first[column] + first[column + 1] + second[column] +
                             second[column + 1]);
    }
  }
  return coarse;
}

EmptyWallCells EmptyCellsOf(const hal::Tube& tube, std::span<const PointBlock> blocks) {
  EmptyWallCells empty;
  const double length_mm = hal::SpineLength(tube.program), r_mm = tube.pipe_radius_mm;
  const double turn_mm = 2.0 * std::numbers::pi * r_mm;
  const std::size_t all = CountPoints(blocks);
  const double enough = kCells.enough_points * std::max(1.0, length_mm / r_mm);
  empty.stride = StrideTo(all, static_cast<std::size_t>(enough));
  const double points = static_cast<double>(all) / static_cast<double>(empty.stride);
  if (!(length_mm > 0) || points < kCells.least_points) return empty;
  // Both numbers can be halved for the coarser grids.
  const int whole = 1 << (kWallGrids - 1);
  const auto round_up = [&](double number) {
    return whole * std::max(1, static_cast<int>(std::lround(number / whole)));
  };
  const double cell_mm = std::max(
      {std::sqrt(kCells.in_cell * turn_mm * length_mm / points), turn_mm / kCells.most_around,
       std::sqrt(turn_mm * length_mm / static_cast<double>(kCells.most_cells))});
  WallCells& cells = empty.cells;
  cells.columns = round_up(turn_mm / cell_mm);
  cells.rows = round_up(length_mm / cell_mm);
  cells.row_mm = length_mm / cells.rows;
  if (cells.columns < kLeastColumns) return empty;
  cells.count.assign(static_cast<std::size_t>(cells.rows) * static_cast<std::size_t>(cells.columns),
                     0);
  return empty;
}

WallCellCounter::WallCellCounter(const hal::Tube& tube, const EmptyWallCells& empty)
    : stride_(empty.stride),
      r_mm_(tube.pipe_radius_mm),
      frames_(SegmentFrames(hal::SpineSegments(tube.program, tube.X_WT), kBeyondEnds * r_mm_)),
      cells_(empty.cells) {
  cells_.count.resize(cells_.count.size() + static_cast<std::size_t>(cells_.columns));
  const auto segments = hal::SpineSegments(tube.program, tube.X_WT);
  // Each segment's own normal, in the turn that goes on over all of them.
  double turn_deg = 0;
  for (std::size_t k = 0; k < segments.size(); ++k) {
    if (k > 0) {
      turn_deg += hal::AroundDeg(segments[k - 1].normal, segments[k].tangent, segments[k].normal);
    }
    loops_.push_back({r_mm_, segments[k].from_start_mm, frames_[k].bend_radius_mm,
                      turn_deg / 360.0 - std::floor(turn_deg / 360.0), 1.0 / cells_.row_mm,
                      static_cast<double>(cells_.rows), static_cast<double>(cells_.columns)});
  }
}

bool WallCellCounter::Shares(const PointBlock& block,
                             std::span<const std::int32_t> candidates) const {
  // Beyond an end its straight goes on for the other where it does not here.
  return std::all_of(candidates.begin(), candidates.end(), [&](std::int32_t k) {
    const SegmentFrame& frame = frames_[static_cast<std::size_t>(k)];
    if (k > 0 && k + 1 < static_cast<std::int32_t>(frames_.size())) return true;
    const double along_mm = (block.center_mm - frame.start_mm).dot(frame.tangent);
    return along_mm - block.half_diagonal_mm > frame.cut_low_mm &&
           along_mm + block.half_diagonal_mm < frame.cut_high_mm;
  });
}

void WallCellCounter::AddShared(const NearestLanes& nearest,
                                std::span<const std::int32_t> candidates, const AlongArcs& along_mm,
                                std::size_t count, std::size_t index) {
  Count(nearest, candidates, along_mm, count, FirstCounted(index), stride_);
}

void WallCellCounter::Count(const NearestLanes& nearest, std::span<const std::int32_t> candidates,
                            const AlongArcs& along_mm, std::size_t count, std::size_t first,
                            std::size_t step) {
  if (first >= count) return;
  const std::size_t counted = (count - first - 1) / step + 1;
  if (at_.size() < candidates.size()) at_.resize(candidates.size());
  for (std::size_t c = 0; c < candidates.size(); ++c) {
    const CellLoop& loop = loops_[static_cast<std::size_t>(candidates[c])];
    const bool is_arc = loop.bend_radius_mm > 0;
    const LocalLanes* local = &nearest.Local(c);
    const double* along = is_arc ? along_mm[c].data() : nullptr;
    if (step > 1) {
      for (std::size_t i = 0, from = first; i < counted; ++i, from += step) {
        some_.x[i] = local->x[from];
        some_.y[i] = local->y[from];
        some_.z[i] = local->z[from];
        some_.distance[i] = local->distance[from];
        if (is_arc) some_along_mm_[i] = along[from];
      }
      local = &some_;
      along = some_along_mm_.data();
    }
    if (is_arc) {
      FindCellsOfArc(loop, *local, along, counted, at_[c].data());
    } else {
      FindCellsOfLine(loop, *local, counted, at_[c].data());
    }
  }
  // Most blocks lie beside one segment alone.
  std::uint32_t* cells = cells_.count.data();
  if (candidates.size() == 1) {
    const std::int32_t* at = at_.front().data();
    for (std::size_t i = 0; i < counted; ++i) ++cells[at[i]];
  } else {
    for (std::size_t i = 0, from = first; i < counted; ++i, from += step) {
      ++cells[at_[nearest.Candidate(from)][i]];
    }
  }
}

void WallCellCounter::Add(const PointBlock& block, std::size_t index) {
  CandidateSegments(block, frames_, kNearSegment * r_mm_, candidates_);
  if (candidates_.empty()) return;
  along_mm_.resize(std::max(along_mm_.size(), candidates_.size()));
  std::span<const Eigen::Vector3d> points = block.points;
  if (stride_ > 1) {
    taken_.clear();
    for (std::size_t i = FirstCounted(index); i < points.size(); i += stride_) {
      taken_.push_back(points[i]);
    }
    points = taken_;
  }
  for (std::size_t first = 0; first < points.size(); first += kBatch) {
    const std::size_t count = std::min(kBatch, points.size() - first);
    nearest_.Find(points.subspan(first, count), frames_, r_mm_, candidates_);
    for (std::size_t c = 0; c < candidates_.size(); ++c) {
      const SegmentFrame& frame = frames_[static_cast<std::size_t>(candidates_[c])];
      if (frame.bend_radius_mm > 0) AlongArc(frame, nearest_.Local(c), count, along_mm_[c]);
    }
    Count(nearest_, candidates_, along_mm_, count, 0, 1);
  }
}

WallCells WallCellCounter::TakeCells() {
  cells_.count.resize(cells_.count.size() - static_cast<std::size_t>(cells_.columns));
  return std::move(cells_);
}

}  // namespace bendloop::pipeline
