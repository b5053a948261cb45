// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/line_blocks.h"

#include <cmath>
#include <cstddef>

namespace bendloop::pipeline {

LineBlocks::LineBlocks(const DirectedPoints& points, const SampleGrid& grid,
                       std::span<const std::int32_t> indices) {
  std::vector<std::size_t> number(grid.blocks().size(), indices.size());
  for (std::size_t k = 0; k < indices.size(); ++k) {
    number[static_cast<std::size_t>(indices[k])] = k;
  }
  const std::vector<std::int32_t> index_of = grid.BlocksOf(points.points_mm);
  const auto number_of = [&](std::size_t point) {
    const std::int32_t index = index_of[point];
    return index < 0 ? indices.size() : number[static_cast<std::size_t>(index)];
  };
  // Where each block's points begin, and behind them all those that are in none.
  std::vector<std::size_t> begin(indices.size() + 2, 0);
  for (std::size_t i = 0; i < index_of.size(); ++i) ++begin[number_of(i) + 1];
  for (std::size_t k = 1; k < begin.size(); ++k) begin[k] += begin[k - 1];
  const std::size_t count = begin[indices.size()];
  points_.points_mm.resize(count);
  points_.to_sensor.resize(count);
  std::vector<std::size_t> next = begin;
  for (std::size_t i = 0; i < index_of.size(); ++i) {
    const std::size_t k = number_of(i);
    if (k == indices.size()) continue;
    points_.points_mm[next[k]] = points.points_mm[i];
    points_.to_sensor[next[k]++] = points.to_sensor[i];
  }
  for (std::size_t k = 0; k < indices.size(); ++k) {
    const std::size_t size = begin[k + 1] - begin[k];
    PointBlock& block = blocks.emplace_back();
    block.center_mm = grid.CenterOf(grid.blocks()[static_cast<std::size_t>(indices[k])]);
    block.half_diagonal_mm = 0.5 * std::sqrt(3.0) * grid.block_mm();
    block.points = std::span(points_.points_mm).subspan(begin[k], size);
    block.to_sensor = std::span(points_.to_sensor).subspan(begin[k], size);
  }
}

}  // namespace bendloop::pipeline
