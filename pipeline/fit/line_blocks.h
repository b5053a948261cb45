// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "pipeline/fit/surface_points.h"
#include "pipeline/points/kept_lines.h"
#include "pipeline/points/sample_grid.h"

namespace bendloop::pipeline {

// Points of a scan's lines in the blocks of its grid, which thins them until they are lines no
// longer.
class LineBlocks {
 public:
  // Those in the grid's blocks with these indices, block by block in their order.
  LineBlocks(const DirectedPoints& points, const SampleGrid& grid,
             std::span<const std::int32_t> indices);
  LineBlocks(LineBlocks&&) = default;
  LineBlocks& operator=(LineBlocks&&) = default;

  std::vector<PointBlock> blocks;  // look at what this holds

 private:
  DirectedPoints points_;
};

}  // namespace bendloop::pipeline
