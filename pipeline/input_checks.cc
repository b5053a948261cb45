// SPDX-License-Identifier: Apache-2.0
#include "pipeline/input_checks.h"

#include <Eigen/Dense>
#include <sstream>

namespace bendloop::pipeline {
namespace {

// Thinner and thicker pipes are not bent by machines.
constexpr double kMinRadiusMm = 0.2;
constexpr double kMaxRadiusMm = 300.0;

}  // namespace

std::string Mm(double value) {
  std::ostringstream text;
  text.precision(4);
  text << value << " mm";
  return text.str();
}

hal::Result<void> CheckShape(std::span<const Eigen::Vector3d> points) {
  using hal::ErrorKind;
  if (points.size() < kMinPoints) {
    return hal::Fail(ErrorKind::kBadInput, "too few points: found " +
                                               std::to_string(points.size()) + ", a tube needs " +
                                               std::to_string(kMinPoints) + " at least");
  }
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (const Eigen::Vector3d& p : points) mean += p;
  mean /= static_cast<double>(points.size());
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
  for (const Eigen::Vector3d& p : points) covariance += (p - mean) * (p - mean).transpose();
  // Not computeDirect(): its rounding passes for a spread of 1e-4 of the longest.
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen(
      covariance / static_cast<double>(points.size()), Eigen::EigenvaluesOnly);
  const Eigen::Vector3d spread = eigen.eigenvalues().cwiseMax(0.0).cwiseSqrt();
  if (!(spread[2] > 1e-9)) {
    return hal::Fail(ErrorKind::kBadInput,
                     "all points are at one place; expected a tube's surface");
  }
  if (spread[1] < 1e-6 * spread[2]) {
    return hal::Fail(ErrorKind::kBadInput, "all points lie on a line; expected a tube's surface");
  }
  if (spread[0] < 1e-6 * spread[2]) {
    return hal::Fail(ErrorKind::kBadInput,
                     "all points lie on a plane; expected the curved surface of a tube");
  }
  return {};
}

hal::Result<void> CheckUnits(double radius_mm) {
  if (radius_mm > kMaxRadiusMm) {
    return hal::Fail(hal::ErrorKind::kBadInput,
                     "the pipe radius would be " + Mm(radius_mm) +
                         ", which no bending machine takes: are the units wrong? (--units; "
                         "expected " +
                         Mm(kMinRadiusMm) + " to " + Mm(kMaxRadiusMm) + ")");
  }
  if (radius_mm < kMinRadiusMm) {
    return hal::Fail(hal::ErrorKind::kBadInput,
                     "the pipe radius would be " + Mm(radius_mm) +
                         ": are the points in metres or inches? (--units m or --units in; "
                         "expected " +
                         Mm(kMinRadiusMm) + " to " + Mm(kMaxRadiusMm) + ")");
  }
  return {};
}

}  // namespace bendloop::pipeline
