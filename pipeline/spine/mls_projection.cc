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

// What the projection goes by (Bauer & Polthier 2009, sections 2, 3 and 7).
struct ProjectionSettings {
  // [of r_P] Radius of the ball around a sample that its paraboloid looks at: section 7; the wider
  // one where stripes or a sparse scan leave too few samples in that (by trial).
  double paraboloid = 2.0 / 3.0;
  double wider_paraboloid = 1.0;
  // [of r_P] Support of the cylinder's weights: section 3.2 with its erratum; the wider one for
  // stripes further apart than that reaches (by trial).
  double support = 1.2;
  double wider_support = 2.4;
  // [of r_P] How far the node may lie from where the fit starts, beyond its support (by trial).
  double ball_margin = 0.2;
  // [of r_P] Edge of a cube of the spine, whose starts share one fit (by trial).
  double cube = 0.5;
  // Samples of a block that are asked: more starts say the same again (by trial).
  std::size_t seeds_of_block = 8;
  // [of 1/r_P] How far a principal curvature may be off. Section 7 has 0.1; a sample's scatters
  // more than that under 0.1 mm of noise on a 2 mm wire, and the cylinder fit judges again.
  double curvature_tolerance = 0.3;
  // [of 1/r_P] Less curved is a plane; and [of r_P] no rougher, which through both the wall and the
  // bore behind it would be (by trial).
  double flat = 0.35;
  double most_rms_of_plane = 0.06;
  // [of r_P] Steps of the cylinder fit end below this: far less than what noise does.
  double step_tolerance = 1e-4;
  // [of r_P] Rougher paraboloids and cylinders fit something else: noise of 0.12 mm on a 2 mm wire
  // is half of it.
  double most_rms = 0.12;
  // [of r_P] Tukey's cut-off of the cylinder fit: twice the roughness that passes (by trial).
  double inlier = 0.25;
  // [of the circumference] A cylinder laid on from outside has less (by trial).
  double least_coverage = 0.25;
  // [of r_P] Spread of the samples along the axis (1 sigma); less is a stripe, which has no
  // direction (by trial).
  double least_axial_spread = 0.2;
  // [of r_P] From start to node: section 7's last rule.
  double most_move = 0.5;
  // Cosine between the tangents of start and node: 45 degrees (by trial).
  double least_turn_cosine = 0.7;
  // [of the median] A node far rougher than the common one is a fit across two things (by trial)
  // ...
  double most_roughness = 2.2;
  // [of r_P] ... but for one this smooth, which is good whatever the others are (by trial).
  double always_smooth = 0.04;
  // Workers share the loops in rounds of so many: short enough to even out, long enough to be worth
  // handing over (by trial). Neither changes what comes out.
  std::size_t blocks_of_round = 24;
  std::size_t cubes_of_round = 12;
};
constexpr ProjectionSettings kMls;

// Which node is the mirror image of which (all by trial).
struct MirrorSettings {
  // [of r_P] Distance of mirrored axes: around the two radii that it is without noise.
  double nearest = 1.6;
  double furthest = 2.3;
  // Cosine between their tangents, 32 degrees: they are parallel but for noise.
  double least_cosine = 0.85;
  // [of the distance] The part along the tangent: they lie side by side.
  double most_along = 0.5;
  // The true one has so many times the samples.
  double samples = 1.6;
};
constexpr MirrorSettings kMirror;

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
  VisitNearPairs(nodes, kMirror.furthest * radius_mm,
                 [&](std::size_t i, std::size_t j, double distance) {
                   const SpineNode& a = nodes[i];
                   const SpineNode& b = nodes[j];
                   if (distance < kMirror.nearest * radius_mm) return;
                   if (std::abs(a.tangent.dot(b.tangent)) < kMirror.least_cosine) return;
                   if (std::abs((b.position_mm - a.position_mm).dot(a.tangent)) >
                       kMirror.most_along * distance)
                     return;
                   if (a.samples > kMirror.samples * static_cast<double>(b.samples))
                     mirrored[j] = true;
                   if (b.samples > kMirror.samples * static_cast<double>(a.samples))
                     mirrored[i] = true;
                 });
  std::vector<SpineNode> kept;
  for (std::size_t i = 0; i < nodes.size(); ++i) {
    if (!mirrored[i]) kept.push_back(nodes[i]);
  }
  return kept;
}

}  // namespace

