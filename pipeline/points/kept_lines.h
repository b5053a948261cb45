// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <span>
#include <vector>

#include "hal/laser_profile.h"
#include "pipeline/points/sensor_direction.h"

namespace bendloop::pipeline {

// The laser lines of a scan as they came, for what is read line by line: borders of holes and ends.
// There may be `max_points` points. When more come, every second ray of all lines is left out, or
// the lines that lie nearer to the one before them than twice as far as until then: whichever of
// them lie closer. So what is left are lines still, evenly over the scan, and a scanner that waits
// over a place has a line there and no more. Depends on the order of the profiles alone.
class KeptLines {
 public:
  explicit KeptLines(std::size_t max_points) : max_points_(max_points) {}

  // Begins a line; Add() goes to it. `X_WS`: where its sensor was.
  void Begin(const hal::Pose& X_WS);
  // The next point of the line, in S and in W; not finite: left out.
  void Add(const hal::ProfilePoint& at, const Eigen::Vector3d& point_W, SensorDirection to_sensor);

  std::span<const Eigen::Vector3d> points() const { return points_; }
  std::span<const SensorDirection> to_sensor() const { return to_sensor_; }

 private:
  // Its first and its last point tell how far it moves.
  struct Line {
    std::size_t begin = 0;  // of its points
    hal::Pose X_WS;
    hal::ProfilePoint first, last;

    double MovedMm(const hal::Pose& to) const;
  };
  std::size_t EndOf(std::size_t line) const {
    return line + 1 < lines_.size() ? lines_[line + 1].begin : points_.size();
  }

  void KeepWithin();
  bool IsNear(const hal::Pose& X_WS) const;  // to the last line
  // Usual distances; infinite: there are no two.
  double PitchMm() const;  // of the rays of a line
  double GapMm() const;    // of lines
  void ThinRays();
  void ThinLines();
  // Every `stride`-th point of a line that ends there goes to where the `kept` ones end.
  void Keep(const Line& line, std::size_t end, std::size_t stride, std::size_t& kept);
  void Shrink(std::size_t kept);

  std::size_t max_points_;
  std::vector<Eigen::Vector3d> points_;
  std::vector<SensorDirection> to_sensor_;
  std::vector<Line> lines_;
  bool is_left_out_ = true;  // the line that comes
  std::size_t rays_ = 0;     // of it, so far
  std::size_t stride_ = 1;   // of the rays so many-th are kept
  double gap_mm_ = 0;        // lines that move less are not
};

}  // namespace bendloop::pipeline
