// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/tube_parameters.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "pipeline/fit/surface_sums.h"

namespace bendloop::pipeline {
namespace {

constexpr double kDegrees = 180.0 / std::numbers::pi;
constexpr double kSlight = 0.5;  // rad
constexpr double kLeast = 1e-4;  // rad: a bend of nothing has no plane

}  // namespace

TubeParameters::TubeParameters(const hal::Tube& reference, bool free_pipe_radius,
                               std::span<const Flattening> flattening)
    : reference_(reference),
      flattening_(flattening.begin(), flattening.end()),
      bends_(reference.program.bend_count()) {
  size_ = 5;
  if (free_pipe_radius) pipe_radius_ = size_++;
  for (std::size_t i = 0; i < bends_; ++i) {
    first_bend_.push_back(size_);
    size_ += i == 0 ? 3 : 4;
  }
  first_flattening_ = size_;
  size_ += kFlatteningParameters * static_cast<int>(flattening_.size());
}

Eigen::VectorXd TubeParameters::Initial() const {
  Eigen::VectorXd parameters = Eigen::VectorXd::Zero(size_);
  if (pipe_radius_ >= 0) parameters[pipe_radius_] = reference_.pipe_radius_mm;
  for (std::size_t i = 0; i < bends_; ++i) {
    const hal::BendRow& row = reference_.program.rows[i];
    parameters[length(i)] = row.length_mm;
    if (i > 0) parameters[rotation(i)] = row.rotation_deg / kDegrees;
    parameters[angle(i)] = row.angle_deg / kDegrees;
    parameters[bend_radius(i)] = row.bend_radius_mm.value_or(0.0);
  }
  for (std::size_t i = 0; i < flattening_.size(); ++i) {
    const Flattening& f = flattening_[i];
    parameters.segment<kFlatteningParameters>(flattening(i)) << f.constant, f.bump, f.collapse;
  }
  return parameters;
}

std::vector<TubeParameters::Turn> TubeParameters::TurnsAt(const Eigen::VectorXd& parameters) const {
  std::vector<Turn> turns;
  double azimuth = parameters[2];
  for (std::size_t i = 0; i < bends_; ++i) {
    const hal::BendRow& row = reference_.program.rows[i];
    const double before = row.angle_deg / kDegrees;
    const double along = parameters[angle(i)];
    if (i > 0) azimuth += parameters[rotation(i)] - row.rotation_deg / kDegrees;
    if (before < kSlight) {
      const double across = before * azimuth;
      turns.push_back({std::max(kLeast, std::hypot(along, across)), std::atan2(across, along)});
    } else {
      turns.push_back(
          {std::max(kLeast, std::abs(along)), along < 0 ? azimuth + std::numbers::pi : azimuth});
    }
  }
  return turns;
}

hal::Tube TubeParameters::TubeAt(const Eigen::VectorXd& parameters) const {
  hal::Tube tube = reference_;
  const std::vector<Turn> turns = TurnsAt(parameters);
  const double roll = bends_ > 0 ? turns[0].azimuth_change : parameters[2];
  const Eigen::Quaterniond turn = Eigen::AngleAxisd(roll, Eigen::Vector3d::UnitX()) *
                                  Eigen::AngleAxisd(parameters[3], Eigen::Vector3d::UnitY()) *
                                  Eigen::AngleAxisd(parameters[4], Eigen::Vector3d::UnitZ());
  tube.X_WT.position_mm +=
      reference_.X_WT.orientation * Eigen::Vector3d(0, parameters[0], parameters[1]);
  tube.X_WT.orientation = (reference_.X_WT.orientation * turn).normalized();
  if (pipe_radius_ >= 0) tube.pipe_radius_mm = parameters[pipe_radius_];
  for (std::size_t i = 0; i < bends_; ++i) {
    hal::BendRow& row = tube.program.rows[i];
    row.length_mm = parameters[length(i)];
    if (i > 0) {
      const double change = turns[i].azimuth_change - turns[i - 1].azimuth_change;
      row.rotation_deg =
          hal::WrapRotationDeg(reference_.program.rows[i].rotation_deg + change * kDegrees);
    }
    row.angle_deg = turns[i].angle * kDegrees;
    row.bend_radius_mm = parameters[bend_radius(i)];
  }
  return tube;
}

std::vector<Flattening> TubeParameters::FlatteningAt(const Eigen::VectorXd& parameters) const {
  std::vector<Flattening> list;
  for (std::size_t i = 0; i < flattening_.size(); ++i) {
    const auto of_bend = parameters.segment<kFlatteningParameters>(flattening(i));
    list.push_back({of_bend[0], of_bend[1], of_bend[2]});
  }
  return list;
}

std::vector<Eigen::MatrixXd> TubeParameters::FrameDerivatives(
    const std::vector<hal::SpineSegment>& segments) const {
  // Each parameter moves everything after it as a rigid body: a velocity of the point at `pivot`
  // and an angular velocity.
  struct Twist {
    Eigen::Vector3d pivot = Eigen::Vector3d::Zero();
    Eigen::Vector3d velocity = Eigen::Vector3d::Zero();
    Eigen::Vector3d omega = Eigen::Vector3d::Zero();
  };
  std::vector<std::pair<int, Twist>> active;
  const Eigen::Matrix3d R = reference_.X_WT.orientation.toRotationMatrix();
  const Eigen::Vector3d start = segments.front().start_mm;
  active.push_back({0, {start, R.col(1), Eigen::Vector3d::Zero()}});
  active.push_back({1, {start, R.col(2), Eigen::Vector3d::Zero()}});
  active.push_back({2, {start, Eigen::Vector3d::Zero(), R.col(0)}});
  active.push_back({3, {start, Eigen::Vector3d::Zero(), R.col(1)}});
  active.push_back({4, {start, Eigen::Vector3d::Zero(), R.col(2)}});

  std::vector<Eigen::MatrixXd> derivatives;
  derivatives.reserve(segments.size());
  for (std::size_t k = 0; k < segments.size(); ++k) {
    const hal::SpineSegment& segment = segments[k];
    const std::size_t bend = k / 2;
    const bool is_straight = k % 2 == 0;
    if (is_straight && bend > 0 && bend < bends_) {
      active.push_back(
          {rotation(bend), {segment.start_mm, Eigen::Vector3d::Zero(), segment.tangent}});
    }
    Eigen::MatrixXd& derivative =
        derivatives.emplace_back(Eigen::MatrixXd::Zero(kLocalState, size_));
    const Eigen::Matrix3d to_local = segment.axes().transpose();
    for (const auto& [column, twist] : active) {
      derivative.block<3, 1>(0, column) =
          to_local * (twist.velocity + twist.omega.cross(segment.start_mm - twist.pivot));
      derivative.block<3, 1>(3, column) = to_local * twist.omega;
    }
    if (pipe_radius_ >= 0) derivative(kPipeRadiusState, pipe_radius_) = 1.0;
    if (is_straight) {
      if (bend < bends_) {
        active.push_back(
            {length(bend), {segment.start_mm, segment.tangent, Eigen::Vector3d::Zero()}});
      }
    } else {
      derivative(6, bend_radius(bend)) = 1.0;
      if (flattened()) {
        derivative.block<kFlatteningParameters, kFlatteningParameters>(
            kFlatteningState, flattening(bend)) = Eigen::Matrix3d::Identity();
      }
      const double a = segment.angle_rad();
      const Eigen::Vector3d inward = segment.normal.cross(segment.tangent);
      const double bend_mm = segment.bend_radius_mm;
      active.push_back(
          {angle(bend),
           {segment.start_mm + bend_mm * inward, Eigen::Vector3d::Zero(), segment.normal}});
      active.push_back(
          {bend_radius(bend),
           {segment.start_mm, std::sin(a) * segment.tangent + (1.0 - std::cos(a)) * inward,
            Eigen::Vector3d::Zero()}});
    }
  }
  return derivatives;
}

}  // namespace bendloop::pipeline
