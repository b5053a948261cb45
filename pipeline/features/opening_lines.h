// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

#include "pipeline/points/sensor_direction.h"

namespace bendloop::pipeline {

// A sample of the wall about a place, unrolled (unrolled_wall.h): in bends, too, lines are one
// behind the other there.
struct WallSample {
  Eigen::Vector2d place_mm = Eigen::Vector2d::Zero();
  SensorDirection to_sensor;  // with its pass
};

inline Eigen::Vector3d TowardsSensor(SensorDirection packed) {
  const UnpackedDirection direction = UnpackDirection(packed);
  return {direction.x, direction.y, direction.z};
}

// A ray of a laser line that met no wall, though its neighbours in the line did, or those of the
// lines before and behind at its side of the tube: it went through a hole, or is hidden.
struct MissedRay {
  Eigen::Vector2d place_mm = Eigen::Vector2d::Zero();  // where it would have met it
  double sideways_sigma_mm = 0;                        // 1 sigma of its y
  double cell_mm2 = 0;                                 // of the wall there is a ray for each
  SensorDirection to_sensor;                           // with its pass, of the ray next to it
};
struct MissedRays {
  std::vector<MissedRay> rays;
  // Passes that do not come in lines of even rays: what is kept of a thinned scan, or what never
  // did.
  std::vector<unsigned> scattered;
  bool has_lines = false;  // some pass does
};
// Of all passes that come in lines across the tube. `noise_mm`: 1 sigma of the points; `outward`,
// `sideways`: directions of the wall's normal at the place and of y in W. Rays that come in flat
// along the wall are left out.
constexpr double kLeastRayCosine = 0.35;  // to the wall's normal; flatter ones may return nothing
MissedRays FindMissed(std::span<const WallSample> wall, double pipe_radius_mm, double noise_mm,
                      const Eigen::Vector3d& outward, const Eigen::Vector3d& sideways);

}  // namespace bendloop::pipeline
