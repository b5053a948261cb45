// SPDX-License-Identifier: Apache-2.0
#include "pipeline/tube/alignment.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "hal/spine.h"

namespace bendloop::pipeline {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

}  // namespace

Alignment BestFit(std::span<const Vector3d> measured_W, std::span<const Vector3d> nominal_N,
                  std::span<const double> weights) {
  Alignment alignment;
  const std::size_t count = std::min({measured_W.size(), nominal_N.size(), weights.size()});
  double sum = 0;
  Vector3d mean_W = Vector3d::Zero();
  Vector3d mean_N = Vector3d::Zero();
  for (std::size_t i = 0; i < count; ++i) {
    sum += weights[i];
    mean_W += weights[i] * measured_W[i];
    mean_N += weights[i] * nominal_N[i];
  }
  if (!(sum > 0)) return alignment;
  mean_W /= sum;
  mean_N /= sum;
  Matrix3d covariance = Matrix3d::Zero();
  for (std::size_t i = 0; i < count; ++i) {
    covariance += weights[i] / sum * (nominal_N[i] - mean_N) * (measured_W[i] - mean_W).transpose();
  }
  const Eigen::JacobiSVD<Matrix3d> svd(covariance, Eigen::ComputeFullU | Eigen::ComputeFullV);
  // A reflection would fit a mirrored part; only rotations move a real one.
  Vector3d sign = Vector3d::Ones();
  if (svd.matrixU().determinant() * svd.matrixV().determinant() < 0) sign.z() = -1;
  const Matrix3d R_NW = svd.matrixU() * sign.asDiagonal() * svd.matrixV().transpose();
  alignment.X_NW.orientation = Eigen::Quaterniond(R_NW).normalized();
  alignment.X_NW.position_mm = mean_N - alignment.X_NW.orientation * mean_W;
  double squares = 0;
  for (std::size_t i = 0; i < count; ++i) {
    const double distance = (alignment.X_NW * measured_W[i] - nominal_N[i]).norm();
    squares += weights[i] * distance * distance;
    if (weights[i] > 0) alignment.max_mm = std::max(alignment.max_mm, distance);
  }
  alignment.rms_mm = std::sqrt(squares / sum);
  return alignment;
}

Alignment AlignTubes(const hal::BendProgram& nominal, const hal::Tube& measured) {
  const auto segments_N = hal::SpineSegments(nominal, {});
  const auto segments_W = hal::SpineSegments(measured.program, measured.X_WT);
  const std::size_t count = std::min(segments_N.size(), segments_W.size());
  constexpr int kPointsPerSegment = 8;  // an arc of 180 degrees every 22 degrees (by trial)
  std::vector<Vector3d> points_N;
  std::vector<Vector3d> points_W;
  std::vector<double> weights;
  for (std::size_t k = 0; k < count; ++k) {
    const double length_N = segments_N[k].length_mm;
    const double length_W = segments_W[k].length_mm;
    const bool first = k == 0 && count > 1;
    const bool last = k + 1 == count && count > 1;
    const double common = std::min(length_N, length_W);
    for (int j = 0; j < kPointsPerSegment; ++j) {
      const double part = (j + 0.5) / kPointsPerSegment;
      // End straights count from their tangent point, all others in parts of their own length.
      const double along_N = first  ? length_N - part * common
                             : last ? part * common
                                    : part * length_N;
      const double along_W = first  ? length_W - part * common
                             : last ? part * common
                                    : part * length_W;
      points_N.push_back(segments_N[k].PointAt(along_N));
      points_W.push_back(segments_W[k].PointAt(along_W));
      weights.push_back((first || last ? common : length_N) / kPointsPerSegment);
    }
  }
  return BestFit(points_W, points_N, weights);
}

std::vector<Vector3d> Knots(const hal::BendProgram& program, const hal::Pose& X_WT) {
  std::vector<Vector3d> knots;
  const auto segments = hal::SpineSegments(program, X_WT);
  knots.reserve(segments.size() + 1);
  for (const hal::SpineSegment& segment : segments) knots.push_back(segment.start_mm);
  if (!segments.empty()) knots.push_back(segments.back().PointAt(segments.back().length_mm));
  return knots;
}

}  // namespace bendloop::pipeline
