// SPDX-License-Identifier: Apache-2.0
#include "pipeline/spine/mls_projection.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "pipeline/math/quantiles.h"
#include "pipeline/spine/cylinder_fit.h"
#include "pipeline/spine/local_paraboloid.h"
#include "pipeline/spine/node_pairs.h"

namespace bendloop::pipeline {
namespace {

constexpr double kParaboloid = 2.0 / 3.0;  // of r_P, section 7
constexpr double kWiderParaboloid = 1.0;   // where stripes or a sparse scan leave too few samples
constexpr double kSupport = 1.2;           // of r_P, section 3.2 with its erratum
constexpr double kWiderSupport = 2.4;      // for stripes further apart than the support reaches
constexpr double kCube = 0.5;              // of r_P, edge of a cube of the spine
constexpr std::size_t kSeedsOfBlock = 8;   // more starts in a block say the same again
// Section 7 has 0.1; a sample's curvature scatters more than that under 0.1 mm of noise on a 2 mm
// wire, and the cylinder fit judges again.
constexpr double kCurvatureTolerance = 0.3;
constexpr double kTolerance = 1e-4;  // of r_P: far less than what noise does
constexpr double kMaxRms = 0.12;     // of r_P, paraboloid and cylinder
constexpr double kInlier = 0.25;     // of r_P, Tukey's cut-off
constexpr double kMinCoverage =
    0.25;  // of the circumference; a cylinder laid on from outside has less
// A node far rougher than the common one is a fit across two things.
constexpr double kMaxRoughness = 2.2;   // of the median
constexpr double kAlwaysSmooth = 0.04;  // of r_P
constexpr double kMirrorNear = 1.6;     // of r_P, around the two radii between mirrored axes
constexpr double kMirrorFar = 2.3;
constexpr double kMirrorSamples = 1.6;
constexpr double kMinAxialSpread = 0.2;  // of r_P; less is a stripe, which has no direction
constexpr double kFlat = 0.35;           // of 1/r_P; less curved is a plane
constexpr double kMaxMove = 0.5;         // of r_P from start to node (section 7's last rule)

constexpr std::size_t kBlocksOfRound = 24;  // of a loop that workers share
constexpr std::size_t kCubesOfRound = 12;

// The part of the items that falls to one of several rounds.
template <class T>
std::span<T> PartOf(std::span<T> items, std::size_t round, std::size_t rounds) {
  const std::size_t begin = round * items.size() / rounds;
  return items.subspan(begin, (round + 1) * items.size() / rounds - begin);
}

// Samples of a tube also fit, worse, to a cylinder laid against it from outside: its axis runs
// parallel to the true one at twice the radius. Of such a pair the node with far fewer samples
// goes; two real tubes that touch have about as many each.
std::vector<SpineNode> WithoutMirrored(const std::vector<SpineNode>& nodes, double radius_mm) {
  std::vector<bool> mirrored(nodes.size(), false);
  VisitNearPairs(nodes, kMirrorFar * radius_mm, [&](std::size_t i, std::size_t j, double distance) {
    const SpineNode& a = nodes[i];
    const SpineNode& b = nodes[j];
    if (distance < kMirrorNear * radius_mm) return;
    if (std::abs(a.tangent.dot(b.tangent)) < 0.85) return;
    if (std::abs((b.position_mm - a.position_mm).dot(a.tangent)) > 0.5 * distance) return;
    if (a.samples > kMirrorSamples * static_cast<double>(b.samples)) mirrored[j] = true;
    if (b.samples > kMirrorSamples * static_cast<double>(a.samples)) mirrored[i] = true;
  });
  std::vector<SpineNode> kept;
  for (std::size_t i = 0; i < nodes.size(); ++i) {
    if (!mirrored[i]) kept.push_back(nodes[i]);
  }
  return kept;
}

}  // namespace

std::uint64_t MlsProjection::KeyOf(const Eigen::Vector3d& point) const {
  const Eigen::Vector3i cell = (point / (kCube * radius_mm_)).array().floor().cast<int>();
  const auto part = [](int c) { return static_cast<std::uint64_t>(c + (1 << 20)) & 0x1fffff; };
  return (part(cell.x()) << 42) | (part(cell.y()) << 21) | part(cell.z());
}

void MlsProjection::MarkChanged(std::uint64_t key, Cube& cube) {
  if (cube.changed) return;
  cube.changed = true;
  changed_.push_back(key);
}

MlsProjection::BlockStarts MlsProjection::StartsOf(const SampleGrid& grid, std::int32_t block,
                                                   Scratch& scratch) const {
  BlockStarts found;
  grid.GatherNeighbourhood(block, scratch.around);
  const auto samples = grid.blocks()[static_cast<std::size_t>(block)].samples();
  const std::size_t seeds = std::min(samples.size(), kSeedsOfBlock);
  std::size_t surfaces = 0;
  std::size_t flat = 0;
  for (std::size_t i = 0; i < seeds; ++i) {
    const Eigen::Vector3d& sample = samples[i * samples.size() / seeds];
    auto surface = FitLocalParaboloid(sample, scratch.around, kParaboloid * radius_mm_);
    if (!surface) {
      found.wide = true;
      grid.GatherBall(sample, kWiderParaboloid * radius_mm_, scratch.ball);
      surface = FitLocalParaboloid(sample, scratch.ball, kWiderParaboloid * radius_mm_);
    }
    if (!surface || surface->rms_mm > kMaxRms * radius_mm_) continue;
    ++surfaces;
    if (std::abs(surface->curvature[0]) * radius_mm_ < kFlat) ++flat;
    // Around the pipe the curvature is 1/r_P. Inside a tight bend the curvature along the pipe may
    // be as large, with the other sign; a sample where both could be meant says nothing.
    const auto agrees = [&](std::size_t k) {
      return std::abs(std::abs(surface->curvature[k]) * radius_mm_ - 1.0) < kCurvatureTolerance;
    };
    if (agrees(0) == agrees(1)) continue;
    const std::size_t curved = agrees(0) ? 0 : 1;
    const double side = surface->curvature[curved] > 0 ? 1.0 : -1.0;
    found.starts.push_back(
        {surface->foot_mm + side * radius_mm_ * surface->normal, surface->direction[1 - curved]});
  }
  found.planar = 2 * flat > surfaces;
  return found;
}

void MlsProjection::Take(const SampleGrid& grid, std::int32_t block, const BlockStarts& found) {
  auto& keys = cubes_of_block_[block];
  for (const std::uint64_t key : keys) {
    Cube& cube = cubes_[key];
    std::erase_if(cube.starts, [block](const auto& start) { return start.first == block; });
    MarkChanged(key, cube);
  }
  keys.clear();
  for (const Start& start : found.starts) {
    const std::uint64_t key = KeyOf(start.point_mm);
    Cube& cube = cubes_[key];
    cube.starts.emplace_back(block, start);
    MarkChanged(key, cube);
    if (std::find(keys.begin(), keys.end(), key) == keys.end()) keys.push_back(key);
  }
  if (found.planar) {
    planar_.insert(block);
  } else {
    planar_.erase(block);
  }
  if (found.wide) {
    wide_blocks_[block] = WideVersion(grid, block);
  } else {
    wide_blocks_.erase(block);
  }
}

void MlsProjection::UpdateBlocks(const SampleGrid& grid, std::span<const std::int32_t> blocks,
                                 Workers* workers) {
  const std::size_t rounds = std::max<std::size_t>(1, blocks.size() / kBlocksOfRound);
  std::vector<std::vector<BlockStarts>> found(rounds);
  ParallelFor(workers, rounds, [&](std::size_t round) {
    Scratch scratch;
    for (const std::int32_t block : PartOf(blocks, round, rounds)) {
      found[round].push_back(StartsOf(grid, block, scratch));
    }
  });
  for (std::size_t round = 0; round < rounds; ++round) {
    const auto part = PartOf(blocks, round, rounds);
    for (std::size_t i = 0; i < part.size(); ++i) Take(grid, part[i], found[round][i]);
  }
}

std::uint64_t MlsProjection::WideVersion(const SampleGrid& grid, std::int32_t block) const {
  const Eigen::Vector3d center = grid.CenterOf(grid.blocks()[static_cast<std::size_t>(block)]);
  return grid.BallVersion(center, 0.5 * grid.block_mm() + kWiderParaboloid * radius_mm_);
}

void MlsProjection::Fit(const SampleGrid& grid, Cube& cube, Scratch& scratch) const {
  // A fixed order of the starts, whatever the order in which their blocks were updated.
  std::stable_sort(cube.starts.begin(), cube.starts.end(),
                   [](const auto& a, const auto& b) { return a.first < b.first; });
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  Eigen::Matrix3d directions = Eigen::Matrix3d::Zero();
  for (const auto& [block, start] : cube.starts) {
    mean += start.point_mm;
    directions += start.tangent * start.tangent.transpose();
  }
  mean /= static_cast<double>(cube.starts.size());
  Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen;
  eigen.computeDirect(directions);
  const Eigen::Vector3d tangent = eigen.eigenvectors().col(2);

  cube.accepted = false;
  for (const double support : {kSupport, kWiderSupport}) {
    cube.center_mm = mean;
    cube.ball_mm = (support + 0.2) * radius_mm_;
    cube.versions = grid.BallVersion(cube.center_mm, cube.ball_mm);
    grid.GatherBall(cube.center_mm, cube.ball_mm, scratch.ball);
    const auto cylinder = FitCylinder(mean, tangent, scratch.ball,
                                      {.radius_mm = radius_mm_,
                                       .free_radius = false,
                                       .support_mm = support * radius_mm_,
                                       .inlier_mm = kInlier * radius_mm_,
                                       .tolerance = kTolerance});
    if (!cylinder || cylinder->axial_spread_mm < kMinAxialSpread * radius_mm_) continue;
    if (cylinder->angular_coverage < kMinCoverage || cylinder->rms_mm > kMaxRms * radius_mm_ ||
        (cylinder->point_mm - mean).norm() > kMaxMove * radius_mm_ ||
        std::abs(cylinder->axis.dot(tangent)) < 0.7) {
      break;
    }
    cube.accepted = true;
    cube.node = {cylinder->point_mm, cylinder->axis, cylinder->rms_mm, cylinder->inliers};
    break;
  }
}

void MlsProjection::UpdateNodes(const SampleGrid& grid, Workers* workers) {
  std::vector<Cube*> cubes;
  for (const std::uint64_t key : changed_) {
    const auto place = cubes_.find(key);
    if (place == cubes_.end()) continue;
    if (place->second.starts.empty()) {
      cubes_.erase(place);
      continue;
    }
    place->second.changed = false;
    cubes.push_back(&place->second);
  }
  changed_.clear();
  const std::size_t rounds = std::max<std::size_t>(1, cubes.size() / kCubesOfRound);
  ParallelFor(workers, rounds, [&](std::size_t round) {
    Scratch scratch;
    for (Cube* cube : PartOf(std::span<Cube* const>(cubes), round, rounds)) {
      Fit(grid, *cube, scratch);
    }
  });
}

void MlsProjection::FinishNodes(const SampleGrid& grid, Workers* workers) {
  std::vector<std::int32_t> stale;
  for (const auto& [block, version] : wide_blocks_) {
    if (WideVersion(grid, block) != version) stale.push_back(block);
  }
  UpdateBlocks(grid, stale, workers);
  for (auto& [key, cube] : cubes_) {
    if (!cube.changed && grid.BallVersion(cube.center_mm, cube.ball_mm) != cube.versions) {
      MarkChanged(key, cube);
    }
  }
  UpdateNodes(grid, workers);
}

std::vector<SpineNode> MlsProjection::Nodes() const {
  std::vector<std::pair<std::uint64_t, const SpineNode*>> found;
  for (const auto& [key, cube] : cubes_) {
    if (cube.accepted) found.emplace_back(key, &cube.node);
  }
  std::sort(found.begin(), found.end());
  std::vector<double> roughness;
  roughness.reserve(found.size());
  for (const auto& [key, node] : found) roughness.push_back(node->rms_mm);
  const double limit =
      std::max(kMaxRoughness * Median(std::move(roughness)), kAlwaysSmooth * radius_mm_);
  std::vector<SpineNode> nodes;
  nodes.reserve(found.size());
  for (const auto& [key, node] : found) {
    if (node->rms_mm <= limit) nodes.push_back(*node);
  }
  return WithoutMirrored(nodes, radius_mm_);
}

}  // namespace bendloop::pipeline
