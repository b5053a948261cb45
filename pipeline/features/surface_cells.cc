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
#include "pipeline/math/circle_sectors.h"
#include "pipeline/math/simd.h"

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
  // For each pipe radius of the tube's length so many points tell of any hole: one of a tenth of a
  // pipe radius lacks twelve of them.
  double enough_points = 10'000.0;
  // Of the walk: least points of a round, and most rounds, each with cells of its own. By trial.
  std::size_t points_of_round = 8192, most_rounds = 4;
};
constexpr CellSettings kCells;

// Points by place: rows along the tube, columns around it.
struct Grid {
  int rows = 0, columns = 0;
  double row_mm = 0;
  std::vector<std::uint32_t> count;

  // `column`: anywhere in turns that go on.
  std::size_t At(int row, int column) const {
    if (column < 0 || column >= columns) column = (column % columns + columns) % columns;
    return static_cast<std::size_t>(row) * static_cast<std::size_t>(columns) +
           static_cast<std::size_t>(column);
  }
  // Four cells in one.
  Grid Coarser() const {
    Grid coarse{rows / 2, columns / 2, 2.0 * row_mm, {}};
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
};

// The cells of a batch's points, as if all were nearest to one segment. [mm], where nothing is
// said.
struct CellLoop {
  double r_mm = 0;
  double from_start_mm = 0;   // of the segment
  double bend_radius_mm = 0;  // 0: a line
  double turned = 0;          // of a turn: its normal, in the turn that goes on
  double rows_per_mm = 0, rows = 0, columns = 0;
};

// What is in none is in the row behind the last. Without a branch, so that several points are taken
// at once.
BENDLOOP_LOOP void FindCellsBody(const CellLoop& of, const LocalLanes& local,
                                 const double* along_mm, std::size_t count, std::int32_t* cell) {
  constexpr double kPerTurn = 0.5 / std::numbers::pi;
  // Of its own, so that nobody thinks that `cell` changes them.
  const auto [r_mm, from_start_mm, bend_mm, turned, rows_per_mm, rows, columns] = of;
  const double inside_mm = -kCells.inside * r_mm, outside_mm = kCells.outside * r_mm;
  const auto whole_columns = static_cast<std::int32_t>(columns);
  const std::int32_t last = whole_columns - 1;
  const double none = of.rows;  // the row behind the last takes what is in no cell
  const double of_arc = bend_mm > 0 ? 1.0 : 0.0, of_line = 1.0 - of_arc;
  for (std::size_t i = 0; i < count; ++i) {
    const double off_mm = local.distance[i] - r_mm;
    const double row = (from_start_mm + along_mm[i]) * rows_per_mm;
    // Right-handed about the feed from the segment's normal; an arc's y counts from its centre.
    const double from_center_mm =
        std::sqrt(local.x[i] * local.x[i] + local.y[i] * local.y[i]) - bend_mm;
    const double outward = of_arc * from_center_mm - of_line * local.y[i];
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
BENDLOOP_MULTIVERSION(void, FindCells,
                      (const CellLoop& of, const LocalLanes& local, const double* along_mm,
                       std::size_t count, std::int32_t* cell),
                      (of, local, along_mm, count, cell))

using BatchNumbers = std::array<double, kBatch>;  // of the points of a batch
using BatchCells = std::array<std::int32_t, kBatch>;

// Counts the points of blocks.
class Counter {
 public:
  // Every `stride`-th point.
  Counter(const hal::Tube& tube, Grid grid, std::size_t stride)
      : stride_(stride),
        r_mm_(tube.pipe_radius_mm),
        frames_(SegmentFrames(hal::SpineSegments(tube.program, tube.X_WT), r_mm_)),
        grid_(std::move(grid)) {
    grid_.count.resize(grid_.count.size() + static_cast<std::size_t>(grid_.columns));
    const auto segments = hal::SpineSegments(tube.program, tube.X_WT);
    // Each segment's own normal, in the turn that goes on over all of them.
    double turn_deg = 0;
    for (std::size_t k = 0; k < segments.size(); ++k) {
      if (k > 0) {
        turn_deg += hal::AroundDeg(segments[k - 1].normal, segments[k].tangent, segments[k].normal);
      }
      loops_.push_back({r_mm_, segments[k].from_start_mm, frames_[k].bend_radius_mm,
                        turn_deg / 360.0 - std::floor(turn_deg / 360.0), 1.0 / grid_.row_mm,
                        static_cast<double>(grid_.rows), static_cast<double>(grid_.columns)});
    }
  }

  void Add(const PointBlock& block) {
    CandidateSegments(block, frames_, 2.0 * r_mm_, candidates_);
    if (candidates_.empty()) return;
    cells_.resize(std::max(cells_.size(), candidates_.size()));
    std::span<const Eigen::Vector3d> points = block.points;
    if (stride_ > 1) {
      taken_.clear();
      for (; next_ < points.size(); next_ += stride_) taken_.push_back(points[next_]);
      next_ -= points.size();
      points = taken_;
    }
    for (std::size_t first = 0; first < points.size(); first += kBatch) {
      const std::size_t count = std::min(kBatch, points.size() - first);
      nearest_.Find(points.subspan(first, count), frames_, r_mm_, candidates_);
      for (std::size_t c = 0; c < candidates_.size(); ++c) {
        const auto k = static_cast<std::size_t>(candidates_[c]);
        const LocalLanes& local = nearest_.Local(c);
        const bool is_arc = frames_[k].bend_radius_mm > 0;
        if (is_arc) AlongArc(frames_[k], local, count, along_mm_);
        FindCells(loops_[k], local, is_arc ? along_mm_.data() : local.x.data(), count,
                  cells_[c].data());
      }
      // Most blocks lie beside one segment alone.
      std::uint32_t* cells = grid_.count.data();
      if (candidates_.size() == 1) {
        for (std::size_t i = 0; i < count; ++i) ++cells[cells_.front()[i]];
      } else {
        for (std::size_t i = 0; i < count; ++i) ++cells[cells_[nearest_.Candidate(i)][i]];
      }
    }
  }
  Grid TakeGrid() {
    grid_.count.resize(grid_.count.size() - static_cast<std::size_t>(grid_.columns));
    return std::move(grid_);
  }

 private:
  std::size_t stride_, next_ = 0;  // in the next block
  double r_mm_;
  std::vector<SegmentFrame> frames_;
  Grid grid_;
  std::vector<CellLoop> loops_;
  std::vector<std::int32_t> candidates_;
  NearestLanes nearest_;
  std::vector<Eigen::Vector3d> taken_;
  BatchNumbers along_mm_{};
  std::vector<BatchCells> cells_;
};

// Cells that touch each other and are empty.
struct Void {
  double row = 0, column = 0;  // of its middle
  double rows = 0, columns = 0;
};

class VoidSearch {
 public:
  explicit VoidSearch(const Grid& grid)
      : grid_(grid),
        is_empty_(grid.count.size()),
        columns_(static_cast<std::size_t>(grid.columns)) {
    // A cell between two that are not is no void: laser lines leave single cells out. Each row with
    // the column before its first and that after its last.
    std::vector<unsigned char> before(columns_ + 2), here(columns_ + 2), after(columns_ + 2);
    const auto read = [&](int row, std::vector<unsigned char>& has) {
      if (row >= grid_.rows) {
        std::fill(has.begin(), has.end(), 0);
        return;
      }
      const std::uint32_t* count = &grid_.count[grid_.At(row, 0)];
      for (std::size_t k = 0; k < columns_; ++k) has[k + 1] = count[k] > 0;
      has.front() = has[columns_];
      has.back() = has[1];
    };
    read(0, after);
    for (int row = 0; row < grid_.rows; ++row) {
      before.swap(here);
      here.swap(after);
      read(row + 1, after);
      unsigned char* empty = &is_empty_[grid_.At(row, 0)];
      for (std::size_t k = 0; k < columns_; ++k) {
        const int has = here[k + 1] | (before[k + 1] & after[k + 1]) | (here[k] & here[k + 2]);
        empty[k] = static_cast<unsigned char>(has ^ 1);
      }
    }
  }

  std::vector<Void> Find() {
    std::vector<Void> voids;
    for (int row = 1; row + 1 < grid_.rows; ++row) {
      const auto first = is_empty_.begin() + static_cast<std::ptrdiff_t>(grid_.At(row, 0));
      const auto end = first + grid_.columns;
      for (auto at = std::find(first, end, kEmpty); at != end; at = std::find(at, end, kEmpty)) {
        if (const auto found = TakeFrom(row, static_cast<int>(at - first))) voids.push_back(*found);
      }
    }
    return voids;
  }

 private:
  static constexpr unsigned char kFull = 0, kEmpty = 1, kTaken = 2;  // empty, and part of a void
  // Cells of a row one beside the other; columns may be beyond the turn.
  struct Run {
    int row, first, last;
  };

  bool Take(int row, int column) {
    unsigned char& cell = is_empty_[grid_.At(row, column)];
    if (cell != kEmpty) return false;
    cell = kTaken;
    return true;
  }
  // Takes the run of a cell that is one of it and taken.
  void TakeRun(int row, int column) {
    Run run{row, column, column};
    while (Take(row, run.first - 1)) --run.first;
    while (Take(row, run.last + 1)) ++run.last;
    runs_.push_back(run);
  }

  // Takes out all that are joined to this one, and says whether they are a place worth a look.
  std::optional<Void> TakeFrom(int row, int column) {
    runs_.clear();
    Take(row, column);
    TakeRun(row, column);
    Run all = runs_.front();
    int last_row = row, cells = 0;
    for (std::size_t i = 0; i < runs_.size(); ++i) {
      const Run run = runs_[i];
      all = {std::min(all.row, run.row), std::min(all.first, run.first),
             std::max(all.last, run.last)};
      last_row = std::max(last_row, run.row);
      cells += run.last - run.first + 1;
      for (const int beside : {run.row - 1, run.row + 1}) {
        if (beside < 0 || beside >= grid_.rows) continue;
        for (int k = run.first; k <= run.last; ++k) {
          if (!Take(beside, k)) continue;
          TakeRun(beside, k);
          k = runs_.back().last;
        }
      }
    }
    const int rows = last_row - all.row + 1, columns = all.last - all.first + 1;
    // At an end, all around, or nowhere as wide as two cells: nobody looked there.
    if (all.row == 0 || last_row + 1 == grid_.rows || 2 * columns > grid_.columns) return {};
    if (rows < 2 || columns < 2 || cells < 4 || !IsAmongOthers(cells)) return {};
    return Void{0.5 * (all.row + last_row + 1), 0.5 * (all.first + all.last + 1),
                static_cast<double>(rows), static_cast<double>(columns)};
  }

  // Whether the cells around are none of a void, and have so many points that here they are
  // missing.
  bool IsAmongOthers(int cells) const {
    std::vector<std::size_t> own, around;
    for (const Run& run : runs_) {
      for (int k = run.first; k <= run.last; ++k) own.push_back(grid_.At(run.row, k));
    }
    std::sort(own.begin(), own.end());
    for (const Run& run : runs_) {
      for (int row = run.row - 1; row <= run.row + 1; ++row) {
        for (int column = run.first - 1; column <= run.last + 1; ++column) {
          const std::size_t cell = grid_.At(row, column);
          if (!std::binary_search(own.begin(), own.end(), cell)) around.push_back(cell);
        }
      }
    }
    std::sort(around.begin(), around.end());
    around.erase(std::unique(around.begin(), around.end()), around.end());
    double with_points = 0, points = 0;
    for (const std::size_t cell : around) {
      with_points += is_empty_[cell] == kFull ? 1 : 0;
      points += grid_.count[cell];
    }
    const auto n = static_cast<double>(around.size());
    return with_points >= kCells.least_around_it * n &&
           static_cast<double>(cells) * points / n >= kCells.least_missing;
  }

  const Grid& grid_;
  std::vector<unsigned char> is_empty_;
  std::size_t columns_;
  std::vector<Run> runs_;
};

Grid Count(const hal::Tube& tube, std::span<const PointBlock> blocks, std::size_t stride,
           const Grid& empty, Workers* workers) {
  // Numbers of points add up to the same however the blocks are parted.
  const std::vector<BlockRange> rounds =
      EvenRounds(blocks, kCells.points_of_round, workers ? kCells.most_rounds : 1);
  std::vector<Grid> parts(rounds.size());
  ParallelFor(workers, rounds.size(), [&](std::size_t round) {
    Counter counter(tube, empty, stride);
    for (std::size_t i = rounds[round].begin; i < rounds[round].end; ++i) counter.Add(blocks[i]);
    parts[round] = counter.TakeGrid();
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
  const std::size_t all = CountPoints(blocks);
  const double enough = kCells.enough_points * std::max(1.0, length_mm / r_mm);
  const std::size_t stride = StrideTo(all, static_cast<std::size_t>(enough));
  const double points = static_cast<double>(all) / static_cast<double>(stride);
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
  grid = Count(tube, blocks, stride, grid, workers);

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
      place.narrow_mm = std::min(found.rows * grid.row_mm, found.columns * column_mm);
      places.push_back(place);
    }
    grid = grid.Coarser();
  }
  // Where many gaps between lines look empty, the widest places are worth the looks.
  std::stable_sort(places.begin(), places.end(), [](const EmptyPlace& a, const EmptyPlace& b) {
    return a.narrow_mm > b.narrow_mm;
  });
  places.resize(std::min(places.size(), kCells.most_places));
  return places;
}

}  // namespace bendloop::pipeline
