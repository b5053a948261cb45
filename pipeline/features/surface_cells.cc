// SPDX-License-Identifier: Apache-2.0
#include "pipeline/features/surface_cells.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <optional>

#include "hal/angles.h"
#include "hal/tube_features.h"
#include "pipeline/fit/nearest_lanes.h"

namespace bendloop::pipeline {
namespace {

struct CellSettings {
  // Points of a cell of the finest grid, on average; each coarser one has four times as many.
  double in_cell = 3.0;
  int grids = 4;
  int least_around = 12, most_around = 512;  // cells of a turn
  std::size_t most_cells = 4'000'000;
  // [of r_P] From the surface: whatever is there hides the wall, or is the wall.
  double inside = 0.3, outside = 1.0;
  // Points that an empty place would have if it were like the cells around it.
  double least_missing = 12.0;
  // Of the cells around it: so many have points.
  double least_around_it = 0.85;
  std::size_t most_places = 40;
  // Of the walk: least points of a round, and most rounds, each with cells of its own. By trial.
  std::size_t points_of_round = 8192, most_rounds = 4;
};
constexpr CellSettings kCells;

// Points by place: rows along the tube, columns around it.
struct Grid {
  int rows = 0, columns = 0;
  double row_mm = 0;
  std::vector<std::uint32_t> count;

  std::size_t At(int row, int column) const {
    return static_cast<std::size_t>(row) * static_cast<std::size_t>(columns) +
           static_cast<std::size_t>((column % columns + columns) % columns);
  }
  // Four cells in one.
  Grid Coarser() const {
    Grid coarse{rows / 2, columns / 2, 2.0 * row_mm, {}};
    coarse.count.assign(
        static_cast<std::size_t>(coarse.rows) * static_cast<std::size_t>(coarse.columns), 0);
    for (int row = 0; row < 2 * coarse.rows; ++row) {
      for (int column = 0; column < columns; ++column) {
        coarse.count[coarse.At(row / 2, column / 2)] += count[At(row, column)];
      }
    }
    return coarse;
  }
};

// Counts the points of blocks.
class Counter {
 public:
  Counter(const hal::Tube& tube, Grid grid)
      : segments_(hal::SpineSegments(tube.program, tube.X_WT)),
        frames_(SegmentFrames(segments_, tube.pipe_radius_mm)),
        r_mm_(tube.pipe_radius_mm),
        grid_(std::move(grid)) {
    // Each segment's own normal, in the turn that goes on over all of them.
    for (std::size_t k = 0; k < segments_.size(); ++k) {
      double turn = 0;
      if (k > 0) {
        turn = turn_.back() + hal::kRadiansPerDegree * hal::AroundDeg(segments_[k - 1].normal,
                                                                      segments_[k].tangent,
                                                                      segments_[k].normal);
      }
      turn_.push_back(turn);
    }
  }

  void Add(const PointBlock& block) {
    CandidateSegments(block, frames_, 2.0 * r_mm_, candidates_);
    if (candidates_.empty()) return;
    along_mm_.resize(std::max(along_mm_.size(), candidates_.size()));
    for (std::size_t first = 0; first < block.points.size(); first += kBatch) {
      const std::size_t count = std::min(kBatch, block.points.size() - first);
      nearest_.Find(block.points.subspan(first, count), frames_, r_mm_, candidates_);
      for (std::size_t c = 0; c < candidates_.size(); ++c) {
        const SegmentFrame& frame = frames_[static_cast<std::size_t>(candidates_[c])];
        if (frame.bend_radius_mm > 0) AlongArc(frame, nearest_.Local(c), count, along_mm_[c]);
      }
      for (std::size_t i = 0; i < count; ++i) Add(i);
    }
  }
  const Grid& grid() const { return grid_; }

