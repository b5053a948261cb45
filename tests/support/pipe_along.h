// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <functional>

#include "tests/support/shapes.h"

// Pipes along spines that no bender makes, and such as have no ends.
namespace bendloop::tests {

struct FreeSpine {
  std::function<Eigen::Vector3d(double)> at_mm;  // by its own parameter, about evenly
  double from = 0, to = 1;
};

// About the z axis; `pitch_mm` 0 and one turn: a ring.
inline FreeSpine Helix(double radius_mm, double pitch_mm, double turns) {
  return {[=](double turn) {
            return Eigen::Vector3d(radius_mm * std::cos(2 * kPi * turn),
                                   radius_mm * std::sin(2 * kPi * turn), pitch_mm * turn);
          },
          0, turns};
}

inline Points PipeAlong(const FreeSpine& spine, double pipe_radius_mm, std::size_t count,
                        double noise_mm, Random& random) {
  std::normal_distribution<double> normal(0, noise_mm);
  const double step = 1e-4 * (spine.to - spine.from);
  Points points;
  for (std::size_t i = 0; i < count; ++i) {
    const double t = Uniform(random, spine.from, spine.to), around = Uniform(random, 0, 2 * kPi);
    const Eigen::Vector3d along = (spine.at_mm(t + step) - spine.at_mm(t - step)).normalized();
    const Eigen::Vector3d u = along.unitOrthogonal(), v = along.cross(u);
    points.push_back(spine.at_mm(t) + (pipe_radius_mm + normal(random)) *
                                          (std::cos(around) * u + std::sin(around) * v));
  }
  return points;
}

// A frame of four bends; its straight where it begins lacks `gap_mm`.
inline hal::Tube Frame(double side_mm, double bend_radius_mm, double pipe_radius_mm,
                       double gap_mm) {
  const double straight_mm = side_mm - 2 * bend_radius_mm;
  hal::Tube tube;
  tube.pipe_radius_mm = pipe_radius_mm;
  for (int i = 0; i < 4; ++i) tube.program.rows.push_back({straight_mm, 0, 90, bend_radius_mm});
  tube.program.rows.front().length_mm = 0.5 * (straight_mm - gap_mm);
  tube.program.rows.push_back({0.5 * (straight_mm - gap_mm), 0, 0, std::nullopt});
  return tube;
}

}  // namespace bendloop::tests
