// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <numbers>
#include <random>
#include <vector>

#include "tests/support/border_shapes.h"

// A barrel like a screwdriver's handle, with grooves along it that run out at both ends. Lengths in
// mm, axis z.
namespace bendloop::tests {

struct GroovedHandle {
  double length_mm = 100, radius_mm = 12, barrel_mm = 1.5;
  int grooves = 6;
  double groove_length_mm = 60, groove_depth_mm = 2.2, cutter_radius_mm = 4;

  double RadiusAt(double z) const {
    const double s = (z - 0.5 * length_mm) / (0.5 * length_mm);
    return radius_mm + barrel_mm * (1 - s * s);
  }
  // Distance of the cutter's middle from the axis; the body's radius and more where it is clear.
  double CutterAt(double z) const {
    const double s = (z - 0.5 * length_mm) / (0.5 * groove_length_mm);
    return RadiusAt(z) + cutter_radius_mm - groove_depth_mm * (1 - s * s);
  }
  // [rad] Half the angle that a groove takes at z; 0 where there is none.
  double HalfWidthAt(double z) const {
    const double R = RadiusAt(z), D = CutterAt(z), c = cutter_radius_mm;
    if (D >= R + c) return 0;
    return std::acos((R * R + D * D - c * c) / (2 * R * D));
  }
  double SurfaceAt(double angle, double z) const {
    const double pitch = 2 * std::numbers::pi / grooves;
    const double a = angle - pitch * std::round(angle / pitch);
    const double D = CutterAt(z), c = cutter_radius_mm, across = D * std::sin(a);
    if (std::abs(a) >= HalfWidthAt(z) || std::abs(across) >= c) return RadiusAt(z);
    return D * std::cos(a) - std::sqrt(c * c - across * across);
  }
  // The exact border of the groove at angle 0, t from 0 to 1.
  BorderShape Border() const {
    return [handle = *this](double t) {
      // Even in the angle of an ellipse, so that both ends are gone round.
      const double a = 2 * std::numbers::pi * t;
      const double z = 0.5 * handle.length_mm - 0.5 * handle.groove_length_mm * std::cos(a);
      const double angle = std::copysign(handle.HalfWidthAt(z), std::sin(a)),
                   R = handle.RadiusAt(z);
      return Eigen::Vector3d(R * std::cos(angle), R * std::sin(angle), z);
    };
  }
  std::vector<Eigen::Vector3d> Scan(std::size_t points, double noise_mm, unsigned seed) const {
    std::mt19937_64 random(seed);
    std::uniform_real_distribution<double> turn(-std::numbers::pi, std::numbers::pi);
    std::uniform_real_distribution<double> along(0, length_mm);
    std::normal_distribution<double> normal(0, noise_mm > 0 ? noise_mm : 1);
    std::vector<Eigen::Vector3d> cloud;
    for (std::size_t i = 0; i < points; ++i) {
      const double a = turn(random), z = along(random), r = SurfaceAt(a, z);
      Eigen::Vector3d place(r * std::cos(a), r * std::sin(a), z);
      if (noise_mm > 0) place += Eigen::Vector3d(normal(random), normal(random), normal(random));
      cloud.push_back(place);
    }
    return cloud;
  }
};

}  // namespace bendloop::tests
