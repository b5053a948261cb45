// SPDX-License-Identifier: Apache-2.0
#include "pipeline/points/input_checks.h"

#include <Eigen/Dense>
#include <sstream>

namespace bendloop::pipeline {
namespace {

// Thinner and thicker pipes are not bent by machines.
constexpr double kMinRadiusMm = 0.2;
constexpr double kMaxRadiusMm = 300.0;

constexpr std::size_t kShapePoints = 20'000;  // of many so many tell, unless they say no

// What keeps every `stride`-th of the points from being a surface; nothing: null.
const char* Flatness(std::span<const Eigen::Vector3d> points, std::size_t stride) {
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  double count = 0;
  for (std::size_t i = 0; i < points.size(); i += stride, ++count) mean += points[i];
  mean /= count;
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
  for (std::size_t i = 0; i < points.size(); i += stride) {
    covariance += (points[i] - mean) * (points[i] - mean).transpose();
  }
  // Not computeDirect(): its rounding passes for a spread of 1e-4 of the longest.
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen(covariance / count,
                                                             Eigen::EigenvaluesOnly);
  const Eigen::Vector3d spread = eigen.eigenvalues().cwiseMax(0.0).cwiseSqrt();
  if (!(spread[2] > 1e-9)) return "all points are at one place; expected a tube's surface";
  if (spread[1] < 1e-6 * spread[2]) return "all points lie on a line; expected a tube's surface";
  if (spread[0] < 1e-6 * spread[2]) {
    return "all points lie on a plane; expected the curved surface of a tube";
  }
  return nullptr;
}

}  // namespace

bool IsPlace(const Eigen::Vector3d& point_mm) {
  constexpr double kFurthestMm = 1e7;
  return (point_mm.array().abs() < kFurthestMm).all();
}

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
  const char* flaw = Flatness(points, points.size() / kShapePoints + 1);
  if (flaw && points.size() > kShapePoints) flaw = Flatness(points, 1);
  if (flaw) return hal::Fail(ErrorKind::kBadInput, flaw);
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
