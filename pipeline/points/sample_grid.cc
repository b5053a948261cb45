// SPDX-License-Identifier: Apache-2.0
#include "pipeline/points/sample_grid.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace bendloop::pipeline {
namespace {

// Points that are a million blocks away belong to no tube.
constexpr double kMaxCell = 1'000'000;
constexpr std::uint32_t kMaxStride = 1u << 30;
constexpr std::size_t kUsualPoints = 8;  // of a block in a sparse scan
// Of many points that come at once.
constexpr std::size_t kPart = 32'768;
constexpr std::size_t kMostRounds = 64;

int NeighbourSlot(int dx, int dy, int dz) { return (dx + 1) * 9 + (dy + 1) * 3 + (dz + 1); }

}  // namespace

Eigen::Vector3i SampleGrid::CellOf(const Eigen::Vector3d& point) const {
  return (point * inverse_mm_).array().floor().cast<int>();
}

std::int32_t SampleGrid::FindOrCreate(const Eigen::Vector3i& cell) {
  if (last_block_ >= 0 && blocks_[static_cast<std::size_t>(last_block_)].cell == cell) {
    return last_block_;
  }
  last_block_ = numbers_.FindOrAdd(cell);
  if (static_cast<std::size_t>(last_block_) < blocks_.size()) return last_block_;
  Block& block = blocks_.emplace_back();
  block.cell = cell;
  block.points.reserve(kUsualPoints);
  for (int dx = -1; dx <= 1; ++dx) {
    for (int dy = -1; dy <= 1; ++dy) {
      for (int dz = -1; dz <= 1; ++dz) {
        const std::int32_t neighbour = numbers_.Find(cell + Eigen::Vector3i(dx, dy, dz));
        block.neighbours[static_cast<std::size_t>(NeighbourSlot(dx, dy, dz))] = neighbour;
        if (neighbour >= 0) {
          blocks_[static_cast<std::size_t>(neighbour)]
              .neighbours[static_cast<std::size_t>(NeighbourSlot(-dx, -dy, -dz))] = last_block_;
        }
      }
    }
  }
  return last_block_;
}

bool SampleGrid::Locate(const Eigen::Vector3d& point, Place& place) const {
  const Eigen::Vector3d scaled = point * inverse_mm_;
  if (!(scaled.array().abs() < kMaxCell).all()) return false;  // NaN too
  // Truncation of positive numbers, which is faster than the floor of any.
  const Eigen::Vector3d shifted = scaled.array() + kMaxCell;
  const Eigen::Vector3i cell = shifted.cast<int>();
  const Eigen::Vector3i sub =
      ((shifted - cell.cast<double>()) * kSubdivisions).cast<int>().cwiseMin(kSubdivisions - 1);
  place.cell = cell.array() - static_cast<int>(kMaxCell);
  place.voxel =
      static_cast<std::size_t>((sub.x() * kSubdivisions + sub.y()) * kSubdivisions + sub.z());
  return true;
}

SampleGrid::Insertion SampleGrid::InsertInto(Block& block, const Eigen::Vector3d& point,
                                             std::size_t voxel) const {
  if (!block.seen[voxel]) {
    block.seen[voxel] = true;
    block.points.push_back(point);
    std::swap(block.points.back(), block.points[block.sample_count++]);
    return Insertion::kSample;
  }
  if ((block.arrived++ & (block.stride - 1)) != 0) return Insertion::kDropped;
  if (IsFull(block)) {
    Thin(block);
    if (((block.arrived - 1) & (block.stride - 1)) != 0) return Insertion::kDropped;
  }
  block.points.push_back(point);
  return Insertion::kOther;
}

void SampleGrid::SetDirection(Block& block, Insertion what, SensorDirection to_sensor) {
  if (what == Insertion::kDropped || (block.to_sensor.empty() && !to_sensor.known())) return;
  block.to_sensor.resize(block.points.size() - 1);
  block.to_sensor.push_back(to_sensor);
  if (what == Insertion::kOther) return;
  std::swap(block.to_sensor.back(), block.to_sensor[block.sample_count - 1]);
}

SampleGrid::Insertion SampleGrid::Insert(const Eigen::Vector3d& point, std::int32_t& block_index,
                                         SensorDirection to_sensor) {
  Place place;
  if (!Locate(point, place)) return Insertion::kDropped;
  block_index = FindOrCreate(place.cell);
  Block& block = blocks_[static_cast<std::size_t>(block_index)];
  ++point_count_;
  const std::size_t before = block.points.size() - block.sample_count;
  const Insertion what = InsertInto(block, point, place.voxel);
  SetDirection(block, what, to_sensor);
  sample_count_ += what == Insertion::kSample ? 1 : 0;
  other_count_ += block.points.size() - block.sample_count - before;  // fewer, if it was full
  if (what == Insertion::kOther) BoundOthers();
  return what;
}

