// SPDX-License-Identifier: Apache-2.0
#include "pipeline/points/kept_lines.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "pipeline/math/quantiles.h"

namespace bendloop::pipeline {
namespace {

struct KeptLineSettings {
  // Of the distance of lines, that of the rays in one: where they lie closer every second is left
  // out, else lines are. Lines are known as such, and borders along them as well as across.
  double rays_a_gap = 3.0;
  // Of that distance: nearer lines are left out. A little less than all of it, so that of even
  // lines it is every second that stays, those that came before and those that come.
  double near = 0.95;
  // [mm] Lines that do not move at all are nearer than any.
  double least_gap_mm = 1e-6;
  // [points] What a line takes beside its points: room, should it have hardly any.
  std::size_t cost_of_line = 16;
  // So many of them, about, tell usual distances.
  std::size_t asked = 10'000;
};
constexpr KeptLineSettings kKept;

double UsualMm(std::vector<double> distances_mm) {
  return distances_mm.empty() ? std::numeric_limits<double>::infinity()
                              : Median(std::move(distances_mm));
}

Eigen::Vector3d InSensor(const hal::ProfilePoint& at) { return {at.x_mm, 0.0, at.z_mm}; }

}  // namespace

void KeptLines::Add(const hal::LaserProfile& profile, unsigned pass) {
  if (!lines_.empty() && IsNear(profile.X_WS)) return;
  Line line{points_.size(), profile.X_WS, pass, {}};
  Eigen::AlignedBox2f of_points;
  for (std::size_t i = 0; i < profile.points.size(); i += stride_) {
    const hal::ProfilePoint& at = profile.points[i];
    if (!std::isfinite(at.x_mm + at.z_mm)) continue;
    points_.push_back(at);
    of_points.extend(Eigen::Vector2f(at.x_mm, at.z_mm));
  }
  if (points_.size() == line.begin) return;  // saw nothing
  for (const auto corner :
       {of_points.BottomLeft, of_points.BottomRight, of_points.TopLeft, of_points.TopRight}) {
    const Eigen::Vector2f at = of_points.corner(corner);
    line.box_mm.extend(line.X_WS * InSensor({at.x(), at.y()}));
  }
  lines_.push_back(line);
  KeepWithin();
}

KeptLines KeptLines::ThinnedTo(std::size_t max_points) const {
  KeptLines fewer = Thinned(max_points);
  fewer.KeepWithin();
  return fewer;
}

KeptLines KeptLines::Near(std::span<const Ball> balls) const {
  KeptLines near(max_points_);
  near.stride_ = stride_;
  near.gap_mm_ = gap_mm_;
  for (std::size_t k = 0; k < lines_.size(); ++k) {
    const auto comes_into = [&](const Ball& ball) {
      return lines_[k].box_mm.squaredExteriorDistance(ball.middle_mm) <=
             ball.radius_mm * ball.radius_mm;
    };
    if (std::any_of(balls.begin(), balls.end(), comes_into)) near.Take(*this, k, 1);
  }
  return near;
}

DirectedPoints KeptLines::Points() const {
  DirectedPoints placed;
  placed.points_mm.reserve(points_.size());
  placed.to_sensor.reserve(points_.size());
  for (std::size_t k = 0; k < lines_.size(); ++k) {
    const Line& line = lines_[k];
    const Eigen::Matrix3d R_WS = line.X_WS.orientation.toRotationMatrix();
    for (std::size_t i = line.begin; i < EndOf(k); ++i) {
      const PlacedRay ray = PlaceRay(line.X_WS, R_WS, points_[i], line.pass);
      placed.points_mm.push_back(ray.point_mm);
      placed.to_sensor.push_back(ray.to_sensor);
    }
  }
  return placed;
}

double KeptLines::MovedMm(std::size_t line, const hal::Pose& to) const {
  const auto moved_mm = [&](std::size_t i) {
    const Eigen::Vector3d point_S = InSensor(points_[i]);
    return (to * point_S - lines_[line].X_WS * point_S).norm();
  };
  return std::max(moved_mm(lines_[line].begin), moved_mm(EndOf(line) - 1));
}

bool KeptLines::IsNear(const hal::Pose& X_WS) const {
  return MovedMm(lines_.size() - 1, X_WS) < kKept.near * gap_mm_;
}

std::size_t KeptLines::Cost() const { return points_.size() + kKept.cost_of_line * lines_.size(); }

void KeptLines::KeepWithin() {
  while (Cost() > max_points_ && points_.size() > 1) *this = Thinned(max_points_);
}

KeptLines KeptLines::Thinned(std::size_t max_points) const {
  KeptLines fewer(max_points);
  fewer.gap_mm_ = gap_mm_;
  double pitch_mm = PitchMm(), gap_mm = GapMm();
  std::size_t stride = 1;
  for (std::size_t left = Cost(); left > max_points; left /= 2) {
    if (kKept.rays_a_gap * pitch_mm < gap_mm) {
      stride *= 2;
      pitch_mm *= 2.0;
    } else {
      fewer.gap_mm_ =
          2.0 * (fewer.gap_mm_ > 0 ? fewer.gap_mm_ : std::max(kKept.least_gap_mm, gap_mm));
      gap_mm *= 2.0;
    }
  }
  fewer.stride_ = stride_ * stride;
  for (std::size_t k = 0; k < lines_.size(); ++k) {
    if (fewer.lines_.empty() || !fewer.IsNear(lines_[k].X_WS)) fewer.Take(*this, k, stride);
  }
  return fewer;
}

void KeptLines::Take(const KeptLines& from, std::size_t line, std::size_t stride) {
  lines_.push_back(from.lines_[line]);
  lines_.back().begin = points_.size();
  for (std::size_t i = from.lines_[line].begin; i < from.EndOf(line); i += stride) {
    points_.push_back(from.points_[i]);
  }
}

double KeptLines::PitchMm() const {
  std::vector<double> pitches_mm;
  const std::size_t every = points_.size() / kKept.asked + 1;
  for (std::size_t k = 0; k < lines_.size(); k += every) {
    for (std::size_t i = lines_[k].begin + 1; i < EndOf(k); ++i) {
      pitches_mm.push_back((InSensor(points_[i]) - InSensor(points_[i - 1])).norm());
    }
  }
  return UsualMm(std::move(pitches_mm));
}

double KeptLines::GapMm() const {
  std::vector<double> gaps_mm;
  const std::size_t every = lines_.size() / kKept.asked + 1;
  for (std::size_t k = 1; k < lines_.size(); k += every) {
    gaps_mm.push_back(MovedMm(k - 1, lines_[k].X_WS));
  }
  return UsualMm(std::move(gaps_mm));
}

}  // namespace bendloop::pipeline
