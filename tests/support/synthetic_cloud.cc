// SPDX-License-Identifier: Apache-2.0
#include "tests/support/synthetic_cloud.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "hal/spine.h"
#include "tests/support/uniform.h"

namespace bendloop::tests {
namespace {

constexpr double kPi = std::numbers::pi;

}  // namespace

bool TouchesItself(const hal::Tube& tube) {
  const auto segments = hal::SpineSegments(tube.program, tube.X_WT);
  std::vector<std::pair<double, Eigen::Vector3d>> points;
  for (const auto& segment : segments) {
    const int steps = std::max(1, static_cast<int>(segment.length_mm / tube.pipe_radius_mm * 2));
    for (int i = 0; i < steps; ++i) {
      const double along = segment.length_mm * i / steps;
      points.emplace_back(segment.from_start_mm + along, segment.PointAt(along));
    }
  }
  const double r = tube.pipe_radius_mm;
  for (std::size_t i = 0; i < points.size(); ++i) {
    for (std::size_t j = i + 1; j < points.size(); ++j) {
      if ((points[i].second - points[j].second).norm() < 3.0 * r &&
          points[j].first - points[i].first > 2.0 * kPi * r) {
        return true;
      }
    }
  }
  return false;
}

std::vector<Eigen::Vector3d> SyntheticCloud(const hal::Tube& tube, const CloudOptions& options,
                                            std::mt19937_64& random) {
  const auto segments = hal::SpineSegments(tube.program, tube.X_WT);
  const double total = hal::SpineLength(tube.program);
  std::normal_distribution<double> noise(0.0, options.noise_mm);
  std::vector<Eigen::Vector3d> points;
  points.reserve(options.points);
  const double r = tube.pipe_radius_mm;
  std::vector<Eigen::Vector3d> displaced;  // by stripe
  if (options.profile_error_mm > 0 && options.stripes_mm > 0) {
    std::normal_distribution<double> error(0.0, options.profile_error_mm);
    displaced.resize(static_cast<std::size_t>(total / options.stripes_mm) + 3);
    for (Eigen::Vector3d& d : displaced) d = {error(random), error(random), error(random)};
  }
  while (points.size() < options.points) {
    // Every laser line is as dense as the others, the last before the end too.
    double s = Uniform(random, 0, total + options.stripes_mm);
    const double phi = Uniform(random, 0, 2 * kPi);
    std::size_t stripe = 0;
    if (options.stripes_mm > 0) {
      const double before = options.first_stripe_mm + options.stripe_tilt * r * std::cos(phi);
      const double nth = std::floor((s - before) / options.stripes_mm);
      s = before + nth * options.stripes_mm;
      if (s < 0 || s > total) continue;
      stripe = static_cast<std::size_t>(std::max(0.0, nth));
    }
    const auto* segment = &segments.back();
    for (const auto& candidate : segments) {
      if (s < candidate.from_start_mm + candidate.length_mm) {
        segment = &candidate;
        break;
      }
    }
    const double along = s - segment->from_start_mm;
    const Eigen::Vector3d tangent = segment->TangentAt(along);
    const Eigen::Vector3d inward = segment->normal.cross(tangent);
    const Eigen::Vector3d out = std::cos(phi) * inward + std::sin(phi) * segment->normal;
    if (options.view_W && out.dot(*options.view_W) < 0.05) continue;
    // Area of a torus grows away from its centre: accept in proportion.
    if (segment->is_arc()) {
      const double area = 1.0 - r / segment->bend_radius_mm * std::cos(phi);
      if (Uniform(random, 0, 1.0 + r / segment->bend_radius_mm) > area) continue;
    }
    double radius = r;
    if (segment->is_arc() && options.ovality > 0) {
      const double middle = std::sin(kPi * along / segment->length_mm);
      radius *= 1.0 - 0.5 * options.ovality * middle * std::cos(2 * phi);
    }
    Eigen::Vector3d p = segment->PointAt(along) + (radius + noise(random)) * out;
    if (!displaced.empty()) p += displaced[std::min(stripe, displaced.size() - 1)];
    if (Uniform(random, 0, 1) < options.fliers) {
      p += Eigen::Vector3d(Uniform(random, -5, 5), Uniform(random, -5, 5), Uniform(random, -5, 5)) *
           r;
    }
    points.push_back(p);
  }
  return points;
}

hal::Pose RandomPose(double range_mm, std::mt19937_64& random) {
  std::normal_distribution<double> normal;
  const Eigen::Quaterniond q(normal(random), normal(random), normal(random), normal(random));
  return {
      Eigen::Vector3d(Uniform(random, -range_mm, range_mm), Uniform(random, -range_mm, range_mm),
                      Uniform(random, -range_mm, range_mm)),
      q.normalized()};
}

hal::Tube RandomTube(const RandomTubeOptions& options, std::mt19937_64& random) {
  const double r = options.pipe_radius_mm;
  for (;;) {
    hal::Tube tube;
    tube.pipe_radius_mm = r;
    const double common = r * Uniform(random, options.min_bend_radius, options.max_bend_radius);
    for (int i = 0; i < options.bends; ++i) {
      const double length = r * Uniform(random, options.min_straight, options.max_straight);
      const double own = r * Uniform(random, options.min_bend_radius, options.max_bend_radius);
      tube.program.rows.push_back({length, i == 0 ? 0.0 : Uniform(random, -180, 180),
                                   Uniform(random, options.min_angle_deg, options.max_angle_deg),
                                   options.one_bend_radius ? common : own});
    }
    tube.program.rows.push_back(
        {r * Uniform(random, std::max(3.0, options.min_straight), options.max_straight), 0.0, 0.0,
         std::nullopt});
    tube.program.rows.front().length_mm =
        r * Uniform(random, std::max(3.0, options.min_straight), options.max_straight);
    tube.X_WT = RandomPose(300, random);
    if (!TouchesItself(tube)) return tube;
  }
}

hal::Tube PaperTube() {
  hal::Tube tube;
  tube.pipe_radius_mm = 4.0;
  tube.program.rows = {{42.0, 0, 35.0, 12.0},
                       {38.0, 60.0, 90.0, 12.0},
                       {30.0, -120.0, 8.0, 12.0},
                       {45.0, 90.0, 60.0, 12.0},
                       {0.0, 0, 0, std::nullopt}};
  tube.program.rows.back().length_mm = 268.0 - hal::SpineLength(tube.program);
  return tube;
}

}  // namespace bendloop::tests