 private:
  void Add(std::size_t i) {
    const std::size_t c = nearest_.Candidate(i);
    const auto k = static_cast<std::size_t>(candidates_[c]);
    const LocalLanes& local = nearest_.Local(c);
    const double off_mm = local.distance[i] - r_mm_;
    if (!(off_mm > -kCells.inside * r_mm_ && off_mm < kCells.outside * r_mm_)) return;
    const bool is_arc = frames_[k].bend_radius_mm > 0;
    const double along_mm = segments_[k].from_start_mm + (is_arc ? along_mm_[c][i] : local.x[i]);
    const double row = along_mm / grid_.row_mm;
    if (!(row >= 0 && row < grid_.rows)) return;
    // Right-handed about the feed from the segment's normal; an arc's y counts from its centre.
    const double outward =
        is_arc ? std::hypot(local.x[i], local.y[i]) - frames_[k].bend_radius_mm : -local.y[i];
    const double turn = (std::atan2(outward, local.z[i]) + turn_[k]) * kPerTurn;
    const int column = static_cast<int>((turn - std::floor(turn)) * grid_.columns);
    ++grid_.count[grid_.At(static_cast<int>(row), column)];
  }

  static constexpr double kPerTurn = 0.5 / std::numbers::pi;
  std::vector<hal::SpineSegment> segments_;
  std::vector<SegmentFrame> frames_;
  std::vector<double> turn_;
  double r_mm_;
  Grid grid_;
  std::vector<std::int32_t> candidates_;
  NearestLanes nearest_;
  std::vector<std::array<double, kBatch>> along_mm_;
};

// Cells that touch each other and are empty.
struct Void {
  double row = 0, column = 0;  // of its middle
  double rows = 0, columns = 0;
};

class VoidSearch {
 public:
  explicit VoidSearch(const Grid& grid) : grid_(grid), is_empty_(grid.count.size()) {
    // A cell between two that are not is no void: laser lines leave single cells out.
    const auto has = [&](int row, int column) {
      return row >= 0 && row < grid_.rows && grid_.count[grid_.At(row, column)] > 0;
    };
    for (int row = 0; row < grid_.rows; ++row) {
      for (int column = 0; column < grid_.columns; ++column) {
        is_empty_[grid_.At(row, column)] = !has(row, column) &&
                                           !(has(row - 1, column) && has(row + 1, column)) &&
                                           !(has(row, column - 1) && has(row, column + 1));
      }
    }
  }

  std::vector<Void> Find() {
    std::vector<Void> voids;
    for (int row = 1; row + 1 < grid_.rows; ++row) {
      for (int column = 0; column < grid_.columns; ++column) {
        if (!is_empty_[grid_.At(row, column)]) continue;
        if (const auto found = TakeFrom(row, column)) voids.push_back(*found);
      }
    }
    return voids;
  }

 private:
  struct Place {
    int row, column;  // the column may be beyond the turn
  };

  // Takes out all that are joined to this one, and says whether they are a place worth a look.
  std::optional<Void> TakeFrom(int row, int column) {
    cells_.assign(1, {row, column});
    is_empty_[grid_.At(row, column)] = false;
    Place low{row, column}, high = low;
    for (std::size_t i = 0; i < cells_.size(); ++i) {
      const Place at = cells_[i];
      low = {std::min(low.row, at.row), std::min(low.column, at.column)};
      high = {std::max(high.row, at.row), std::max(high.column, at.column)};
      for (const Place& to : {Place{at.row - 1, at.column}, Place{at.row + 1, at.column},
                              Place{at.row, at.column - 1}, Place{at.row, at.column + 1}}) {
        if (to.row < 0 || to.row >= grid_.rows || !is_empty_[grid_.At(to.row, to.column)]) continue;
        is_empty_[grid_.At(to.row, to.column)] = false;
        cells_.push_back(to);
      }
    }
    const int rows = high.row - low.row + 1, columns = high.column - low.column + 1;
    // At an end, all around, or nowhere as wide as two cells: nobody looked there.
    if (low.row == 0 || high.row + 1 == grid_.rows || 2 * columns > grid_.columns) return {};
    if (rows < 2 || columns < 2 || cells_.size() < 4 || !IsAmongOthers()) return {};
    return Void{0.5 * (low.row + high.row + 1), 0.5 * (low.column + high.column + 1),
                static_cast<double>(rows), static_cast<double>(columns)};
  }

