// SPDX-License-Identifier: Apache-2.0
#include "pipeline/points/input_checks.h"

#include <Eigen/Dense>
#include <sstream>

namespace bendloop::pipeline {
namespace {

// What no tube goes beyond.
struct InputLimits {
  // [mm] Thinner and thicker pipes are not bent by machines.
  double least_radius_mm = 0.2;
  double most_radius_mm = 300.0;
  // Of many points so many tell the shape; where they say no, all are asked (by trial).
  std::size_t shape_points = 20'000;
  // [mm] All points at one place: less than the rounding of coordinates.
  double one_place_mm = 1e-9;
  // [of the longest spread] Thinner is a line or a plane: far less than any noise, well above what
  // rounding leaves.
  double flat = 1e-6;
};
constexpr InputLimits kLimits;

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
  if (!(spread[2] > kLimits.one_place_mm)) {
    return "all points are at one place; expected a tube's surface";
  }
  if (spread[1] < kLimits.flat * spread[2]) {
    return "all points lie on a line; expected a tube's surface";
  }
  if (spread[0] < kLimits.flat * spread[2]) {
    return "all points lie on a plane; expected the curved surface of a tube";
  }
  return nullptr;
}

}  // namespace

bool IsPlace(const Eigen::Vector3d& point_mm) {
  constexpr double kFurthestMm = 1e7;  // ten kilometres
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
  const char* flaw = Flatness(points, points.size() / kLimits.shape_points + 1);
  if (flaw && points.size() > kLimits.shape_points) flaw = Flatness(points, 1);
  if (flaw) return hal::Fail(ErrorKind::kBadInput, flaw);
  return {};
}

hal::Result<void> CheckUnits(double radius_mm) {
  if (radius_mm > kLimits.most_radius_mm) {
    return hal::Fail(hal::ErrorKind::kBadInput,
                     "the pipe radius would be " + Mm(radius_mm) +
                         ", which no bending machine takes: are the units wrong? (--units; "
                         "expected " +
                         Mm(kLimits.least_radius_mm) + " to " + Mm(kLimits.most_radius_mm) + ")");
  }
  if (radius_mm < kLimits.least_radius_mm) {
    return hal::Fail(hal::ErrorKind::kBadInput,
                     "the pipe radius would be " + Mm(radius_mm) +
                         ": are the points in metres or inches? (--units m or --units in; "
                         "expected " +
                         Mm(kLimits.least_radius_mm) + " to " + Mm(kLimits.most_radius_mm) + ")");
  }
  return {};
}

}  // namespace bendloop::pipeline