void SampleGrid::BoundOthers() {
  while (other_count_ > max_points_ && points_of_voxel_ > 1) {
    points_of_voxel_ /= 2;
    for (Block& full : blocks_) {
      const std::size_t before = full.points.size();
      while (full.stride < kMaxStride && IsFull(full)) Thin(full);
      other_count_ -= before - full.points.size();
    }
  }
}

void SampleGrid::InsertAll(std::span<const Eigen::Vector3d> points, Workers* workers,
                           std::span<const SensorDirection> to_sensor) {
  if (points.size() < kPart || other_count_ + points.size() > max_points_) {
    std::int32_t block = 0;
    for (std::size_t i = 0; i < points.size(); ++i) {
      Insert(points[i], block, to_sensor.empty() ? SensorDirection{} : to_sensor[i]);
    }
    return;
  }
  // Parts of the points number the cells that they meet, each for itself.
  struct Part {
    std::vector<std::int32_t> cell_of;  // by point; -1: nowhere
    std::vector<std::uint8_t> voxel_of;
    std::vector<Eigen::Vector3i> cells;  // by the part's own numbers
    std::vector<std::uint32_t> next;     // how many points; then where the next one goes
    std::vector<std::int32_t> block_of;
  };
  std::vector<Part> parts((points.size() + kPart - 1) / kPart);
  ParallelFor(workers, parts.size(), [&](std::size_t k) {
    Part& part = parts[k];
    const auto mine = points.subspan(k * kPart, std::min(kPart, points.size() - k * kPart));
    part.cell_of.reserve(mine.size());
    part.voxel_of.reserve(mine.size());
    CellNumbers numbers;
    Place place;
    for (const Eigen::Vector3d& point : mine) {
      const bool somewhere = Locate(point, place);
      const std::int32_t cell = somewhere ? numbers.FindOrAdd(place.cell) : -1;
      part.cell_of.push_back(cell);
      part.voxel_of.push_back(static_cast<std::uint8_t>(place.voxel));
      if (!somewhere) continue;
      if (static_cast<std::size_t>(cell) == part.cells.size()) {
        part.cells.push_back(place.cell);
        part.next.push_back(0);
      }
      ++part.next[static_cast<std::size_t>(cell)];
    }
  });
  // Blocks, in the order in which the points one after the other would have made them.
  for (Part& part : parts) {
    for (const Eigen::Vector3i& cell : part.cells) part.block_of.push_back(FindOrCreate(cell));
  }
  std::vector<std::uint32_t> arriving(blocks_.size(), 0);
  for (Part& part : parts) {
    for (std::size_t i = 0; i < part.cells.size(); ++i) {
      std::uint32_t& at = arriving[static_cast<std::size_t>(part.block_of[i])];
      at += std::exchange(part.next[i], at);
    }
  }
  // The points go behind those that their blocks hold, in their order.
  std::vector<std::size_t> held;
  std::vector<std::vector<std::uint8_t>> voxels(blocks_.size());
  std::vector<std::vector<SensorDirection>> directions(to_sensor.empty() ? 0 : blocks_.size());
  for (std::size_t b = 0; b < blocks_.size(); ++b) {
    held.push_back(blocks_[b].points.size());
    blocks_[b].points.resize(held[b] + arriving[b]);
    voxels[b].resize(arriving[b]);
    if (!to_sensor.empty()) directions[b].resize(arriving[b]);
  }
  ParallelFor(workers, parts.size(), [&](std::size_t k) {
    Part& part = parts[k];
    for (std::size_t i = 0; i < part.cell_of.size(); ++i) {
      if (part.cell_of[i] < 0) continue;
      const auto cell = static_cast<std::size_t>(part.cell_of[i]);
      const auto b = static_cast<std::size_t>(part.block_of[cell]);
      const std::uint32_t at = part.next[cell]++;
      blocks_[b].points[held[b] + at] = points[k * kPart + i];
      voxels[b][at] = part.voxel_of[i];
      if (!to_sensor.empty()) directions[b][at] = to_sensor[k * kPart + i];
    }
  });
  const std::size_t rounds = std::min(kMostRounds, blocks_.size());
  struct Change {
    std::size_t samples = 0, others = 0;
  };
  std::vector<Change> changes(rounds);
  ParallelFor(workers, rounds, [&](std::size_t round) {
    std::vector<Eigen::Vector3d> arrived;
    for (std::size_t b = round * blocks_.size() / rounds; b < (round + 1) * blocks_.size() / rounds;
         ++b) {
      Block& block = blocks_[b];
      changes[round].samples -= block.sample_count;
      changes[round].others -= held[b] - block.sample_count;
      arrived.assign(block.points.begin() + static_cast<std::ptrdiff_t>(held[b]),
                     block.points.end());
      block.points.resize(held[b]);
      const bool directed = !to_sensor.empty() || !block.to_sensor.empty();
      for (std::size_t i = 0; i < arrived.size(); ++i) {
        const Insertion what = InsertInto(block, arrived[i], voxels[b][i]);
        if (!directed) continue;
        SetDirection(block, what, to_sensor.empty() ? SensorDirection{} : directions[b][i]);
      }
      changes[round].samples += block.sample_count;
      changes[round].others += block.points.size() - block.sample_count;
    }
  });
  for (const Change& change : changes) {
    sample_count_ += change.samples;
    other_count_ += change.others;
  }
  for (const std::uint32_t count : arriving) point_count_ += count;
}

