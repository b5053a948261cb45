// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/sides.h"

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <cmath>
#include <cstddef>
#include <numbers>

namespace bendloop::pipeline {
namespace {

constexpr double kLeastPoints = 5;
constexpr double kFitted = 3, kLeastSides = 6;  // numbers, and sides that tell more than these

}  // namespace

std::optional<double> BeyondNoiseMm2(std::span<const SideMean> sides) {
  const auto of = [&sides](std::size_t side) {
    const double turn = (static_cast<double>(side) + 0.5) * 2.0 * std::numbers::pi /
                        static_cast<double>(sides.size());
    return Eigen::Vector3d(1.0, std::cos(turn), std::sin(turn));
  };
  // Mean, cosine and sine of the sides' means, by least squares.
  Eigen::Matrix3d matrix = Eigen::Matrix3d::Identity() * 1e-9;
  Eigen::Vector3d right = Eigen::Vector3d::Zero();
  for (std::size_t i = 0; i < sides.size(); ++i) {
    matrix += sides[i].points * of(i) * of(i).transpose();
    right += sides[i].points * sides[i].mean_mm * of(i);
  }
  const Eigen::Vector3d across = matrix.ldlt().solve(right);
  double beyond_mm2 = 0, telling = 0;
  for (std::size_t i = 0; i < sides.size(); ++i) {
    if (sides[i].points < kLeastPoints) continue;
    beyond_mm2 += std::pow(sides[i].mean_mm - across.dot(of(i)), 2) - sides[i].noise_mm2;
    telling += 1;
  }
  if (telling < kLeastSides) return std::nullopt;
  return beyond_mm2 / (telling - kFitted);
}

}  // namespace bendloop::pipeline
