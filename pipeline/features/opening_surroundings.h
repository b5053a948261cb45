// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <vector>

#include "hal/spine.h"
#include "hal/tube_features.h"
#include "pipeline/features/opening_border.h"
#include "pipeline/fit/surface_points.h"
#include "pipeline/points/sensor_direction.h"

namespace bendloop::pipeline {

// A sample of the wall whose sensor's direction is known.
struct SeenWall {
  Eigen::Vector3d point_mm = Eigen::Vector3d::Zero();
  Eigen::Vector2d place_mm = Eigen::Vector2d::Zero();  // in the plane
  SensorDirection to_sensor;
  std::int32_t segment = 0;  // of the spine, the nearest
  double sigmas_below = 0;   // the wall that most samples lie on
};

// What lies about a place, in the plane across the outward direction there: x goes along the tube,
// y as `frame.sideways()` does.
struct Surroundings {
  std::vector<Eigen::Vector2d> wall;  // samples of the surface
  std::vector<double> sigmas_below;   // of each, the wall that most of them lie on
  std::vector<SeenWall> seen;         // of these; all or some
  std::vector<Eigen::Vector2d> all;   // of the wall, those that may be of the face as well
  // These, and whatever else may hide it or shows that something is there; of each, how far below
  // the wall that most of them lie on.
  std::vector<Eigen::Vector2d> present;
  std::vector<double> present_below;  // [sigma]
  // What lies below the wall: something in an opening, or what its cut left and the bore behind.
  std::vector<Eigen::Vector2d> below;

  // Without the samples that may be of the face that the drill left of the wall. It lies below the
  // surface, along the border of `about` or `beside_mm` further at most; what noise alone may have
  // put as low stays among `seen`, as those whose rays met the wall or its face.
  // All, where nothing says that the face is seen.
  Surroundings WithoutFace(const OpeningBorder& about, double beside_mm) const;

 private:
  bool ShowsFace(const OpeningBorder& about, double beside_mm) const;
};
// What the passes of a scan tell of an opening.
struct PassSurroundings {
  bool are_known = false;  // its samples' passes
  bool has_lines = false;  // some pass comes in lines
  // Where their rays met no wall, and no other part of the tube hides it.
  std::vector<MissedPlace> missed;
  std::vector<double> cell_mm2;  // of each: the wall that it stands for
  // Samples of the wall that tell of the border: those whose rays would be known had they missed
  // it. Of others only those that met it are known, which would make any opening small. None: of
  // what is roughly the border hardly anything was looked through.
  std::vector<Eigen::Vector2d> fair;
  // Samples of the wall that come scattered, by passes that looked through the opening; where
  // passes are not known all samples. And the part of its area that these passes looked through.
  std::vector<Eigen::Vector2d> scattered;
  double scattered_part = 0;

  // Of the area in such a border, what they looked through.
  double PartThrough(const OpeningBorder& border) const;
};

// A tube with its points, looked at place by place. Another object holds what the spans show.
struct LookedAtTube {
  double pipe_radius_mm = 0, noise_mm = 0;  // noise: 1 sigma of the points
  std::span<const hal::SpineSegment> segments;
  std::span<const SegmentFrame> frames;  // of these
  std::span<const PointBlock> blocks;

  // Those that the wall about a place belongs to, as far as `reach_mm` from it; others are other
  // parts of the tube.
  std::vector<std::int32_t> SegmentsAbout(const hal::SurfaceFrame& frame, double reach_mm) const;
  // `wall_mm`: samples of the wall lie so near to the surface.
  Surroundings LookAt(const hal::SurfaceFrame& frame, double reach_mm, double wall_mm) const;
  // `about`: where the opening is about.
  PassSurroundings FindPasses(const hal::SurfaceFrame& frame, const Surroundings& around,
                              const OpeningBorder& about) const;

 private:
  // Where the ray of a sample met the wall: noise moves samples along their rays, and those that
  // come in flat further along the wall than off it. A ray that is flatter than kLeastRayCosine
  // tells nothing.
  Eigen::Vector3d OnItsRay(const Eigen::Vector3d& point, SensorDirection to_sensor,
                           std::int32_t segment) const;
};

}  // namespace bendloop::pipeline
