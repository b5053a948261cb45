// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/ray_bound.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>
#include <random>
#include <utility>
#include <vector>

#include "drivers/simulated_scanner/tube_surface.h"
#include "hal/angles.h"
#include "hal/spine.h"
#include "pipeline/features/opening_border.h"
#include "pipeline/features/posterior.h"
#include "tests/support/cut_walls.h"

namespace bendloop::bench {
namespace {

using Eigen::Vector3d;

// Where the rays of the scan meet the round tube first, whose ends go on by `longer_mm`; `take`
// gets each such point that the scanner could see, line by line, and whether the ray beside it came
// just before.
void ForEachRay(const CutScan& scanned, const Vector3d& about_mm, double reach_mm, double longer_mm,
                const std::function<void(const Vector3d&, bool)>& take) {
  const drivers::VirtualScanOptions& options = scanned.options;
  const drivers::VirtualScan scan(scanned.tube, options);
  hal::Tube round = scanned.tube;
  round.program.rows.front().length_mm += longer_mm;
  round.program.rows.back().length_mm += longer_mm;
  round.X_WT.position_mm -= longer_mm * (round.X_WT.orientation * Vector3d::UnitX());
  const drivers::TubeSurface skin(round);
  const double least_cosine = std::cos(options.max_incidence_deg * hal::kRadiansPerDegree);
  hal::LaserProfile profile(scan.max_points());
  for (std::size_t k = 0; k < scan.profile_count(); ++k) {
    scan.Make(k, profile);
    const Eigen::Matrix3d axes = profile.X_WS.orientation.toRotationMatrix();
    const Vector3d& from = profile.X_WS.position_mm;
    if (std::abs((about_mm - from).dot(axes.col(1))) > reach_mm) continue;
    int before = -2;
    for (int i = 0; i < options.rays; ++i) {
      const double angle =
          (2.0 * i / (options.rays - 1) - 1) * options.fan_half_angle_deg * hal::kRadiansPerDegree;
      const drivers::Ray ray{from, std::sin(angle) * axes.col(0) + std::cos(angle) * axes.col(2)};
      std::optional<drivers::Hit> first;
      for (std::size_t part = 0; part < skin.part_count(); ++part) {
        const auto hit = skin.FirstHit(part, ray, 0, first ? first->along_mm : options.far_mm);
        if (hit) first = hit;
      }
      if (!first || -ray.direction.dot(first->normal) < least_cosine) continue;
      const Vector3d point = ray.At(first->along_mm);
      if ((point - about_mm).norm() >= reach_mm) continue;
      take(point, std::exchange(before, i) == i - 1);
    }
  }
}

// Where a ray meets the round tube, and whether the wall is seen there.
struct RayPlace {
  Eigen::Vector2d place;
  bool follows = false;  // on the place before it, in its line
  bool is_seen = false;
};
using OffMm = std::function<double(const Eigen::VectorXd&, const Eigen::Vector2d&)>;

// How a scan tells of a border.
struct Sight {
  double blur_mm = 0;  // samples lie beside where the wall was met
  double lost = 0;     // of the spots that lie on the wall and beside it
  std::uint64_t seed = 0;
};
// Rays come from all within the incidence that a scanner sees: noise displaces samples along the
// wall by half of it, about.
Sight SightOf(const CutScan& scanned, double lost) {
  return {0.5 * scanned.options.noise_mm, lost, scanned.options.seed};
}

// Sees what a scan would with the border at `truth`.
void See(const OffMm& off_mm, const Eigen::VectorXd& truth, const Sight& sight,
         std::vector<RayPlace>& places) {
  std::mt19937_64 random(sight.seed);
  std::normal_distribution<double> normal;
  bool was_wall = true;
  for (RayPlace& of : places) {
    const double off = off_mm(truth, of.place);
    const bool is_wall = off > 0;
    const bool is_edge = of.follows && is_wall && !was_wall;
    of.is_seen = off + sight.blur_mm * normal(random) > 0 &&
                 !(is_edge && tests::Uniform(random, 0, 1) < sight.lost);
    was_wall = is_wall;
  }
}

// The spread of all numbers by which the wall is seen where it is; `off_mm`: of a place from the
// border, by the numbers. The truth is `start`, `scale` about how far it may be left.
Eigen::VectorXd Spread(const std::vector<RayPlace>& places, const Eigen::VectorXd& start,
                       const Eigen::VectorXd& scale, const Sight& sight, const OffMm& off_mm) {
  constexpr double kLeast = 1e-12;  // probability
  if (places.empty()) return {};
  pipeline::Posterior posterior{start, scale.array().square().matrix().asDiagonal(), 0.0};
  // What sharp borders leave free may be a needle: blurred ones lead there.
  for (const double more_mm : {0.5 * scale[0], 0.1 * scale[0], 0.0}) {
    const double blur_mm = std::max(std::hypot(sight.blur_mm, more_mm), 1e-9);
    const double per_mm = 1.0 / (std::numbers::sqrt2 * blur_mm);
    posterior = pipeline::SamplePosterior(posterior, 4000, [&](const Eigen::VectorXd& x) {
      double log = 0;
      bool was_wall = true;
      for (const RayPlace& of : places) {
        const double off = off_mm(x, of.place);
        const bool is_wall = off > 0;
        const bool is_edge = of.follows && is_wall && !was_wall;
        const double seen = 0.5 * std::erfc(-off * per_mm) * (is_edge ? 1.0 - sight.lost : 1.0);
        log += std::log(std::max(kLeast, of.is_seen ? seen : 1.0 - seen));
        was_wall = is_wall;
      }
      return log;
    });
  }
  return posterior.covariance.diagonal().cwiseMax(0.0).cwiseSqrt();
}

// Those further from the border say nothing of it.
double NearMm(const CutScan& scanned) {
  return std::max(1.5, 1.5 * scanned.options.path.profile_spacing_mm);
}
// About how far a border may be left.
double ScaleMm(const CutScan& scanned) { return 0.1 * scanned.options.path.profile_spacing_mm; }

}  // namespace

Eigen::VectorXd RayBound(const CutScan& scanned, const hal::WallOpening& opening) {
  const double r_mm = scanned.tube.pipe_radius_mm;
  const auto segments = hal::SpineSegments(scanned.tube.program, scanned.tube.X_WT);
  const hal::SurfaceFrame frame = hal::FrameAt(segments, opening.along_mm, opening.around_deg);
  pipeline::OpeningBorder truth;
  truth.pipe_radius_mm = r_mm;
  truth.length_mm = opening.length_mm;
  truth.width_mm = opening.width_mm;
  truth.axis_rad = opening.axis_deg * hal::kRadiansPerDegree;
  const bool is_hole = opening.is_hole();
  const Eigen::Index n = is_hole ? 3 : 5;
  const double near_mm = NearMm(scanned);
  Eigen::VectorXd start = Eigen::VectorXd::Zero(n);
  Eigen::VectorXd scale = Eigen::VectorXd::Constant(n, ScaleMm(scanned));
  start[2] = truth.width_mm;
  if (!is_hole)
    start[3] = truth.length_mm, start[4] = truth.axis_rad, scale[4] = scale[3] / truth.length_mm;
  const auto off = [&](const Eigen::VectorXd& x, const Eigen::Vector2d& place) {
    pipeline::OpeningBorder border = truth;
    border.middle_mm = x.head<2>();
    border.width_mm = x[2];
    border.length_mm = is_hole ? x[2] : x[3];
    if (!is_hole) border.axis_rad = x[4];
    return border.DistanceMm(place);
  };
  std::vector<RayPlace> places;
  bool was_near = false;
  const double reach_mm = 0.5 * opening.length_mm + near_mm;
  ForEachRay(scanned, frame.spine_mm + r_mm * frame.outward, reach_mm, 0.0,
             [&](const Vector3d& point, bool follows) {
               const Vector3d from = point - frame.spine_mm;
               const Eigen::Vector2d place(from.dot(frame.tangent), from.dot(frame.sideways()));
               const bool is_near =
                   from.dot(frame.outward) > 0 && std::abs(off(start, place)) < near_mm;
               if (is_near) places.push_back({place, follows && was_near, false});
               was_near = is_near;
             });
  const Sight sight = SightOf(scanned, scanned.options.mixed_pixel_fraction);
  See(off, start, sight, places);
  return Spread(places, start, scale, sight, off);
}

Eigen::Vector3d RayBound(const CutScan& scanned, bool at_start) {
  const double r_mm = scanned.tube.pipe_radius_mm;
  const auto segments = hal::SpineSegments(scanned.tube.program, scanned.tube.X_WT);
  const double length_mm = hal::SpineLength(scanned.tube.program);
  const hal::EndCut& cut =
      at_start ? scanned.options.features.first_end : scanned.options.features.last_end;
  const hal::SurfaceFrame frame =
      hal::FrameAt(segments, at_start ? 0.0 : length_mm, cut.around_deg);
  const Vector3d outward = at_start ? Vector3d(-frame.tangent) : frame.tangent;
  const double rise_mm = r_mm * std::tan(cut.obliquity_deg * hal::kRadiansPerDegree);
  const Eigen::Vector3d truth(0, rise_mm, 0);
  // Places: around, from where the tube is longest, and within the end at its axis.
  const auto off = [](const Eigen::VectorXd& x, const Eigen::Vector2d& place) {
    return x[0] + x[1] * std::cos(place.x()) + x[2] * std::sin(place.x()) - place.y();
  };
  const double near_mm = NearMm(scanned);
  std::vector<RayPlace> places;
  ForEachRay(scanned, frame.spine_mm, rise_mm + 1.5 * r_mm + near_mm, 3.0 * r_mm,
             [&](const Vector3d& point, bool) {
               const Vector3d from = point - frame.spine_mm;
               const Eigen::Vector2d place(
                   std::atan2(from.dot(frame.sideways()), from.dot(frame.outward)),
                   from.dot(outward));
               if (std::abs(off(truth, place)) < near_mm) places.push_back({place});
             });
  // Beside an end there is no other wall that a spot could lie on.
  const Sight sight = SightOf(scanned, 0.0);
  See(off, truth, sight, places);
  const Eigen::Vector3d scale = Eigen::Vector3d::Constant(ScaleMm(scanned));
  const Eigen::VectorXd spread = Spread(places, truth, scale, sight, off);
  if (spread.size() == 0) return Eigen::Vector3d::Constant(NAN);
  return {spread[0], spread[1] / r_mm, spread[2] / r_mm};
}

}  // namespace bendloop::bench