std::uint64_t MlsProjection::KeyOf(const Eigen::Vector3d& point) const {
  const Eigen::Vector3i cell = (point / (kMls.cube * radius_mm_)).array().floor().cast<int>();
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
  const std::size_t seeds = std::min(samples.size(), kMls.seeds_of_block);
  std::size_t looked_at = 0;
  std::size_t flat = 0;
  for (std::size_t i = 0; i < seeds; ++i) {
    const Eigen::Vector3d& sample = samples[i * samples.size() / seeds];
    auto surface = FitLocalParaboloid(sample, scratch.around, kMls.paraboloid * radius_mm_);
    if (!surface) {
      found.wide = true;
      grid.GatherBall(sample, kMls.wider_paraboloid * radius_mm_, scratch.ball);
      surface = FitLocalParaboloid(sample, scratch.ball, kMls.wider_paraboloid * radius_mm_);
    }
    if (!surface) continue;
    ++looked_at;
    if (surface->rms_mm > kMls.most_rms * radius_mm_) continue;
    const bool is_smooth = surface->rms_mm < kMls.most_rms_of_plane * radius_mm_;
    if (is_smooth && std::abs(surface->curvature[0]) * radius_mm_ < kMls.flat) ++flat;
    // Around the pipe the curvature is 1/r_P. Inside a tight bend the curvature along the pipe may
    // be as large, with the other sign; a sample where both could be meant says nothing.
    const auto agrees = [&](std::size_t k) {
      return std::abs(std::abs(surface->curvature[k]) * radius_mm_ - 1.0) <
             kMls.curvature_tolerance;
    };
    if (agrees(0) == agrees(1)) continue;
    const std::size_t curved = agrees(0) ? 0 : 1;
    const double side = surface->curvature[curved] > 0 ? 1.0 : -1.0;
    found.starts.push_back(
        {surface->foot_mm + side * radius_mm_ * surface->normal, surface->direction[1 - curved]});
  }
  found.planar = 2 * flat > looked_at;
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
  const std::size_t rounds = std::max<std::size_t>(1, blocks.size() / kMls.blocks_of_round);
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
  return grid.BallVersion(center, 0.5 * grid.block_mm() + kMls.wider_paraboloid * radius_mm_);
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
  for (const double support : {kMls.support, kMls.wider_support}) {
    cube.center_mm = mean;
    cube.ball_mm = (support + kMls.ball_margin) * radius_mm_;
    cube.versions = grid.BallVersion(cube.center_mm, cube.ball_mm);
    grid.GatherBall(cube.center_mm, cube.ball_mm, scratch.ball);
    const auto cylinder = FitCylinder(mean, tangent, scratch.ball,
                                      {.radius_mm = radius_mm_,
                                       .free_radius = false,
                                       .support_mm = support * radius_mm_,
                                       .inlier_mm = kMls.inlier * radius_mm_,
                                       .tolerance = kMls.step_tolerance});
    if (!cylinder || cylinder->axial_spread_mm < kMls.least_axial_spread * radius_mm_) continue;
    if (cylinder->angular_coverage < kMls.least_coverage ||
        cylinder->rms_mm > kMls.most_rms * radius_mm_ ||
        (cylinder->point_mm - mean).norm() > kMls.most_move * radius_mm_ ||
        std::abs(cylinder->axis.dot(tangent)) < kMls.least_turn_cosine) {
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
  const std::size_t rounds = std::max<std::size_t>(1, cubes.size() / kMls.cubes_of_round);
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
      std::max(kMls.most_roughness * Median(std::move(roughness)), kMls.always_smooth * radius_mm_);
  std::vector<SpineNode> nodes;
  nodes.reserve(found.size());
  for (const auto& [key, node] : found) {
    if (node->rms_mm <= limit) nodes.push_back(*node);
  }
  return WithoutMirrored(nodes, radius_mm_);
}

}  // namespace bendloop::pipeline