  // Whether the cells around have points, and so many that here they are missing.
  bool IsAmongOthers() const {
    std::vector<std::size_t> own, around;
    for (const Place& at : cells_) own.push_back(grid_.At(at.row, at.column));
    std::sort(own.begin(), own.end());
    for (const Place& at : cells_) {
      for (int row = at.row - 1; row <= at.row + 1; ++row) {
        for (int column = at.column - 1; column <= at.column + 1; ++column) {
          const std::size_t cell = grid_.At(row, column);
          if (!std::binary_search(own.begin(), own.end(), cell)) around.push_back(cell);
        }
      }
    }
    std::sort(around.begin(), around.end());
    around.erase(std::unique(around.begin(), around.end()), around.end());
    double with_points = 0, points = 0;
    for (const std::size_t cell : around) {
      with_points += grid_.count[cell] > 0 ? 1 : 0;
      points += grid_.count[cell];
    }
    const auto n = static_cast<double>(around.size());
    return with_points >= kCells.least_around_it * n &&
           static_cast<double>(cells_.size()) * points / n >= kCells.least_missing;
  }

  const Grid& grid_;
  std::vector<bool> is_empty_;
  std::vector<Place> cells_;
};

Grid Count(const hal::Tube& tube, std::span<const PointBlock> blocks, const Grid& empty,
           Workers* workers) {
  const std::vector<BlockRange> rounds =
      EvenRounds(blocks, kCells.points_of_round, kCells.most_rounds);
  std::vector<Grid> parts(rounds.size());
  ParallelFor(workers, rounds.size(), [&](std::size_t round) {
    Counter counter(tube, empty);
    for (std::size_t i = rounds[round].begin; i < rounds[round].end; ++i) counter.Add(blocks[i]);
    parts[round] = counter.grid();
  });
  for (std::size_t round = 1; round < parts.size(); ++round) {
    for (std::size_t cell = 0; cell < empty.count.size(); ++cell) {
      parts.front().count[cell] += parts[round].count[cell];
    }
  }
  return std::move(parts.front());
}

}  // namespace

std::vector<EmptyPlace> FindEmptyPlaces(const hal::Tube& tube, std::span<const PointBlock> blocks,
                                        Workers* workers) {
  std::vector<EmptyPlace> places;
  const double length_mm = hal::SpineLength(tube.program), r_mm = tube.pipe_radius_mm;
  const double turn_mm = 2.0 * std::numbers::pi * r_mm;
  const auto points = static_cast<double>(CountPoints(blocks));
  if (!(length_mm > 0) || points < 100) return places;
  // Both numbers can be halved for the coarser grids.
  const int whole = 1 << (kCells.grids - 1);
  const auto round_up = [&](double number) {
    return whole * std::max(1, static_cast<int>(std::lround(number / whole)));
  };
  const double cell_mm = std::max(
      {std::sqrt(kCells.in_cell * turn_mm * length_mm / points), turn_mm / kCells.most_around,
       std::sqrt(turn_mm * length_mm / static_cast<double>(kCells.most_cells))});
  Grid grid;
  grid.columns = round_up(turn_mm / cell_mm);
  grid.rows = round_up(length_mm / cell_mm);
  grid.row_mm = length_mm / grid.rows;
  if (grid.columns < kCells.least_around) return places;
  grid.count.assign(static_cast<std::size_t>(grid.rows) * static_cast<std::size_t>(grid.columns),
                    0);
  grid = Count(tube, blocks, grid, workers);

  const auto segments = hal::SpineSegments(tube.program, tube.X_WT);
  for (int level = 0; level < kCells.grids && grid.columns >= kCells.least_around; ++level) {
    const double column_mm = turn_mm / grid.columns;
    for (const Void& found : VoidSearch(grid).Find()) {
      EmptyPlace place;
      place.along_mm = found.row * grid.row_mm;
      place.size_mm = std::hypot((found.rows + 1) * grid.row_mm, (found.columns + 1) * column_mm);
      // From the turn that goes on to that of the place.
      const std::size_t at = hal::SegmentAt(segments, place.along_mm);
      double turn_deg = 360.0 * found.column / grid.columns;
      for (std::size_t k = 1; k <= at; ++k) {
        turn_deg -= hal::AroundDeg(segments[k - 1].normal, segments[k].tangent, segments[k].normal);
      }
      // Places count from the bend before, a line's normal is that of the next.
      turn_deg +=
          hal::AroundDeg(hal::AroundZero(segments, at), segments[at].tangent, segments[at].normal);
      place.around_deg = hal::WrapRotationDeg(turn_deg);
      if (places.size() < kCells.most_places) places.push_back(place);
    }
    grid = grid.Coarser();
  }
  return places;
}

}  // namespace bendloop::pipeline
