// SPDX-License-Identifier: Apache-2.0
#include "pipeline/sample_grid.h"

#include <cmath>
#include <utility>

namespace bendloop::pipeline {
namespace {

// 21 bits an axis; points that are a million blocks away belong to no tube.
constexpr double kMaxCell = 1'000'000;
constexpr std::uint32_t kMaxStride = 1u << 30;

std::uint64_t Key(const Eigen::Vector3i& cell) {
  const auto part = [](int c) { return static_cast<std::uint64_t>(c + (1 << 20)); };
  return (part(cell.x()) << 42) | (part(cell.y()) << 21) | part(cell.z());
}

int NeighbourSlot(int dx, int dy, int dz) { return (dx + 1) * 9 + (dy + 1) * 3 + (dz + 1); }

}  // namespace

Eigen::Vector3i SampleGrid::CellOf(const Eigen::Vector3d& point) const {
  return (point / block_mm_).array().floor().cast<int>();
}

// Where the key is, or where it would go.
std::size_t SampleGrid::SlotOf(std::uint64_t key) const {
  std::size_t at = (key * 0x9e3779b97f4a7c15u) >> shift_;
  while (slots_[at].block >= 0 && slots_[at].key != key) at = (at + 1) & (slots_.size() - 1);
  return at;
}

void SampleGrid::Grow() {
  const std::vector<Slot> old = std::exchange(slots_, std::vector<Slot>(2 * slots_.size()));
  --shift_;
  for (const Slot& slot : old) {
    if (slot.block >= 0) slots_[SlotOf(slot.key)] = slot;
  }
}

std::int32_t SampleGrid::Find(const Eigen::Vector3i& cell) const {
  return slots_[SlotOf(Key(cell))].block;
}

std::int32_t SampleGrid::FindOrCreate(const Eigen::Vector3i& cell) {
  if (last_block_ >= 0 && blocks_[static_cast<std::size_t>(last_block_)].cell == cell) {
    return last_block_;
  }
  const std::uint64_t key = Key(cell);
  const std::size_t slot = SlotOf(key);
  if (slots_[slot].block >= 0) return last_block_ = slots_[slot].block;
  last_block_ = static_cast<std::int32_t>(blocks_.size());
  slots_[slot] = {key, last_block_};
  if (2 * blocks_.size() >= slots_.size()) Grow();
  Block& block = blocks_.emplace_back();
  block.cell = cell;
  for (int dx = -1; dx <= 1; ++dx) {
    for (int dy = -1; dy <= 1; ++dy) {
      for (int dz = -1; dz <= 1; ++dz) {
        const std::int32_t neighbour = Find(cell + Eigen::Vector3i(dx, dy, dz));
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

SampleGrid::Insertion SampleGrid::Insert(const Eigen::Vector3d& point, std::int32_t& block_index) {
  const Eigen::Vector3d scaled = point / block_mm_;
  if (!(scaled.array().abs() < kMaxCell).all()) return Insertion::kDropped;  // NaN too
  const Eigen::Vector3d floor = scaled.array().floor();
  block_index = FindOrCreate(floor.cast<int>());
  Block& block = blocks_[static_cast<std::size_t>(block_index)];
  const Eigen::Vector3i sub =
      ((scaled - floor) * kSubdivisions).cast<int>().cwiseMin(kSubdivisions - 1);
  const auto voxel =
      static_cast<std::size_t>((sub.x() * kSubdivisions + sub.y()) * kSubdivisions + sub.z());
  ++point_count_;
  if (!block.seen[voxel]) {
    block.seen[voxel] = true;
    block.points.push_back(point);
    std::swap(block.points.back(), block.points[block.sample_count++]);
    ++sample_count_;
    return Insertion::kSample;
  }
  if ((block.arrived++ & (block.stride - 1)) != 0) return Insertion::kDropped;
  if (IsFull(block)) {
    Thin(block);
    if (((block.arrived - 1) & (block.stride - 1)) != 0) return Insertion::kDropped;
  }
  block.points.push_back(point);
  ++other_count_;
  while (other_count_ > max_points_ && points_of_voxel_ > 1) {
    points_of_voxel_ /= 2;
    for (Block& full : blocks_) {
      while (full.stride < kMaxStride && IsFull(full)) Thin(full);
    }
  }
  return Insertion::kOther;
}

void SampleGrid::Thin(Block& block) {
  if (block.stride >= kMaxStride) return;
  std::size_t kept = block.sample_count;
  for (std::size_t i = block.sample_count; i < block.points.size(); i += 2) {
    block.points[kept++] = block.points[i];
  }
  other_count_ -= block.points.size() - kept;
  block.points.resize(kept);
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
        const std::int32_t found = Find({x, y, z});
        if (found >= 0) visit(blocks_[static_cast<std::size_t>(found)]);
      }
    }
  }
}

void SampleGrid::GatherBall(const Eigen::Vector3d& center, double radius_mm,
                            std::vector<Eigen::Vector3d>& out) const {
  out.clear();
  const double radius2 = radius_mm * radius_mm;
  VisitBlocks(center, radius_mm, [&](const Block& block) {
    for (const Eigen::Vector3d& sample : block.samples()) {
      if ((sample - center).squaredNorm() < radius2) out.push_back(sample);
    }
  });
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
