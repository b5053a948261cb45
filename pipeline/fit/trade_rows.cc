// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/trade_rows.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <vector>

#include "hal/angles.h"
#include "hal/spine.h"
#include "pipeline/math/dense_solve.h"

namespace bendloop::pipeline {
namespace {

constexpr int kPose = 5;       // numbers of where the tube lies
constexpr int kPoseSteps = 3;  // the turns are small: the second hardly moves anything

// Of rows alone; the pose stays as `numbers` has it.
Eigen::VectorXd RowNumbers(const TubeParameters& parameters, const hal::Tube& reference,
                           std::span<const SpineLine> lines, const Eigen::VectorXd& numbers) {
  Eigen::VectorXd to = numbers;
  // Where a line has its corners, along it from its point; the first from the tube's start.
  std::vector<double> before_mm(lines.size(), 0.0), after_mm(lines.size(), 0.0);
  before_mm[0] = (reference.X_WT.position_mm - lines[0].point_mm).dot(lines[0].direction);
  Eigen::Vector3d last_normal = Eigen::Vector3d::Zero();
  std::vector<double> tangent_mm(lines.size() + 1, 0.0);
  for (std::size_t i = 0; i + 1 < lines.size(); ++i) {
    const SpineLine &a = lines[i], &b = lines[i + 1];
    Eigen::Vector3d normal = a.direction.cross(b.direction);
    after_mm[i] = CornerAlongMm(a, b);
    before_mm[i + 1] = CornerAlongMm(b, a);
    const double angle = std::atan2(normal.norm(), a.direction.dot(b.direction));
    normal.normalize();
    to[parameters.angle(i)] = angle;
    tangent_mm[i + 1] = to[parameters.bend_radius(i)] * std::tan(0.5 * angle);
    if (i > 0) {
      const double rotation =
          std::atan2(last_normal.cross(normal).dot(a.direction), last_normal.dot(normal));
      double& at = to[parameters.rotation(i)];
      at += std::remainder(rotation - at, 2.0 * std::numbers::pi);
    }
    last_normal = normal;
  }
  for (std::size_t i = 0; i + 1 < lines.size(); ++i) {
    to[parameters.length(i)] = after_mm[i] - before_mm[i] - tangent_mm[i] - tangent_mm[i + 1];
  }
  return to;
}

// Both ends of every straight.
std::vector<std::array<Eigen::Vector3d, 2>> EndsOf(const hal::Tube& tube) {
  const auto segments = hal::SpineSegments(tube.program, tube.X_WT);
  std::vector<std::array<Eigen::Vector3d, 2>> ends;
  for (std::size_t k = 0; k < segments.size(); k += 2) {
    ends.push_back({segments[k].start_mm, segments[k].PointAt(segments[k].length_mm)});
  }
  return ends;
}

Eigen::Vector3d Beside(const SpineLine& line, const Eigen::Vector3d& place_mm) {
  const Eigen::Vector3d off_mm = place_mm - line.point_mm;
  return off_mm - off_mm.dot(line.direction) * line.direction;
}

}  // namespace

double CornerAlongMm(const SpineLine& line, const SpineLine& other) {
  const Eigen::Vector3d normal = line.direction.cross(other.direction);
  const Eigen::Vector3d between_mm = other.point_mm - line.point_mm;
  return between_mm.cross(other.direction).dot(normal) / std::max(1e-30, normal.squaredNorm());
}

Eigen::VectorXd TradeNumbers(const TubeParameters& parameters, const hal::Tube& reference,
                             std::span<const SpineLine> lines, const Eigen::VectorXd& numbers) {
  Eigen::VectorXd to = RowNumbers(parameters, reference, lines, numbers);
  to.head<kPose>().setZero();
  for (int step = 0; step < kPoseSteps; ++step) {
    const hal::Tube tube = TradeTube(parameters, reference, to);
    const Eigen::Matrix3d axes = tube.X_WT.orientation.toRotationMatrix();
    Eigen::Matrix<double, kPose, kPose> left = Eigen::Matrix<double, kPose, kPose>::Zero();
    Eigen::Matrix<double, kPose, 1> right = Eigen::Matrix<double, kPose, 1>::Zero();
    const auto ends = EndsOf(tube);
    for (std::size_t i = 0; i < ends.size(); ++i) {
      const Eigen::Vector3d& along = lines[i].direction;
      for (const Eigen::Vector3d& end : ends[i]) {
        const Eigen::Vector3d arm = end - tube.X_WT.position_mm;
        Eigen::Matrix<double, 3, kPose> moves;
        moves << axes.col(1), axes.col(2), axes.col(0).cross(arm), axes.col(1).cross(arm),
            axes.col(2).cross(arm);
        moves -= along * (along.transpose() * moves);
        left += moves.transpose() * moves;
        right -= moves.transpose() * Beside(lines[i], end);
      }
    }
    to.head<kPose>() += SolveSymmetric(left, right);
  }
  return to;
}

hal::Tube TradeTube(const TubeParameters& parameters, const hal::Tube& reference,
                    const Eigen::VectorXd& numbers) {
  hal::Tube tube = reference;
  const Eigen::Quaterniond& axes = reference.X_WT.orientation;
  const Eigen::Quaterniond turn = Eigen::AngleAxisd(numbers[2], Eigen::Vector3d::UnitX()) *
                                  Eigen::AngleAxisd(numbers[3], Eigen::Vector3d::UnitY()) *
                                  Eigen::AngleAxisd(numbers[4], Eigen::Vector3d::UnitZ());
  tube.X_WT.position_mm += axes * Eigen::Vector3d(0, numbers[0], numbers[1]);
  tube.X_WT.orientation = (axes * turn).normalized();
  if (parameters.pipe_radius() >= 0) tube.pipe_radius_mm = numbers[parameters.pipe_radius()];
  for (std::size_t i = 0; i < parameters.bends(); ++i) {
    hal::BendRow& row = tube.program.rows[i];
    row.length_mm = numbers[parameters.length(i)];
    if (i > 0) {
      row.rotation_deg =
          hal::WrapRotationDeg(numbers[parameters.rotation(i)] * hal::kDegreesPerRadian);
    }
    row.angle_deg = numbers[parameters.angle(i)] * hal::kDegreesPerRadian;
    row.bend_radius_mm = numbers[parameters.bend_radius(i)];
  }
  return tube;
}

double FarthestEndMm(const hal::Tube& tube, std::span<const SpineLine> lines) {
  double most_mm = 0;
  const auto ends = EndsOf(tube);
  for (std::size_t i = 0; i < ends.size(); ++i) {
    for (const Eigen::Vector3d& end : ends[i]) {
      most_mm = std::max(most_mm, Beside(lines[i], end).norm());
    }
  }
  return most_mm;
}

}  // namespace bendloop::pipeline
