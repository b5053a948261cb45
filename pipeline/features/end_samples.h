// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "pipeline/features/end_border.h"
#include "pipeline/features/end_lines.h"
#include "pipeline/features/end_sectors.h"
#include "pipeline/fit/surface_points.h"
#include "pipeline/fit/tube_ends.h"

namespace bendloop::pipeline {

// A sample about an end: across its axis, and beyond the end along it.
struct NearEnd {
  double x, y, at_mm;
  unsigned pass;
  double of_radius = 1;  // EndSample

  double RadiusMm() const { return std::hypot(x, y); }
  double AroundRad() const { return std::atan2(y, x); }
  // Beyond a plane at its axis, which rises so towards x and y (EndSide).
  double BeyondMm(const Eigen::Vector3d& plane_mm) const {
    const double out = 1.0 / std::sqrt(x * x + y * y);
    return at_mm - plane_mm[0] - out * (plane_mm[1] * x + plane_mm[2] * y);
  }
  // The same of a sample that is not on the wall: the plane rises by less the nearer to the axis.
  double BeyondInsideMm(const Eigen::Vector3d& plane_mm, double pipe_radius_mm) const {
    return at_mm - plane_mm[0] - (plane_mm[1] * x + plane_mm[2] * y) / pipe_radius_mm;
  }
};

// Samples of the tube near one of its ends, all of them; how far around the tube is asked only of
// those that are taken.
class SamplesNearEnd {
 public:
  // Of `window_mm` and more before the end. `sigma_mm`: noise, which tells those on the wall.
  SamplesNearEnd(const hal::Tube& tube, bool at_start, const EndAxis& axis, double sigma_mm,
                 double window_mm, std::span<const PointBlock> blocks);

  std::size_t size() const { return wall_.size(); }
  bool knows_passes() const { return knows_passes_; }  // any of them
  // Every so many of those on the wall.
  std::vector<EndSample> Every(std::size_t stride) const;
  // Those on the wall, from `below_mm` before a plane to `above_mm` beyond it.
  std::vector<BandSample> Band(const Eigen::Vector3d& plane_mm, double below_mm,
                               double above_mm) const;
  // Where something above the wall hides that it goes on.
  EndSectors Hidden(const Eigen::Vector3d& plane_mm) const;

  const std::vector<NearEnd>& wall() const { return wall_; }
  // Right before and beyond the end, nearer to the axis than the wall, and farther from it.
  const std::vector<NearEnd>& inside() const { return inside_; }
  const std::vector<NearEnd>& outside() const { return outside_; }
  // Beyond the end: from where the wall leads to it without a gap that goes all round, as a bead
  // leaves one. None: there is no gap.
  std::optional<double> WallBeginsMm() const;
  // How far the outermost samples of the wall lie from there.
  double WallReachesMm(double from_mm) const;
  void LeaveOutWallBefore(double at_mm);
  void LeaveOutWallFrom(double at_mm);
  // 1 sigma across the wall right before the end, where that is certainly less than the scan's,
  // which dents and bows elsewhere raise.
  double WallNoiseMm() const;
  // How far the face that a cut left lies beyond a plane: mean of at least so many samples below
  // the wall that lie so near to it. None: fewer do.
  std::optional<double> FaceBeyondMm(const Eigen::Vector3d& plane_mm, double near_mm,
                                     double least) const;
  // The same without those on the wall that lie no farther from the axis than this.
  SamplesNearEnd Above(double radius_mm) const;
  // The same with some more on the wall, which has come in or stands out there.
  SamplesNearEnd With(std::span<const NearEnd> more) const;

 private:
  double r_mm_, sigma_mm_;
  bool knows_passes_ = false;
  std::vector<NearEnd> wall_, inside_, outside_;
};

}  // namespace bendloop::pipeline
