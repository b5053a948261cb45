// SPDX-License-Identifier: Apache-2.0
#include "pipeline/points/sample_grid.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace bendloop::pipeline {
namespace {

// None changes what comes out of points that a scanner can see, only what it costs.
struct GridSettings {
  // [blocks] Points further out than this belong to no tube: kilometres, for any pipe.
  double furthest_cell = 1'000'000;
  // Kept is every so many-th point at least: the last power of two but one in 32 bits, which leaves
  // room to double.
  std::uint32_t widest_stride = 1u << 30;
  // Points of a block in a sparse scan, for which there is room from the start (by trial).
  std::size_t usual_points = 8;
  // Of many points that come at once a thread takes so many; fewer come one after the other, which
  // is faster for them (by trial).
  std::size_t points_of_part = 32'768;
  // Parts of the blocks: several for each thread of any machine, so that none waits for the last.
  std::size_t most_rounds = 64;
};
constexpr GridSettings kGrid;

int NeighbourSlot(int dx, int dy, int dz) { return (dx + 1) * 9 + (dy + 1) * 3 + (dz + 1); }

// Many points on their way to their blocks, in parts of which each is looked at for itself.
class Arrivals {
 public:
  using Block = SampleGrid::Block;

  Arrivals(std::span<const Eigen::Vector3d> points, std::span<const SensorDirection> to_sensor)
      : points_(points),
        to_sensor_(to_sensor),
        parts_((points.size() + kGrid.points_of_part - 1) / kGrid.points_of_part) {}

  // Each part numbers the cells that its points meet. `locate(point, cell, voxel)`: false: nowhere.
  template <class Locate>
  void NumberCells(Workers* workers, Locate locate) {
    ParallelFor(workers, parts_.size(), [&](std::size_t k) {
      Part& part = parts_[k];
      const std::size_t begin = k * kGrid.points_of_part;
      const auto mine =
          points_.subspan(begin, std::min(kGrid.points_of_part, points_.size() - begin));
      part.cell_of.reserve(mine.size());
      part.voxel_of.reserve(mine.size());
      CellNumbers numbers;
      Eigen::Vector3i cell;
      std::size_t voxel = 0;
      for (const Eigen::Vector3d& point : mine) {
        const bool somewhere = locate(point, cell, voxel);
        const std::int32_t number = somewhere ? numbers.FindOrAdd(cell) : -1;
        part.cell_of.push_back(number);
        part.voxel_of.push_back(static_cast<std::uint8_t>(voxel));
        if (somewhere) part.Count(static_cast<std::size_t>(number), cell);
      }
    });
  }

  // Blocks, in the order in which the points one after the other would have made them.
  template <class FindOrCreate>
  void NumberBlocks(FindOrCreate find_or_create) {
    for (Part& part : parts_) {
      for (const Eigen::Vector3i& cell : part.cells) part.block_of.push_back(find_or_create(cell));
    }
  }

  // The points go behind those that their blocks hold, in their order.
  void PutBehind(std::vector<Block>& blocks, Workers* workers) {
    const std::vector<std::uint32_t> arriving = CountArriving(blocks.size());
    voxels_.resize(blocks.size());
    directions_.resize(to_sensor_.empty() ? 0 : blocks.size());
    for (std::size_t b = 0; b < blocks.size(); ++b) {
      held_.push_back(blocks[b].points.size());
      blocks[b].points.resize(held_[b] + arriving[b]);
      voxels_[b].resize(arriving[b]);
      if (!to_sensor_.empty()) directions_[b].resize(arriving[b]);
      count_ += arriving[b];
    }
    ParallelFor(workers, parts_.size(), [&](std::size_t k) {
      Part& part = parts_[k];
      for (std::size_t i = 0; i < part.cell_of.size(); ++i) {
        if (part.cell_of[i] < 0) continue;
        const auto cell = static_cast<std::size_t>(part.cell_of[i]);
        const auto b = static_cast<std::size_t>(part.block_of[cell]);
        const std::uint32_t at = part.next[cell]++;
        blocks[b].points[held_[b] + at] = points_[k * kGrid.points_of_part + i];
        voxels_[b][at] = part.voxel_of[i];
        if (!to_sensor_.empty()) directions_[b][at] = to_sensor_[k * kGrid.points_of_part + i];
      }
    });
  }

  // Those of block `b`, which it no longer holds then, into `points`.
  void Take(std::size_t b, Block& block, std::vector<Eigen::Vector3d>& points) const {
    points.assign(block.points.begin() + static_cast<std::ptrdiff_t>(held_[b]), block.points.end());
    block.points.resize(held_[b]);
  }

  std::size_t count() const { return count_; }  // of those that are somewhere
  std::size_t HeldBefore(std::size_t b) const { return held_[b]; }
  // Of the i-th that came to block `b`.
  std::size_t VoxelOf(std::size_t b, std::size_t i) const { return voxels_[b][i]; }
  SensorDirection DirectionOf(std::size_t b, std::size_t i) const {
    return to_sensor_.empty() ? SensorDirection{} : directions_[b][i];
  }

