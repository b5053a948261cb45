// SPDX-License-Identifier: Apache-2.0
// Empty places of an unrolled surface, cell by cell.
#include "pipeline/features/surface_cells.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <optional>
#include <vector>

#include "hal/tube.h"

namespace bendloop::pipeline {
namespace {

constexpr double kCellMm = 1.0;

hal::Tube StraightTube() { return {10, {{{300, 0, 0, std::nullopt}}}, {}}; }

// A wall whose every cell has five points.
WallCells FullWall() {
  WallCells cells;
  cells.rows = 304, cells.columns = 64;
  cells.row_mm = kCellMm;
  cells.count.assign(static_cast<std::size_t>(cells.rows) * 64U, 5);
  return cells;
}
void Empty(WallCells& cells, int row, int column, int rows, int columns) {
  for (int i = row; i < row + rows; ++i) {
    for (int k = column; k < column + columns; ++k) cells.count[cells.At(i, k)] = 0;
  }
}
int CountAt(const std::vector<EmptyPlace>& places, double along_mm) {
  return static_cast<int>(std::count_if(places.begin(), places.end(), [&](const EmptyPlace& place) {
    return place.along_mm > along_mm - 1.5 && place.along_mm < along_mm + 1.5;
  }));
}

TEST(EmptyPlaces, ANarrowOneIsFoundBesideManyWideOnes) {
  WallCells cells = FullWall();
  for (int i = 0; i < 13; ++i) Empty(cells, 20 + 20 * i, 30, 5, 5);
  Empty(cells, 292, 10, 1, 9);
  const auto places = FindEmptyPlaces(StraightTube(), cells);
  EXPECT_EQ(CountAt(places, 292.5), 1);
  for (int i = 0; i < 13; ++i) EXPECT_GE(CountAt(places, 22.5 + 20 * i), 1);
}

TEST(EmptyPlaces, OnesThatAreWideAreNoneOfTheNarrow) {
  WallCells cells = FullWall();
  Empty(cells, 100, 30, 3, 3);
  EXPECT_EQ(CountAt(FindEmptyPlaces(StraightTube(), cells), 101.5), 1);
}

// As lines leave them that stand a little further from each other than cells are wide.
TEST(EmptyPlaces, ManyNarrowOnesAreGapsBetweenLines) {
  WallCells cells = FullWall();
  for (int i = 0; i < 13; ++i) Empty(cells, 20 + 20 * i, 30, 1, 9);
  EXPECT_TRUE(FindEmptyPlaces(StraightTube(), cells).empty());
}

}  // namespace
}  // namespace bendloop::pipeline
