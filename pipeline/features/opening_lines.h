// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

#include "pipeline/points/sensor_direction.h"

namespace bendloop::pipeline {

// A sample of the wall about a place, in the plane across the outward direction there: x goes along
// the tube, y round it.
struct WallSample {
  Eigen::Vector2d place_mm = Eigen::Vector2d::Zero();
  SensorDirection to_sensor;  // with its pass
};

// Where rays of a pass met no wall, though its lines meet it on both sides: in a narrow strip along
// the tube the lines of a pass follow each other evenly, but for whole lines that are missing
// between two others. So these places are in a hole, or hidden.
struct MissedRays {
  Eigen::Vector3d to_sensor = Eigen::Vector3d::UnitZ();  // in W, about unit
  std::vector<Eigen::Vector2d> places_mm;
  double sideways_sigma_mm = 0;  // 1 sigma of their y: a ray may be anywhere in its strip
};
// Of each pass that comes in lines. `outward`, `sideways`: directions of the plane's normal and of
// y in W. Places where the sensor looks along the wall are left out.
std::vector<MissedRays> FindMissed(std::span<const WallSample> wall, double pipe_radius_mm,
                                   const Eigen::Vector3d& outward, const Eigen::Vector3d& sideways);

}  // namespace bendloop::pipeline