 private:
  struct Part {
    std::vector<std::int32_t> cell_of;  // by point; -1: nowhere
    std::vector<std::uint8_t> voxel_of;
    std::vector<Eigen::Vector3i> cells;  // by the part's own numbers
    std::vector<std::uint32_t> next;     // how many points; then where the next one goes
    std::vector<std::int32_t> block_of;

    void Count(std::size_t number, const Eigen::Vector3i& cell) {
      if (number == cells.size()) {
        cells.push_back(cell);
        next.push_back(0);
      }
      ++next[number];
    }
  };

  // How many come to each block. From then on the parts know where theirs go there.
  std::vector<std::uint32_t> CountArriving(std::size_t blocks) {
    std::vector<std::uint32_t> arriving(blocks, 0);
    for (Part& part : parts_) {
      for (std::size_t i = 0; i < part.cells.size(); ++i) {
        std::uint32_t& at = arriving[static_cast<std::size_t>(part.block_of[i])];
        at += std::exchange(part.next[i], at);
      }
    }
    return arriving;
  }

  std::span<const Eigen::Vector3d> points_;
  std::span<const SensorDirection> to_sensor_;  // as many, or none
  std::vector<Part> parts_;
  // By block: points before; of those that came, their voxels and directions.
  std::vector<std::size_t> held_;
  std::vector<std::vector<std::uint8_t>> voxels_;
  std::vector<std::vector<SensorDirection>> directions_;
  std::size_t count_ = 0;
};

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
  block.points.reserve(kGrid.usual_points);
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
  if (!(scaled.array().abs() < kGrid.furthest_cell).all()) return false;  // NaN too
  // Truncation of positive numbers, which is faster than the floor of any.
  const Eigen::Vector3d shifted = scaled.array() + kGrid.furthest_cell;
  const Eigen::Vector3i cell = shifted.cast<int>();
  const Eigen::Vector3i sub =
      ((shifted - cell.cast<double>()) * kSubdivisions).cast<int>().cwiseMin(kSubdivisions - 1);
  place.cell = cell.array() - static_cast<int>(kGrid.furthest_cell);
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
      while (full.stride < kGrid.widest_stride && IsFull(full)) Thin(full);
      other_count_ -= before - full.points.size();
    }
  }
}

void SampleGrid::InsertAll(std::span<const Eigen::Vector3d> points, Workers* workers,
                           std::span<const SensorDirection> to_sensor) {
  if (points.size() < kGrid.points_of_part || other_count_ + points.size() > max_points_) {
    std::int32_t block = 0;
    for (std::size_t i = 0; i < points.size(); ++i) {
      Insert(points[i], block, to_sensor.empty() ? SensorDirection{} : to_sensor[i]);
    }
    return;
  }
  Arrivals arrivals(points, to_sensor);
  arrivals.NumberCells(
      workers, [this](const Eigen::Vector3d& point, Eigen::Vector3i& cell, std::size_t& voxel) {
        Place place;
        if (!Locate(point, place)) return false;
        cell = place.cell;
        voxel = place.voxel;
        return true;
      });
  arrivals.NumberBlocks([this](const Eigen::Vector3i& cell) { return FindOrCreate(cell); });
  arrivals.PutBehind(blocks_, workers);
  const std::size_t rounds = std::min(kGrid.most_rounds, blocks_.size());
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
      changes[round].others -= arrivals.HeldBefore(b) - block.sample_count;
      arrivals.Take(b, block, arrived);
      const bool directed = !to_sensor.empty() || !block.to_sensor.empty();
      for (std::size_t i = 0; i < arrived.size(); ++i) {
        const Insertion what = InsertInto(block, arrived[i], arrivals.VoxelOf(b, i));
        if (directed) SetDirection(block, what, arrivals.DirectionOf(b, i));
      }
      changes[round].samples += block.sample_count;
      changes[round].others += block.points.size() - block.sample_count;
    }
  });
  for (const Change& change : changes) {
    sample_count_ += change.samples;
    other_count_ += change.others;
  }
  point_count_ += arrivals.count();
}

std::vector<std::int32_t> SampleGrid::BlocksOf(std::span<const Eigen::Vector3d> points) const {
  std::vector<std::int32_t> indices;
  indices.reserve(points.size());
  // Neighbours in a line mostly are in one block.
  Place last;
  std::int32_t of_last = -1;
  for (const Eigen::Vector3d& point : points) {
    Place place;
    const bool somewhere = Locate(point, place);
    if (somewhere && (of_last < 0 || place.cell != last.cell)) {
      last = place;
      of_last = numbers_.Find(place.cell);
    }
    indices.push_back(somewhere ? of_last : -1);
  }
  return indices;
}

void SampleGrid::Thin(Block& block) {
  if (block.stride >= kGrid.widest_stride) return;
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
