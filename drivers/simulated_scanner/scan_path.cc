// SPDX-License-Identifier: Apache-2.0
#include "drivers/simulated_scanner/scan_path.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "drivers/simulated_scanner/random.h"
#include "hal/angles.h"

namespace bendloop::drivers {
namespace {

using Eigen::Vector3d;

constexpr std::size_t kMaxProfiles = 10'000'000;  // an absurd spacing must not eat all memory

Vector3d Across(const Vector3d& v, const Vector3d& tangent) { return v - v.dot(tangent) * tangent; }

// A slow random swing with standard deviation 1: three sines with periods of 50 to 400 mm.
class Swing {
 public:
  explicit Swing(Random& random) {
    for (auto& [frequency, phase] : sines_) {
      frequency = 2 * std::numbers::pi / random.Uniform(50, 400);
      phase = random.Uniform(0, 2 * std::numbers::pi);
    }
  }
  double At(double along_mm) const {
    double sum = 0;
    for (const auto& [frequency, phase] : sines_) sum += std::sin(frequency * along_mm + phase);
    return sum * std::sqrt(2.0 / 3.0);
  }

 private:
  std::array<std::pair<double, double>, 3> sines_{};
};

}  // namespace

std::vector<double> SpreadViewsDeg(int count, bool all_around) {
  std::vector<double> views;
  for (int i = 0; i < std::clamp(count, 1, 36); ++i) {
    if (all_around) {
      views.push_back(360.0 * i / count);
    } else {
      views.push_back(count <= 1 ? 0.0 : -70.0 + 140.0 * i / (count - 1));
    }
  }
  return views;
}

std::vector<hal::Pose> ScanPath(const std::vector<hal::SpineSegment>& spine,
                                const ScanPathOptions& options, std::uint64_t seed) {
  std::vector<hal::Pose> poses;
  if (spine.empty()) return poses;
  const double length_mm = spine.back().from_start_mm + spine.back().length_mm;
  const double spacing_mm = std::max(options.profile_spacing_mm, 1e-3);
  const auto steps = static_cast<std::size_t>(
      std::min((length_mm + 2 * options.overrun_mm) / spacing_mm, double{kMaxProfiles}));
  Random random(seed, 0x70617468);
  for (const double view_deg : options.views_deg) {
    std::array<Swing, 6> swings = {Swing(random), Swing(random), Swing(random),
                                   Swing(random), Swing(random), Swing(random)};
    Vector3d side = spine.front().normal;  // the view before, where `up` says nothing
    std::size_t at = 0;
    std::vector<hal::Pose> pass;
    for (std::size_t i = 0; i <= steps && poses.size() + pass.size() < kMaxProfiles; ++i) {
      const double along_mm = static_cast<double>(i) * spacing_mm - options.overrun_mm;
      while (at + 1 < spine.size() && along_mm >= spine[at + 1].from_start_mm) ++at;
      // Before the start and after the end the tube's straights go on.
      const double in_segment_mm = along_mm - spine[at].from_start_mm;
      const Vector3d center = spine[at].PointAt(in_segment_mm);
      const Vector3d tangent = spine[at].TangentAt(in_segment_mm).normalized();
      // Along the vertical there is no upside: the sensor then stays where it is.
      Vector3d upside = Across(options.up, tangent) + 0.3 * Across(side, tangent).normalized();
      if (upside.norm() < 1e-6) upside = tangent.unitOrthogonal();
      side = upside.normalized();
      const Vector3d view = Eigen::AngleAxisd(view_deg * hal::kRadiansPerDegree, tangent) * side;
      Eigen::Matrix3d R_WS;
      R_WS.col(0) = tangent.cross(view);
      R_WS.col(1) = -tangent;
      R_WS.col(2) = -view;
      hal::Pose X_WS{center + options.standoff_mm * view, Eigen::Quaterniond(R_WS).normalized()};
      const auto swing = [&](std::size_t axis) { return swings[axis].At(along_mm); };
      const Vector3d shift = options.jitter_mm * Vector3d(swing(0), swing(1), swing(2));
      const Vector3d turn =
          options.jitter_deg * hal::kRadiansPerDegree * Vector3d(swing(3), swing(4), swing(5));
      hal::Pose hand{shift, Eigen::Quaterniond::Identity()};
      if (turn.norm() > 0) {
        hand.orientation = Eigen::AngleAxisd(turn.norm(), turn.normalized());
      }
      pass.push_back(X_WS * hand);
    }
    if (options.reverse) std::reverse(pass.begin(), pass.end());
    poses.insert(poses.end(), pass.begin(), pass.end());
  }
  return poses;
}

}  // namespace bendloop::drivers
