// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "drivers/simulated_scanner/scan_path.h"
#include "drivers/simulated_scanner/scene.h"
#include "hal/laser_profile.h"
#include "hal/scan_event.h"
#include "hal/tube.h"
#include "hal/tube_features.h"

namespace bendloop::drivers {

// What stands around the part.
struct Clutter {
  bool table = false;        // a plane below the part
  double table_gap_mm = 0;   // the part lies on posts, this far above it; 0: it touches
  int clamps = 0;            // blocks around the part in its longest straights; they hide it there
  bool second_tube = false;  // the same program once more, lying beside the part
};

// Everything that a virtual scan depends on; the same options give the same profiles.
struct VirtualScanOptions {
  std::uint64_t seed = 1;
  ScanPathOptions path;

  // The sensor.
  int rays = 640;                  // of one laser line, at most kWireMaxPoints
  double fan_half_angle_deg = 25;  // the rays spread evenly over twice this
  double near_mm = 80;             // measuring range, z of the sensor frame
  double far_mm = 260;
  double camera_baseline_mm = 60;    // camera's place: (0, baseline, 0) in the sensor frame
  double max_incidence_deg = 78;     // from the surface normal; beyond it there is no return
  double profiles_per_second = 200;  // gives t_ns only; nothing waits
  std::int64_t start_t_ns = 1'000'000'000;

  // What is wrong with it.
  double noise_mm = 0.03;   // 1 sigma, along the ray, at normal incidence
  double noise_growth = 0;  // n: 1 sigma is noise_mm / cos(incidence)^n; 0: everywhere alike
  double outlier_fraction = 0.002;    // fliers: anywhere on the ray within the range
  double mixed_pixel_fraction = 0.1;  // of points at an edge: between front and back
  double dropout_fraction = 0;        // of points, lost at random
  double pose_noise_mm = 0;           // 1 sigma of the reported position, each axis
  bool quantise = true;               // to whole micrometres, as the wire carries them

  hal::TubeFeatures features;  // of the part
  double wall_mm = 0;          // of the part: seen where it is cut; 0: nothing returns from there
  Clutter clutter;
};

// A scan of a known tube: laser-line profiles of what a moving sensor would see, in the world W in
// which the tube lies. Occlusion of the laser and of the camera is exact. Any profile can be made
// at any time; each has its own random numbers.
class VirtualScan {
 public:
  VirtualScan(const hal::Tube& tube, const VirtualScanOptions& options);

  std::size_t profile_count() const { return poses_.size(); }
  std::size_t max_points() const { return static_cast<std::size_t>(options_.rays); }
  const VirtualScanOptions& options() const { return options_; }
  const Scene& scene() const { return scene_; }

  // `index` below profile_count(); sequence and time follow from it.
  void Make(std::size_t index, hal::LaserProfile& profile) const;

  std::int64_t TimeOf(std::size_t index) const;

  // At the times of the first and last profile.
  hal::ScanEvent StartEvent() const;
  hal::ScanEvent EndEvent() const;

 private:
  struct View;
  struct Spot {
    double along_mm;  // the ray
    double cosine;    // of the angle between ray and surface normal
  };
  // What the sensor sees of a ray; `depth`: its direction's z in S.
  std::optional<Spot> SpotOf(const Ray& ray, double depth, View& view) const;

  VirtualScanOptions options_;
  Scene scene_;
  std::vector<hal::Pose> poses_;
  std::vector<Eigen::Vector2d> fan_;  // x and z of each ray's direction in S
};

// The tube laid on the table z = 0 as a hand would: its flattest side down, anywhere, any way
// round, tilted by at most `tilt_deg`. Deterministic for a seed.
hal::Tube LayOnTable(hal::Tube tube, std::uint64_t seed, double tilt_deg = 5);

}  // namespace bendloop::drivers
