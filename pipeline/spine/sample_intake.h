// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "hal/laser_profile.h"
#include "hal/result.h"
#include "pipeline/math/workers.h"
#include "pipeline/points/kept_lines.h"
#include "pipeline/points/sample_grid.h"
#include "pipeline/points/sensor_direction.h"
#include "pipeline/spine/mls_projection.h"

namespace bendloop::pipeline {

// Takes points in as they arrive, sorts them into cubes and projects what has become complete
// (section 3). Points wait as they are until the pipe radius is known, which sizes the cubes.
class SampleIntake {
 public:
  // `max_points`: of those that come again and again to a place so many are kept for the final fit;
  // `max_line_points`: of laser lines, as lines.
  SampleIntake(std::optional<double> pipe_radius_mm, std::size_t max_points,
               std::size_t max_line_points);

  // Takes a profile's points to the world frame.
  void Add(const hal::LaserProfile& profile);
  void Add(std::span<const Eigen::Vector3d> points_W);
  // All at once: the points are not copied where that can be helped and must live until TakeAll.
  void Lend(std::span<const Eigen::Vector3d> points_W);

  // When the scan has ended: the pipe radius from the points that wait, if it was not given.
  // kBadInput: they are no pipe.
  hal::Result<void> FindPipeRadius(Workers* workers);
  // Then takes in what waits. kBadInput: too few points.
  hal::Result<void> TakeAll(Workers* workers);
  // And projects all of it.
  std::vector<SpineNode> ProjectAll(Workers* workers);

  std::uint64_t profiles() const { return profiles_; }
  std::uint64_t points() const { return points_; }  // that came
  unsigned passes() const { return profiles_ > 0 ? pass_ + 1 : 0; }
  bool knows_pipe_radius() const { return grid_.has_value(); }
  double pipe_radius_mm() const { return radius_mm_; }  // 0: not yet known
  // From here on only with a known pipe radius.
  const SampleGrid& grid() const { return *grid_; }
  const KeptLines& lines() const { return lines_; }  // none of clouds
  std::vector<SpineNode> Nodes() const { return projection_->Nodes(); }
  // The block lies on a plane: no part of the tube.
  bool IsPlanar(std::int32_t block) const { return projection_->IsPlanar(block); }

 private:
  void StartWith(double radius_mm);
  // A pause, or a leap of the sensor to another side, begins another pass.
  void CountPasses(const hal::LaserProfile& profile);
  void AddPoint(const Eigen::Vector3d& point, SensorDirection to_sensor = {});
  // When too many wait, every second stays, and from then on every second, fourth ... is taken: so
  // a long scan is thin all along and does not end early.
  void Wait(const Eigen::Vector3d& point, SensorDirection to_sensor);
  void ThinWaiting();
  // The block's samples changed, so its projection is out of date.
  void Touch(std::size_t block);
  void ProjectQuietBlocks();
  void Project(std::span<const std::int32_t> blocks, Workers* workers);
  std::span<const Eigen::Vector3d> Waiting() const;

  std::size_t max_points_;
  double radius_mm_ = 0;
  std::vector<Eigen::Vector3d> waiting_;            // until the pipe radius is known
  std::vector<SensorDirection> waiting_to_sensor_;  // of these, or none
  std::uint64_t places_ = 0;                        // that came while points wait
  std::uint64_t stride_ = 1;                        // of these so many-th wait: a power of two
  std::span<const Eigen::Vector3d> lent_;
  KeptLines lines_;
  std::optional<SampleGrid> grid_;
  std::optional<MlsProjection> projection_;
  std::vector<std::uint64_t> touched_;  // by block: profile of the last change; 0: up to date
  std::vector<std::int32_t> pending_;
  std::uint64_t profiles_ = 0;
  std::uint64_t points_ = 0;
  unsigned pass_ = 0;
  std::int64_t last_t_ns_ = 0;
  Eigen::Vector3d last_sensor_mm_ = Eigen::Vector3d::Zero();
};

}  // namespace bendloop::pipeline
