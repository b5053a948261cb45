// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/load/load_source.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>

#include "hal/spine.h"

namespace bendloop::bench {
namespace {

constexpr double kStandoffMm = 150;
constexpr double kSpacingMm = 1.0, kNoiseMm = 0.03;
constexpr int kPasses = 6;
constexpr double kSeenHalfAngle = 1.2;  // of the tube's section, radians
constexpr std::size_t kLines = 251;     // a prime: line and place never pair up twice soon
constexpr double kMostViewAngle = 1.2;  // of the passes from the upside, radians
constexpr double kIdleReadSeconds = 2e-3;

}  // namespace

hal::Tube LoadTube(double off_deg) {
  return {12.7,
          {{{150.0, 0.0, 45.0 + off_deg, 50.0},
            {120.0, 70.0, 90.0 + off_deg, 50.0},
            {140.0, -40.0, 30.0 + off_deg, 50.0},
            {110.0, 155.0, 62.0 + off_deg, 50.0},
            {180.0, 0.0, 0.0, std::nullopt}}},
          {}};
}

LoadScan MakeLoadScan(const hal::Tube& tube, std::uint64_t seed) {
  LoadScan scan;
  std::mt19937_64 random(seed);
  std::normal_distribution<double> noise(0, kNoiseMm);
  std::uniform_real_distribution<double> uniform(0, 1);
  for (std::size_t l = 0; l < kLines; ++l) {
    auto& line = scan.lines.emplace_back();
    for (std::size_t i = 0; i < LoadScan::kPoints; ++i) {
      const double angle = kSeenHalfAngle * (2.0 * static_cast<double>(i) / LoadScan::kPoints - 1);
      const double radius_mm = tube.pipe_radius_mm + noise(random);
      line.push_back({static_cast<float>(radius_mm * std::sin(angle)),
                      static_cast<float>(kStandoffMm - radius_mm * std::cos(angle))});
    }
  }
  const auto spine = hal::SpineSegments(tube.program, tube.X_WT);
  const double length_mm = hal::SpineLength(tube.program);
  for (int pass = 0; pass < kPasses; ++pass) {
    const double view = kMostViewAngle * (2.0 * pass / (kPasses - 1) - 1);
    const auto steps = static_cast<std::size_t>(length_mm / kSpacingMm);
    const double offset_mm = uniform(random) * kSpacingMm;
    for (std::size_t i = 0; i < steps; ++i) {
      // To and fro, as a hand does.
      const std::size_t step = pass % 2 == 0 ? i : steps - 1 - i;
      const double s = static_cast<double>(step) * kSpacingMm + offset_mm;
      auto segment = spine.begin();
      while (segment + 1 != spine.end() && (segment + 1)->from_start_mm <= s) ++segment;
      const double along_mm = s - segment->from_start_mm;
      const Eigen::Vector3d tangent = segment->TangentAt(along_mm);
      const Eigen::Vector3d up = Eigen::AngleAxisd(view, tangent) * segment->normal;
      hal::Pose pose;
      pose.position_mm = segment->PointAt(along_mm) + kStandoffMm * up;
      Eigen::Matrix3d axes;
      axes << tangent.cross(-up), tangent, -up;
      pose.orientation = Eigen::Quaterniond(axes);
      scan.X_WS.push_back(pose);
    }
  }
  return scan;
}

std::chrono::nanoseconds LoadSource::DueTime(std::uint64_t index) const {
  return begun_ + std::chrono::nanoseconds(static_cast<std::int64_t>(
                      1e9 * static_cast<double>(index) / running_->profiles_per_second));
}

hal::Result<hal::ReadStatus> LoadSource::Read(hal::LaserProfile& profile, hal::ScanEvent& event,
                                              std::chrono::nanoseconds timeout) {
  const auto now = clock_.Now();
  if (running_ == nullptr) {
    running_ = order_.exchange(nullptr, std::memory_order_acquire);
    if (running_ == nullptr) {
      clock_.SleepFor(std::min<std::chrono::nanoseconds>(
          timeout, std::chrono::nanoseconds(static_cast<std::int64_t>(1e9 * kIdleReadSeconds))));
      return hal::ReadStatus::kTimeout;
    }
    begun_ = now + std::chrono::milliseconds(5);
    next_ = 0;
    first_due_ns_ = begun_.count();
    event.kind = hal::ScanEventKind::kScanStart;
    event.t_ns = begun_.count();
    event.set_detail("");
    return hal::ReadStatus::kEvent;
  }
  if (next_ == running_->profiles) {
    running_ = nullptr;
    event.kind = hal::ScanEventKind::kScanEnd;
    event.t_ns = last_due_ns_;
    event.set_detail("");
    return hal::ReadStatus::kEvent;
  }
  const auto due = DueTime(next_);
  if (due > now) {
    clock_.SleepUntil(std::min(due, now + timeout));
    if (due > now + timeout) return hal::ReadStatus::kTimeout;
  }
  const LoadScan& scan = *running_->scan;
  const auto& line = scan.lines[(next_ + running_->first_line) % scan.lines.size()];
  profile.sequence = next_;
  profile.t_ns = due.count();
  profile.X_WS = scan.X_WS[next_ % scan.X_WS.size()];
  profile.points.assign(line.begin(), line.end());
  profile.intensity.clear();
  last_due_ns_ = due.count();
  ++next_;
  return hal::ReadStatus::kProfile;
}

}  // namespace bendloop::bench