void SampleGrid::Thin(Block& block) {
  if (block.stride >= kMaxStride) return;
  std::size_t kept = block.sample_count;
  for (std::size_t i = block.sample_count; i < block.points.size(); i += 2) {
    if (!block.to_sensor.empty()) block.to_sensor[kept] = block.to_sensor[i];
    block.points[kept++] = block.points[i];
  }
  block.points.resize(kept);
  if (!block.to_sensor.empty()) block.to_sensor.resize(kept);
  block.stride *= 2;
}

void SampleGrid::GatherNeighbourhood(std::int32_t block, std::vector<Eigen::Vector3d>& out) const {
  out.clear();
  for (const std::int32_t neighbour : blocks_[static_cast<std::size_t>(block)].neighbours) {
    if (neighbour < 0) continue;
    const auto samples = blocks_[static_cast<std::size_t>(neighbour)].samples();
    out.insert(out.end(), samples.begin(), samples.end());
  }
}

template <class Visit>
void SampleGrid::VisitBlocks(const Eigen::Vector3d& center, double radius_mm, Visit visit) const {
  const Eigen::Vector3d reach = Eigen::Vector3d::Constant(radius_mm);
  const Eigen::Vector3i low = CellOf(center - reach);
  const Eigen::Vector3i high = CellOf(center + reach);
  for (int x = low.x(); x <= high.x(); ++x) {
    for (int y = low.y(); y <= high.y(); ++y) {
      for (int z = low.z(); z <= high.z(); ++z) {
        const std::int32_t found = numbers_.Find({x, y, z});
        if (found >= 0) visit(blocks_[static_cast<std::size_t>(found)]);
      }
    }
  }
}

void SampleGrid::GatherBall(const Eigen::Vector3d& center, double radius_mm,
                            std::vector<Eigen::Vector3d>& out) const {
  const double radius2 = radius_mm * radius_mm;
  std::size_t count = 0;
  VisitBlocks(center, radius_mm, [&](const Block& block) {
    if (out.size() < count + block.sample_count) out.resize(2 * (count + block.sample_count));
    for (const Eigen::Vector3d& sample : block.samples()) {
      out[count] = sample;
      count += (sample - center).squaredNorm() < radius2 ? 1 : 0;
    }
  });
  out.resize(count);
}

std::vector<std::int32_t> SampleGrid::BlocksNear(std::span<const Eigen::Vector3d> places,
                                                 double radius_mm) const {
  std::vector<bool> near(blocks_.size(), false);
  for (const Eigen::Vector3d& place : places) {
    VisitBlocks(place, radius_mm, [&](const Block& block) {
      near[static_cast<std::size_t>(&block - blocks_.data())] = true;
    });
  }
  std::vector<std::int32_t> indices;
  for (std::size_t i = 0; i < near.size(); ++i) {
    if (near[i]) indices.push_back(static_cast<std::int32_t>(i));
  }
  return indices;
}

std::uint64_t SampleGrid::BallVersion(const Eigen::Vector3d& center, double radius_mm) const {
  std::uint64_t versions = 0;
  VisitBlocks(center, radius_mm, [&](const Block& block) { versions += block.sample_count; });
  return versions;
}

}  // namespace bendloop::pipeline
