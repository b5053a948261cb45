// SPDX-License-Identifier: Apache-2.0
#include "pipeline/features/surface_cells.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <optional>

#include "hal/angles.h"
#include "hal/tube_features.h"

namespace bendloop::pipeline {
namespace {

struct CellSettings {
  // Points that an empty place would have if it were like the cells around it.
  double least_missing = 12.0;
  // The same of a place that is no wide one, where cells between two others count as empty, too;
  // where there are more of these, lines leave them.
  double least_missing_narrow = 18.0;
  std::size_t most_narrow = 12;
  // Of the cells around it: so many have points.
  double least_around_it = 0.85;
  std::size_t most_places = 40;
};
constexpr CellSettings kCells;

// Cells that touch each other and are empty.
struct Void {
  double row = 0, column = 0;  // of its middle
  double rows = 0, columns = 0;
};

// Whether cells of a row have points: 1, or 0. No byte is one of what they are read from, which the
// compiler would not believe.
void HaveAny(const std::uint32_t* count, std::size_t columns, unsigned char* has) {
#pragma omp simd
  for (std::size_t k = 0; k < columns; ++k) has[k] = count[k] > 0 ? 1 : 0;
}
// Rows with the column before their first and that after their last.
void AreEmpty(const unsigned char* before, const unsigned char* here, const unsigned char* after,
              std::size_t columns, unsigned char* empty) {
#pragma omp simd
  for (std::size_t k = 0; k < columns; ++k) {
    const int has = here[k + 1] | (before[k + 1] & after[k + 1]) | (here[k] & here[k + 2]);
    empty[k] = static_cast<unsigned char>(has ^ 1);
  }
}

class VoidSearch {
 public:
  enum class Width { kWide, kAny };

  VoidSearch(const WallCells& grid, Width width)
      : grid_(grid),
        is_empty_(grid.count.size()),
        columns_(static_cast<std::size_t>(grid.columns)),
        least_cells_(width == Width::kWide ? 2 : 1),
        least_missing_(width == Width::kWide ? kCells.least_missing : kCells.least_missing_narrow) {
    if (width == Width::kAny) {
      std::transform(grid.count.begin(), grid.count.end(), is_empty_.begin(),
                     [](std::uint32_t count) { return count > 0 ? kFull : kEmpty; });
      return;
    }
    // A cell between two that are not is no void: laser lines leave single cells out. Each row with
    // the column before its first and that after its last.
    std::vector<unsigned char> before(columns_ + 2), here(columns_ + 2), after(columns_ + 2);
    const auto read = [&](int row, std::vector<unsigned char>& has) {
      if (row >= grid_.rows) {
        std::fill(has.begin(), has.end(), 0);
        return;
      }
      HaveAny(&grid_.count[grid_.At(row, 0)], columns_, has.data() + 1);
      has.front() = has[columns_];
      has.back() = has[1];
    };
    read(0, after);
    for (int row = 0; row < grid_.rows; ++row) {
      before.swap(here);
      here.swap(after);
      read(row + 1, after);
      AreEmpty(before.data(), here.data(), after.data(), columns_, &is_empty_[grid_.At(row, 0)]);
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
  // The first empty cell of a row from this column to that; else one behind that.
  int NextEmpty(int row, int column, int last) const {
    while (column <= last) {
      const int turns = column < 0 ? -1 : column / grid_.columns;
      const int zero = turns * grid_.columns;  // of this turn
      const int end = std::min(last + 1, zero + grid_.columns);
      const auto cells = is_empty_.begin() + static_cast<std::ptrdiff_t>(grid_.At(row, 0));
      const auto at = std::find(cells + (column - zero), cells + (end - zero), kEmpty);
      column = zero + static_cast<int>(at - cells);
      if (column < end) return column;
    }
    return last + 1;
  }
  // Takes the run of a cell that is one of it and taken.
  void TakeRun(int row, int column) {
    Run run{row, column, column};
    if (column >= 0 && column < grid_.columns) {  // most of it without going round the turn
      unsigned char* cell = &is_empty_[grid_.At(row, 0)];
      while (run.first > 0 && cell[run.first - 1] == kEmpty) cell[--run.first] = kTaken;
      while (run.last + 1 < grid_.columns && cell[run.last + 1] == kEmpty) {
        cell[++run.last] = kTaken;
      }
    }
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
        for (int k = NextEmpty(beside, run.first, run.last); k <= run.last;
             k = NextEmpty(beside, k + 1, run.last)) {
          Take(beside, k);
          TakeRun(beside, k);
          k = runs_.back().last;
        }
      }
    }
    const int rows = last_row - all.row + 1, columns = all.last - all.first + 1;
    // At an end or all around: nobody looked there.
    if (all.row == 0 || last_row + 1 == grid_.rows || 2 * columns > grid_.columns) return {};
    if (rows < least_cells_ || columns < least_cells_ || cells < 4) return {};
    if (!IsAmongOthers(cells)) return {};
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
           static_cast<double>(cells) * points / n >= least_missing_;
  }

