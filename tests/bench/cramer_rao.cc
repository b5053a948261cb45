// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/cramer_rao.h"

#include <Eigen/Dense>
#include <cmath>
#include <numbers>
#include <vector>

#include "hal/spine.h"
#include "pipeline/fit/surface_points.h"
#include "pipeline/fit/tube_parameters.h"

namespace bendloop::bench {
namespace {

constexpr double kStep = 1e-5;  // mm and radians
constexpr std::size_t kPoints = 20'000;
constexpr double kDegrees = 180.0 / std::numbers::pi;

// Distance of each point from the surface, on the segment that it has at the true parameters.
Eigen::VectorXd Distances(const hal::Tube& tube, std::span<const Eigen::Vector3d> points,
                          const std::vector<std::int32_t>& segment_of) {
  const auto segments = hal::SpineSegments(tube.program, tube.X_WT);
  Eigen::VectorXd distances(static_cast<Eigen::Index>(points.size()));
  for (std::size_t i = 0; i < points.size(); ++i) {
    const auto& segment = segments[static_cast<std::size_t>(segment_of[i])];
    const Eigen::Vector3d v = points[i] - segment.start_mm;
    const double x = v.dot(segment.tangent);
    const double h = v.dot(segment.normal);
    double across = v.dot(segment.normal.cross(segment.tangent));
    if (segment.is_arc()) {
      across = std::hypot(x, across - segment.bend_radius_mm) - segment.bend_radius_mm;
    }
    distances[static_cast<Eigen::Index>(i)] = std::hypot(across, h) - tube.pipe_radius_mm;
  }
  return distances;
}

}  // namespace

// Central differences on purpose: a check on the fit's analytic derivatives must not share them.
Bound CramerRaoBound(const hal::Tube& truth, std::span<const Eigen::Vector3d> points_W,
                     double noise_mm, double systematic_mm) {
  const auto segments = hal::SpineSegments(truth.program, truth.X_WT);
  std::vector<std::int32_t> all;
  const auto frames = pipeline::SegmentFrames(segments);
  for (std::size_t k = 0; k < segments.size(); ++k) all.push_back(static_cast<std::int32_t>(k));
  std::vector<Eigen::Vector3d> points;
  std::vector<std::int32_t> segment_of;
  const std::size_t stride = 1 + points_W.size() / kPoints;
  for (std::size_t i = 0; i < points_W.size(); i += stride) {
    const Eigen::Vector3d& p = points_W[i];
    const auto near = pipeline::NearestSegment(p, frames, all);
    if (std::abs(near.distance_mm - truth.pipe_radius_mm) > 5.0 * noise_mm + systematic_mm)
      continue;
    points.push_back(p);
    segment_of.push_back(near.segment);
  }

  const pipeline::TubeParameters parameters(truth, true);
  const Eigen::VectorXd at = parameters.Initial();
  Eigen::MatrixXd jacobian(static_cast<Eigen::Index>(points.size()), parameters.size());
  for (int k = 0; k < parameters.size(); ++k) {
    Eigen::VectorXd more = at, less = at;
    more[k] += kStep;
    less[k] -= kStep;
    jacobian.col(k) = (Distances(parameters.TubeAt(more), points, segment_of) -
                       Distances(parameters.TubeAt(less), points, segment_of)) /
                      (2.0 * kStep);
  }
  const Eigen::MatrixXd information = jacobian.transpose() * jacobian;
  Eigen::VectorXd scale = information.diagonal().cwiseSqrt().cwiseInverse();
  const Eigen::MatrixXd scaled = scale.asDiagonal() * information * scale.asDiagonal();
  const Eigen::MatrixXd covariance =
      scaled.ldlt().solve(Eigen::MatrixXd::Identity(parameters.size(), parameters.size()));
  const Eigen::VectorXd sigma = noise_mm / std::sqrt(static_cast<double>(stride)) *
                                (scale.array().square() * covariance.diagonal().array()).sqrt();

  Bound bound{truth.program, sigma[parameters.pipe_radius()]};
  for (std::size_t i = 0; i < bound.program.rows.size(); ++i) {
    hal::BendRow& row = bound.program.rows[i];
    row = {0, 0, 0, std::nullopt};
    if (i >= parameters.bends()) continue;
    if (i > 0) {
      row.length_mm = sigma[parameters.length(i)];
      row.rotation_deg = sigma[parameters.rotation(i)] * kDegrees;
    }
    row.angle_deg = sigma[parameters.angle(i)] * kDegrees;
    row.bend_radius_mm = sigma[parameters.bend_radius(i)];
  }
  return bound;
}

}  // namespace bendloop::bench
