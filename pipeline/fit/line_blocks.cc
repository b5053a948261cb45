// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/line_blocks.h"

#include <cmath>
#include <cstddef>

namespace bendloop::pipeline {

LineBlocks::LineBlocks(const KeptLines& lines, const SampleGrid& grid,
                       std::span<const std::int32_t> indices) {
  std::vector<std::size_t> number(grid.blocks().size(), indices.size());
  for (std::size_t k = 0; k < indices.size(); ++k) {
    number[static_cast<std::size_t>(indices[k])] = k;
  }
  // Where each block's points begin, and behind them all those that are in none.
  std::vector<std::size_t> number_of_point;
  std::vector<std::size_t> begin(indices.size() + 2, 0);
  number_of_point.reserve(lines.points().size());
  for (const Eigen::Vector3d& point : lines.points()) {
    const std::int32_t index = grid.BlockOf(point);
    const std::size_t k = index < 0 ? indices.size() : number[static_cast<std::size_t>(index)];
    number_of_point.push_back(k);
    ++begin[k + 1];
  }
  for (std::size_t k = 1; k < begin.size(); ++k) begin[k] += begin[k - 1];
  const std::size_t count = begin[indices.size()];
  points_.resize(count);
  to_sensor_.resize(count);
  std::vector<std::size_t> next = begin;
  for (std::size_t i = 0; i < number_of_point.size(); ++i) {
    const std::size_t k = number_of_point[i];
    if (k == indices.size()) continue;
    points_[next[k]] = lines.points()[i];
    to_sensor_[next[k]++] = lines.to_sensor()[i];
  }
  for (std::size_t k = 0; k < indices.size(); ++k) {
    const std::size_t size = begin[k + 1] - begin[k];
    PointBlock& block = blocks.emplace_back();
    block.center_mm = grid.CenterOf(grid.blocks()[static_cast<std::size_t>(indices[k])]);
    block.half_diagonal_mm = 0.5 * std::sqrt(3.0) * grid.block_mm();
    block.points = std::span(points_).subspan(begin[k], size);
    block.to_sensor = std::span(to_sensor_).subspan(begin[k], size);
  }
}

}  // namespace bendloop::pipeline