  const WallCells& grid_;
  std::vector<unsigned char> is_empty_;
  std::size_t columns_;
  int least_cells_;  // each way
  double least_missing_;
  std::vector<Run> runs_;
};

// Whether two are the same one, but for the cells at its border.
bool AreSame(const Void& a, const Void& b) {
  return std::abs(a.row - b.row) <= 1.0 && std::abs(a.column - b.column) <= 1.0 &&
         std::abs(a.rows - b.rows) <= 2.0 && std::abs(a.columns - b.columns) <= 2.0;
}

// The wide ones of the finest cells, and those that only single cells join, unless they are many.
std::vector<Void> FindVoids(const WallCells& cells) {
  std::vector<Void> voids = VoidSearch(cells, VoidSearch::Width::kWide).Find();
  std::vector<Void> narrow;
  for (const Void& any : VoidSearch(cells, VoidSearch::Width::kAny).Find()) {
    const auto same = std::find_if(voids.begin(), voids.end(),
                                   [&](const Void& wide) { return AreSame(any, wide); });
    if (same == voids.end()) {
      narrow.push_back(any);
    } else {
      *same = any;  // with its single cells
    }
  }
  if (narrow.size() <= kCells.most_narrow) voids.insert(voids.end(), narrow.begin(), narrow.end());
  return voids;
}

}  // namespace

std::vector<EmptyPlace> FindEmptyPlaces(const hal::Tube& tube, WallCells cells) {
  std::vector<EmptyPlace> places;
  if (cells.count.empty()) return places;
  const double turn_mm = 2.0 * std::numbers::pi * tube.pipe_radius_mm;
  const auto segments = hal::SpineSegments(tube.program, tube.X_WT);
  for (int level = 0; level < kWallGrids && cells.columns >= kLeastColumns; ++level) {
    const double column_mm = turn_mm / cells.columns;
    const std::vector<Void> voids =
        level == 0 ? FindVoids(cells) : VoidSearch(cells, VoidSearch::Width::kWide).Find();
    for (const Void& found : voids) {
      EmptyPlace place;
      place.along_mm = found.row * cells.row_mm;
      place.size_mm = std::hypot((found.rows + 1) * cells.row_mm, (found.columns + 1) * column_mm);
      // From the turn that goes on to that of the place.
      const std::size_t at = hal::SegmentAt(segments, place.along_mm);
      double turn_deg = 360.0 * found.column / cells.columns;
      for (std::size_t k = 1; k <= at; ++k) {
        turn_deg -= hal::AroundDeg(segments[k - 1].normal, segments[k].tangent, segments[k].normal);
      }
      // Places count from the bend before, a line's normal is that of the next.
      turn_deg +=
          hal::AroundDeg(hal::AroundZero(segments, at), segments[at].tangent, segments[at].normal);
      place.around_deg = hal::WrapRotationDeg(turn_deg);
      place.narrow_mm = std::min(found.rows * cells.row_mm, found.columns * column_mm);
      places.push_back(place);
    }
    cells = cells.Coarser();
  }
  // Where many gaps between lines look empty, the widest places are worth the looks.
  std::stable_sort(places.begin(), places.end(), [](const EmptyPlace& a, const EmptyPlace& b) {
    return a.narrow_mm > b.narrow_mm;
  });
  places.resize(std::min(places.size(), kCells.most_places));
  return places;
}

}  // namespace bendloop::pipeline
