// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <random>
#include <vector>

#include "hal/tube.h"

namespace bendloop::tests {

struct CloudOptions {
  std::size_t points = 6005;
  double noise_mm = 0.05;  // along the surface normal
  double fliers = 0;       // part of the points that lies anywhere around the tube
  std::optional<Eigen::Vector3d> view_W =
      std::nullopt;             // unit, towards the sensor; empty: all round
  double stripes_mm = 0;        // > 0: points lie on planes across the spine, so far apart
  double first_stripe_mm = 0;   // from the tube's start
  double stripe_tilt = 0;       // tangent of the angle of the planes to the cross-section
  double profile_error_mm = 0;  // 1 sigma an axis: each stripe is displaced as a whole
  double ovality = 0;           // (max - min) / nominal diameter at the middle of a bend
};

// Points spread evenly over the surface of `tube`, in random order.
std::vector<Eigen::Vector3d> SyntheticCloud(const hal::Tube& tube, const CloudOptions& options,
                                            std::mt19937_64& random);

struct RandomTubeOptions {
  double pipe_radius_mm = 4;
  int bends = 4;
  double min_bend_radius = 2.0;  // of the pipe radius
  double max_bend_radius = 5.0;
  double min_straight = 3.0;  // of the pipe radius
  double max_straight = 20.0;
  double min_angle_deg = 10;
  double max_angle_deg = 120;
  bool one_bend_radius = true;
};

// A random tube that does not touch itself, in a random pose.
hal::Tube RandomTube(const RandomTubeOptions& options, std::mt19937_64& random);

// True where two parts of the tube, not neighbours along it, are nearer than 3 pipe radii.
bool TouchesItself(const hal::Tube& tube);

// A random unit quaternion and a position within +-`range_mm`.
hal::Pose RandomPose(double range_mm, std::mt19937_64& random);

// The four-bend tube of the paper's figure 3: pipe radius 4 mm, 268 mm long.
hal::Tube PaperTube();

}  // namespace bendloop::tests
