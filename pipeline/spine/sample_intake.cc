// SPDX-License-Identifier: Apache-2.0
#include "pipeline/spine/sample_intake.h"

#include <algorithm>
#include <string>

#include "pipeline/points/input_checks.h"
#include "pipeline/spine/pipe_radius.h"

namespace bendloop::pipeline {
namespace {

struct PassSettings {
  // [ns] Scanners send hundreds of profiles a second; an arm that waits longer may drift, or the
  // tube be touched. By trial.
  std::int64_t pause_ns = 500'000'000;
  // [mm] Between two profiles: an arm does not move so fast but between two sides.
  double leap_mm = 40.0;
};
constexpr PassSettings kPasses;

}  // namespace

SampleIntake::SampleIntake(std::optional<double> pipe_radius_mm, std::size_t max_points,
                           std::size_t max_line_points)
    : max_points_(max_points), lines_(max_line_points) {
  if (pipe_radius_mm) StartWith(*pipe_radius_mm);
}

void SampleIntake::CountPasses(const hal::LaserProfile& profile) {
  const bool paused = profile.t_ns - last_t_ns_ > kPasses.pause_ns;
  const bool leapt = (profile.X_WS.position_mm - last_sensor_mm_).squaredNorm() >
                     kPasses.leap_mm * kPasses.leap_mm;
  if (profiles_ > 0 && (paused || leapt) && pass_ + 1 < kMostPasses) ++pass_;
  last_t_ns_ = profile.t_ns;
  last_sensor_mm_ = profile.X_WS.position_mm;
}

void SampleIntake::Add(const hal::LaserProfile& profile) {
  CountPasses(profile);
  ++profiles_;
  const Eigen::Matrix3d R_WS = profile.X_WS.orientation.toRotationMatrix();
  for (const hal::ProfilePoint& p : profile.points) {
    const PlacedRay ray = PlaceRay(profile.X_WS, R_WS, p, pass_);
    AddPoint(ray.point_mm, ray.to_sensor);
  }
  lines_.Add(profile, pass_);
  if (grid_) ProjectQuietBlocks();
}

void SampleIntake::Add(std::span<const Eigen::Vector3d> points_W) {
  ++profiles_;
  for (const Eigen::Vector3d& p : points_W) AddPoint(p);
}

void SampleIntake::Lend(std::span<const Eigen::Vector3d> points_W) {
  if (!std::all_of(points_W.begin(), points_W.end(), IsPlace)) {
    Add(points_W);
    return;
  }
  ++profiles_;
  points_ += points_W.size();
  lent_ = points_W;
}

hal::Result<void> SampleIntake::FindPipeRadius(Workers* workers) {
  if (const auto shape = CheckShape(Waiting()); !shape) return hal::Fail(shape.error());
  const auto radius = EstimatePipeRadius(Waiting(), workers);
  if (!radius) return hal::Fail(radius.error().kind, radius.error().message + kCloserLines);
  if (const auto units = CheckUnits(radius->radius_mm); !units) return hal::Fail(units.error());
  StartWith(radius->radius_mm);
  return {};
}

hal::Result<void> SampleIntake::TakeAll(Workers* workers) {
  if (!Waiting().empty()) {
    grid_->InsertAll(Waiting(), workers, waiting_to_sensor_);
    for (std::size_t block = 0; block < grid_->blocks().size(); ++block) Touch(block);
    lent_ = {};
    waiting_ = {};
    waiting_to_sensor_ = {};
  }
  if (grid_->point_count() >= kMinPoints) return {};
  return hal::Fail(hal::ErrorKind::kBadInput,
                   "too few points: found " + std::to_string(grid_->point_count()) +
                       ", a tube needs " + std::to_string(kMinPoints) + " at least");
}

std::vector<SpineNode> SampleIntake::ProjectAll(Workers* workers) {
  Project(pending_, workers);
  pending_.clear();
  projection_->FinishNodes(*grid_, workers);
  return projection_->Nodes();
}

void SampleIntake::StartWith(double radius_mm) {
  radius_mm_ = radius_mm;
  grid_.emplace(MlsProjection::BlockMm(radius_mm), max_points_);
  projection_.emplace(radius_mm);
}

void SampleIntake::AddPoint(const Eigen::Vector3d& point, SensorDirection to_sensor) {
  ++points_;
  if (!grid_) {
    Wait(point, to_sensor);
    return;
  }
  std::int32_t block = -1;
  if (grid_->Insert(point, block, to_sensor) != SampleGrid::Insertion::kSample) return;
  for (const std::int32_t near : grid_->blocks()[static_cast<std::size_t>(block)].neighbours) {
    if (near >= 0) Touch(static_cast<std::size_t>(near));
  }
}

void SampleIntake::Wait(const Eigen::Vector3d& point, SensorDirection to_sensor) {
  if (!IsPlace(point) || (places_++ & (stride_ - 1)) != 0) return;
  if (waiting_.size() >= SampleGrid::kMaxPoints) {
    ThinWaiting();
    if (((places_ - 1) & (stride_ - 1)) != 0) return;
  }
  if (to_sensor.known() || !waiting_to_sensor_.empty()) {
    waiting_to_sensor_.resize(waiting_.size());
    waiting_to_sensor_.push_back(to_sensor);
  }
  waiting_.push_back(point);
}

void SampleIntake::ThinWaiting() {
  stride_ *= 2;
  const auto every_second = [](auto& values) {
    for (std::size_t i = 0; 2 * i < values.size(); ++i) values[i] = values[2 * i];
    values.resize((values.size() + 1) / 2);
  };
  every_second(waiting_);
  every_second(waiting_to_sensor_);
}

void SampleIntake::Touch(std::size_t block) {
  if (block >= touched_.size()) touched_.resize(block + 1, 0);
  if (touched_[block] == 0) pending_.push_back(static_cast<std::int32_t>(block));
  touched_[block] = profiles_;
}

void SampleIntake::ProjectQuietBlocks() {
  // A block is projected when no sample has come to it or its neighbours for this many profiles:
  // the laser line has moved on. When does not change what comes out, only how often it is done
  // again (by trial).
  constexpr std::uint64_t kQuietProfiles = 12;
  const auto quiet =
      std::stable_partition(pending_.begin(), pending_.end(), [this](std::int32_t block) {
        return touched_[static_cast<std::size_t>(block)] + kQuietProfiles > profiles_;
      });
  if (quiet == pending_.end()) return;
  Project({quiet, pending_.end()}, nullptr);
  pending_.erase(quiet, pending_.end());
  projection_->UpdateNodes(*grid_);
}

void SampleIntake::Project(std::span<const std::int32_t> blocks, Workers* workers) {
  for (const std::int32_t block : blocks) touched_[static_cast<std::size_t>(block)] = 0;
  projection_->UpdateBlocks(*grid_, blocks, workers);
}

std::span<const Eigen::Vector3d> SampleIntake::Waiting() const {
  return lent_.empty() ? std::span<const Eigen::Vector3d>(waiting_) : lent_;
}

}  // namespace bendloop::pipeline
