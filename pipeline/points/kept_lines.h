// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstddef>
#include <span>
#include <vector>

#include "hal/laser_profile.h"
#include "pipeline/points/sensor_direction.h"

namespace bendloop::pipeline {

// Points in W with the directions to their sensors, one each.
struct DirectedPoints {
  std::vector<Eigen::Vector3d> points_mm;
  std::vector<SensorDirection> to_sensor;
};
// A point of the sensor frame S in W: the same number wherever it is worked out.
struct PlacedRay {
  Eigen::Vector3d point_mm;
  SensorDirection to_sensor;
};
inline PlacedRay PlaceRay(const hal::Pose& X_WS, const Eigen::Matrix3d& R_WS,
                          const hal::ProfilePoint& at, unsigned pass) {
  const Eigen::Vector3d from_sensor = R_WS.col(0) * at.x_mm + R_WS.col(2) * at.z_mm;
  return {from_sensor + X_WS.position_mm, WithPass(PackDirection(-from_sensor), pass)};
}

// A ball in W.
struct Ball {
  Eigen::Vector3d middle_mm;
  double radius_mm = 0;
};

// The laser lines of a scan as they came, for what is read line by line: borders of holes and ends.
// There may be `max_points` points. When more come, every second ray of all lines is left out, or
// the lines that lie nearer to the one before them than twice as far as until then: whichever of
// them lie closer. So what is left are lines still, evenly over the scan, and a scanner that waits
// over a place has a line there and no more. Depends on the order of the profiles alone.
class KeptLines {
 public:
  explicit KeptLines(std::size_t max_points) : max_points_(max_points) {}

  void Add(const hal::LaserProfile& profile, unsigned pass);
  // The same lines, as if there were room for fewer points.
  KeptLines ThinnedTo(std::size_t max_points) const;

  std::size_t point_count() const { return points_.size(); }
  // Lines that may come into one of these balls.
  KeptLines Near(std::span<const Ball> balls) const;
  DirectedPoints Points() const;

 private:
  struct Line {
    std::size_t begin = 0;  // of its points
    hal::Pose X_WS;
    unsigned pass = 0;
    Eigen::AlignedBox3d box_mm;  // in W; its points lie in it
  };
  std::size_t EndOf(std::size_t line) const {
    return line + 1 < lines_.size() ? lines_[line + 1].begin : points_.size();
  }
  // How far the first or the last point of a line moves with its sensor.
  double MovedMm(std::size_t line, const hal::Pose& to) const;
  bool IsNear(const hal::Pose& X_WS) const;  // to the last line
  void Take(const KeptLines& from, std::size_t line, std::size_t stride);

  void KeepWithin();
  std::size_t Cost() const;
  // Usual distances; infinite: there are no two.
  double PitchMm() const;  // of the rays of a line
  double GapMm() const;    // of lines
  // To about so many points, or more.
  KeptLines Thinned(std::size_t max_points) const;

  std::size_t max_points_;
  std::vector<hal::ProfilePoint> points_;  // in the S of their lines
  std::vector<Line> lines_;
  std::size_t stride_ = 1;  // of the rays so many-th are kept
  double gap_mm_ = 0;       // lines that move less are not
};

}  // namespace bendloop::pipeline
