// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <random>
#include <vector>

#include "hal/spine.h"
#include "hal/tube.h"

namespace bendloop::drivers {

inline hal::Tube RandomTube(std::mt19937_64& engine, int bends) {
  const auto number = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(engine);
  };
  hal::Tube tube;
  tube.pipe_radius_mm = number(3, 25);
  for (int i = 0; i < bends; ++i) {
    tube.program.rows.push_back(
        {number(20, 150), number(-180, 180), number(5, 220), tube.pipe_radius_mm * number(1.1, 5)});
  }
  tube.program.rows.push_back({number(20, 150), 0, 0, std::nullopt});
  tube.X_WT.position_mm = {number(-500, 500), number(-500, 500), number(-500, 500)};
  tube.X_WT.orientation =
      Eigen::Quaterniond(number(-1, 1), number(-1, 1), number(-1, 1), number(-1, 1)).normalized();
  return tube;
}

// The nearest point of the spine among those whose foot is inside a segment (an open end has no
// round cap), found apart from the code under test.
struct Foot {
  double distance_mm = std::numeric_limits<double>::infinity();
  double along_mm = 0;
  Eigen::Vector3d point_mm = Eigen::Vector3d::Zero();
};

inline Foot NearestFoot(const std::vector<hal::SpineSegment>& spine, const Eigen::Vector3d& p) {
  Foot nearest;
  for (const hal::SpineSegment& segment : spine) {
    double along = (p - segment.start_mm).dot(segment.tangent);
    if (segment.is_arc()) {
      const Eigen::Vector3d from_center = p - segment.center_mm();
      const Eigen::Vector3d inward = segment.normal.cross(segment.tangent);
      double phi = std::atan2(from_center.dot(segment.tangent), -from_center.dot(inward));
      // The nearer end where the foot is off the arc.
      if (phi < -1e-9) phi += 2 * std::numbers::pi;
      along = phi * segment.bend_radius_mm;
    }
    if (along < -1e-9 || along > segment.length_mm + 1e-9) continue;
    const Eigen::Vector3d foot = segment.PointAt(along);
    if ((p - foot).norm() < nearest.distance_mm) {
      nearest = {(p - foot).norm(), segment.from_start_mm + along, foot};
    }
  }
  return nearest;
}

}  // namespace bendloop::drivers
