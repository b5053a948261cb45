// SPDX-License-Identifier: Apache-2.0
#include "pipeline/spine/oriented_samples.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <map>
#include <tuple>

#include "pipeline/points/point_index.h"
#include "pipeline/spine/cylinder_fit.h"
#include "pipeline/spine/local_paraboloid.h"

namespace bendloop::pipeline {
namespace {

// How samples get their normals, and nodes a radius of their own. Lengths in parts of the local
// radius; by trial where nothing else is said.
struct OrientationSettings {
  // Radius of the ball that a paraboloid looks at (Bauer & Polthier 2009, section 7); the wider one
  // where there are fewer samples than enough in that, which make a normal that is several degrees
  // off.
  double paraboloid = 2.0 / 3.0;
  double wider_paraboloid = 1.0;
  std::size_t enough = 30;
  // Rougher paraboloids and cylinders fit something else.
  double most_rms = 0.15;
  // Tukey's cut-off of the cylinder fit: twice that.
  double inlier = 0.3;
  double least_coverage = 0.2;      // of the circumference
  double least_axial_spread = 0.2;  // 1 sigma; less is a stripe, which has no direction
  // [of the typical radius] Starts in one cube share a fit.
  double cube = 0.4;
  // Natural logarithm of the cylinder's radius over the starts': from 0.7 to 1.4 times.
  double most_off = 0.35;
  // From start to node (as in mls_projection.cc).
  double most_move = 0.5;
  // Cosine between the tangents of start and node: 45 degrees.
  double least_turn_cosine = 0.7;
  // Beyond the support of the cylinder: the node may move.
  double ball_margin = 0.3;
};
constexpr OrientationSettings kOrientation;

std::optional<LocalParaboloid> Paraboloid(const SampleGrid& grid, const Eigen::Vector3d& sample,
                                          double radius_mm, std::vector<Eigen::Vector3d>& ball) {
  grid.GatherBall(sample, kOrientation.paraboloid * radius_mm, ball);
  double reach_mm = kOrientation.paraboloid * radius_mm;
  if (ball.size() < kOrientation.enough) {
    reach_mm = kOrientation.wider_paraboloid * radius_mm;
    grid.GatherBall(sample, reach_mm, ball);
  }
  return FitLocalParaboloid(sample, ball, reach_mm);
}

// Where the samples of one cube say that the spine is.
struct Start {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  Eigen::Matrix3d directions = Eigen::Matrix3d::Zero();
  double radius_sum = 0;
  double count = 0;

  Eigen::Vector3d Tangent() const {
    Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen;
    eigen.computeDirect(directions);
    return eigen.eigenvectors().col(2);
  }
};

}  // namespace

std::vector<OrientedSample> OrientSamples(const SampleGrid& grid, double radius_mm, double widest,
                                          std::size_t max_samples) {
  std::vector<OrientedSample> result;
  std::vector<Eigen::Vector3d> ball;
  const std::size_t stride = grid.sample_count() / std::max<std::size_t>(max_samples, 1) + 1;
  std::size_t index = 0;
  for (const SampleGrid::Block& block : grid.blocks()) {
    for (const Eigen::Vector3d& sample : block.samples()) {
      if (index++ % stride != 0) continue;
      double local_mm = radius_mm;
      std::optional<LocalParaboloid> surface;
      for (int round = 0; round < 2; ++round) {
        surface = Paraboloid(grid, sample, local_mm, ball);
        if (!surface) break;
        local_mm = std::clamp(1.0 / std::max(std::abs(surface->curvature[0]), 1e-12),
                              radius_mm / widest, radius_mm * widest);
        // Close enough: the neighbourhood was the right one.
        if (std::abs(local_mm / radius_mm - 1.0) < 0.25) break;
      }
      if (!surface || surface->rms_mm > kOrientation.most_rms * local_mm) continue;
      const double curved_mm = 1.0 / std::max(std::abs(surface->curvature[0]), 1e-12);
      if (curved_mm > 1.3 * widest * radius_mm || curved_mm < radius_mm / (1.3 * widest)) continue;
      // A pipe bends away from its outward normal.
      const double side = surface->curvature[0] > 0 ? -1.0 : 1.0;
      result.push_back({surface->foot_mm, side * surface->normal, surface->direction[1],
                        std::clamp(curved_mm, radius_mm / widest, radius_mm * widest)});
    }
  }
  return result;
}

std::vector<SpineNode> ProjectWithFreeRadius(const SampleGrid& grid,
                                             std::span<const OrientedSample> samples,
                                             double radius_mm, double support) {
  std::map<std::tuple<int, int, int>, Start> starts;
  for (const OrientedSample& sample : samples) {
    const Eigen::Vector3d at = sample.position_mm - sample.curved_radius_mm * sample.outward;
    const Eigen::Vector3i cell = (at / (kOrientation.cube * radius_mm)).array().floor().cast<int>();
    Start& start = starts[{cell.x(), cell.y(), cell.z()}];
    start.sum += at;
    start.directions += sample.along * sample.along.transpose();
    start.radius_sum += sample.curved_radius_mm;
    start.count += 1;
  }
  std::vector<Eigen::Vector3d> places;
  places.reserve(samples.size());
  for (const OrientedSample& sample : samples) places.push_back(sample.position_mm);
  const PointIndex index(places, radius_mm);
  // Noise turns some normals over, and a cylinder can be laid on from outside there. The samples
  // around it, most of which know better, face it.
  const auto is_inside = [&](const SpineNode& node) {
    int inside = 0;
    index.Visit(node.position_mm, 1.3 * node.radius_mm, [&](std::size_t i) {
      inside += samples[i].outward.dot(places[i] - node.position_mm) > 0 ? 1 : -1;
    });
    return inside > 0;
  };
  std::vector<SpineNode> nodes;
  std::vector<Eigen::Vector3d> ball;
  for (const auto& [cell, start] : starts) {
    const Eigen::Vector3d at = start.sum / start.count;
    const double guess_mm = start.radius_sum / start.count;
    const Eigen::Vector3d tangent = start.Tangent();
    grid.GatherBall(at, (support + kOrientation.ball_margin) * guess_mm, ball);
    const auto cylinder = FitCylinder(at, tangent, ball,
                                      {.radius_mm = guess_mm,
                                       .free_radius = true,
                                       .support_mm = support * guess_mm,
                                       .inlier_mm = kOrientation.inlier * guess_mm});
    if (!cylinder) continue;
    const SpineNode node{cylinder->point_mm, cylinder->axis, cylinder->rms_mm, cylinder->inliers,
                         cylinder->radius_mm};
    if (cylinder->axial_spread_mm >= kOrientation.least_axial_spread * guess_mm &&
        cylinder->angular_coverage >= kOrientation.least_coverage &&
        cylinder->rms_mm <= kOrientation.most_rms * cylinder->radius_mm &&
        std::abs(std::log(cylinder->radius_mm / guess_mm)) <= kOrientation.most_off &&
        (cylinder->point_mm - at).norm() <= kOrientation.most_move * guess_mm &&
        std::abs(cylinder->axis.dot(tangent)) >= kOrientation.least_turn_cosine &&
        is_inside(node)) {
      nodes.push_back(node);
    }
  }
  return nodes;
}

}  // namespace bendloop::pipeline
