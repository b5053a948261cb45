// SPDX-License-Identifier: Apache-2.0
#include "pipeline/points/kept_lines.h"

#include <algorithm>
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
};
constexpr KeptLineSettings kKept;

double UsualMm(std::vector<double> distances_mm) {
  return distances_mm.empty() ? std::numeric_limits<double>::infinity()
                              : Median(std::move(distances_mm));
}

}  // namespace

double KeptLines::Line::MovedMm(const hal::Pose& to) const {
  const auto moved_mm = [&](const hal::ProfilePoint& at) {
    const Eigen::Vector3d point_S(at.x_mm, 0.0, at.z_mm);
    return (to * point_S - X_WS * point_S).norm();
  };
  return std::max(moved_mm(first), moved_mm(last));
}

void KeptLines::Begin(const hal::Pose& X_WS) {
  KeepWithin();
  if (!lines_.empty() && lines_.back().begin == points_.size()) lines_.pop_back();  // saw nothing
  rays_ = 0;
  is_left_out_ = IsNear(X_WS);
  if (!is_left_out_) lines_.push_back({points_.size(), X_WS, {}, {}});
}

void KeptLines::Add(const hal::ProfilePoint& at, const Eigen::Vector3d& point_W,
                    SensorDirection to_sensor) {
  if (is_left_out_ || !point_W.allFinite() || rays_++ % stride_ != 0) return;
  Line& line = lines_.back();
  if (line.begin == points_.size()) line.first = at;
  line.last = at;
  points_.push_back(point_W);
  to_sensor_.push_back(to_sensor);
}

void KeptLines::KeepWithin() {
  while (points_.size() > std::max<std::size_t>(max_points_, 1)) {
    if (kKept.rays_a_gap * PitchMm() < GapMm()) {
      ThinRays();
    } else {
      ThinLines();
    }
  }
}

bool KeptLines::IsNear(const hal::Pose& X_WS) const {
  return !lines_.empty() && lines_.back().MovedMm(X_WS) < kKept.near * gap_mm_;
}

double KeptLines::PitchMm() const {
  std::vector<double> pitches_mm;
  for (std::size_t k = 0; k < lines_.size(); ++k) {
    for (std::size_t i = lines_[k].begin + 1; i < EndOf(k); ++i) {
      pitches_mm.push_back((points_[i] - points_[i - 1]).norm());
    }
  }
  return UsualMm(std::move(pitches_mm));
}

double KeptLines::GapMm() const {
  std::vector<double> gaps_mm;
  for (std::size_t k = 1; k < lines_.size(); ++k) {
    gaps_mm.push_back(lines_[k - 1].MovedMm(lines_[k].X_WS));
  }
  return UsualMm(std::move(gaps_mm));
}

void KeptLines::ThinRays() {
  stride_ *= 2;
  const std::vector<Line> lines = std::exchange(lines_, {});
  std::size_t kept = 0;
  for (std::size_t k = 0; k < lines.size(); ++k) {
    const std::size_t end = k + 1 < lines.size() ? lines[k + 1].begin : points_.size();
    Keep(lines[k], end, 2, kept);
  }
  Shrink(kept);
}

void KeptLines::ThinLines() {
  gap_mm_ = 2.0 * (gap_mm_ > 0 ? gap_mm_ : std::max(kKept.least_gap_mm, GapMm()));
  const std::vector<Line> lines = std::exchange(lines_, {});
  std::size_t kept = 0;
  for (std::size_t k = 0; k < lines.size(); ++k) {
    if (IsNear(lines[k].X_WS)) continue;
    const std::size_t end = k + 1 < lines.size() ? lines[k + 1].begin : points_.size();
    Keep(lines[k], end, 1, kept);
  }
  Shrink(kept);
}

void KeptLines::Keep(const Line& line, std::size_t end, std::size_t stride, std::size_t& kept) {
  lines_.push_back(line);
  lines_.back().begin = kept;
  for (std::size_t i = line.begin; i < end; i += stride) {
    points_[kept] = points_[i];
    to_sensor_[kept++] = to_sensor_[i];
  }
}

void KeptLines::Shrink(std::size_t kept) {
  points_.resize(kept);
  to_sensor_.resize(kept);
}

}  // namespace bendloop::pipeline
