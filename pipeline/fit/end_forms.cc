// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/end_forms.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "pipeline/math/circle_sectors.h"

namespace bendloop::pipeline {
namespace {

struct EndFormSettings {
  // [sigma] and [of r_P] A point further out than both is none of the plain tube's.
  double out_sigmas = 5.0, out = 0.04;
  // [of r_P] What is further from the axis is no fitting.
  double widest = 3.0;
  // [of r_P] Of the places along the axis that are looked at one by one.
  double bin = 0.25;
  // [of r_P] A fitting begins no further than this before the plain tube's end, and has no longer
  // gaps than this.
  double overlap = 1.0, gap = 0.75;
  // Of the points that the tube has in a bin: so many stand for the fitting there.
  double least_part = 0.1;
  // Of sixteen sides: a fitting is seen on so many, a clamp or a table on fewer; and on so many of
  // those that show the tube right behind it, another tube that passes its end on fewer.
  int least_sides = 6;
  double of_tubes_sides = 0.6;
  // [of r_P] What sticks out no further than this along the tube is a burr.
  double least_length = 0.15;

  // [of r_P] Of the steps beyond the end, and of the ball about each in which points go on.
  double step = 2.0, ball = 2.2;
  // Points in a ball; fewer are fliers.
  std::size_t least_points = 5;
  // [of r_P] So far apart points of a ball may be from their middle, or they fill the space.
  double widest_ball = 1.7;
  // [of r_P] What ends sooner is no tube that goes on.
  double least_continuation = 4.0, least_thin_continuation = 2.0;
  // [of the usual points a length] Fewer are a thin end. [of r_P] Beyond one a tube that bends away
  // is looked for in a ball so large, so far ahead.
  double last_piece = 1.0;
  double thin = 0.2, wide_ball = 5.0, wide_ahead = 1.0;
  double back = -0.3;  // [cosine] What lies further back is none.
  int most_steps = 500;
};
constexpr EndFormSettings kEndForms;
constexpr unsigned kEndSides = 16;

// Points about an end by their place along its axis.
struct AlongAxis {
  std::vector<double> out_mm;               // beyond the end, of points that stand out
  std::vector<double> standing_mm;          // how far, of the same points
  std::vector<unsigned> side;               // of the turn, of the same points
  std::array<bool, kEndSides> tube_side{};  // of the turn: where the plain tube is seen
  double on_tube_per_mm = 0;                // points of the plain tube
  double last_per_mm = 0;                   // of its last piece, however short its straight is
};

AlongAxis Sorted(const PlainEnd& end, double r_mm, double noise_mm,
                 std::span<const PointBlock> near) {
  const Eigen::Vector3d u = end.outward.unitOrthogonal(), v = end.outward.cross(u);
  const double out_mm = std::max(kEndForms.out_sigmas * noise_mm, kEndForms.out * r_mm);
  AlongAxis along;
  double on_tube = 0, last = 0;
  for (const PointBlock& block : near) {
    for (const Eigen::Vector3d& point : block.points) {
      const Eigen::Vector3d from = point - end.position_mm;
      const double at_mm = from.dot(end.outward);
      const double x = from.dot(u), y = from.dot(v);
      const double off_mm = std::hypot(x, y) - r_mm;
      if (at_mm < -3.0 * r_mm || at_mm > kEndFormReach * r_mm) continue;
      const bool is_on = std::abs(off_mm) < out_mm && at_mm < 0;
      if (is_on && at_mm < -r_mm) on_tube += 1;
      if (is_on) along.tube_side[AzimuthSector<kEndSides>(x, y)] = true;
      if (is_on && at_mm > -kEndForms.last_piece * r_mm) last += 1;
      if (off_mm < out_mm || off_mm > (kEndForms.widest - 1.0) * r_mm) continue;
      if (at_mm < -kEndForms.overlap * r_mm) continue;
      along.out_mm.push_back(at_mm);
      along.standing_mm.push_back(off_mm);
      along.side.push_back(AzimuthSector<kEndSides>(x, y));
    }
  }
  along.on_tube_per_mm = on_tube / (2.0 * r_mm);
  along.last_per_mm = last / (kEndForms.last_piece * r_mm);
  return along;
}

// From the plain end on, as long as enough points stand out.
FoundEnd Fitting(const AlongAxis& along, double r_mm, double noise_mm) {
  const double bin_mm = kEndForms.bin * r_mm;
  const auto bins =
      static_cast<std::size_t>((kEndFormReach + kEndForms.overlap) / kEndForms.bin) + 1;
  const auto bin_of = [&](double at_mm) {
    return std::min(bins - 1,
                    static_cast<std::size_t>((at_mm + kEndForms.overlap * r_mm) / bin_mm));
  };
  std::vector<double> count(bins, 0.0);
  for (const double at_mm : along.out_mm) count[bin_of(at_mm)] += 1;
  const double least = std::max(4.0, kEndForms.least_part * along.on_tube_per_mm * bin_mm);
  const auto most_gap = static_cast<std::size_t>(kEndForms.gap / kEndForms.bin);
  const std::size_t at_end = bin_of(0.0);
  std::size_t last = 0, since = 0;
  bool any = false;
  for (std::size_t i = 0; i < bins && (since <= most_gap || i <= at_end + most_gap); ++i) {
    since = count[i] >= least ? 0 : since + 1;
    if (since == 0) last = i, any = true;
  }
  FoundEnd found;
  if (!any) return found;
  std::vector<double> ends;
  std::array<bool, kEndSides> seen{};
  double standing_mm = 0;
  for (std::size_t i = 0; i < along.out_mm.size(); ++i) {
    if (bin_of(along.out_mm[i]) > last + 1) continue;
    ends.push_back(along.out_mm[i]);
    seen[along.side[i]] = true;
    standing_mm = std::max(standing_mm, along.standing_mm[i]);
  }
  const auto sides = std::count(seen.begin(), seen.end(), true);
  const auto of_tube = std::count(along.tube_side.begin(), along.tube_side.end(), true);
  if (sides < kEndForms.least_sides ||
      static_cast<double>(sides) < kEndForms.of_tubes_sides * static_cast<double>(of_tube)) {
    return found;
  }
  // The outermost few may be fliers. The third from the end lies three gaps before it, to the root
  // of three, as points are spread by chance.
  const std::size_t beyond = std::min<std::size_t>(2, ends.size() - 1);
  std::nth_element(ends.begin(), ends.end() - 1 - static_cast<std::ptrdiff_t>(beyond), ends.end());
  const double end_mm = ends[ends.size() - 1 - beyond];
  if (end_mm < kEndForms.least_length * r_mm) return found;
  const double per_point_mm =
      (end_mm + kEndForms.overlap * r_mm) / static_cast<double>(ends.size());
  found.form.length_mm = end_mm + 3.0 * per_point_mm;
  found.form.outside_mm = standing_mm;
  found.sigma_mm = std::hypot(std::sqrt(3.0) * per_point_mm, noise_mm);
  return found;
}

struct Ball {
  std::size_t points = 0;
  Eigen::Vector3d middle_mm = Eigen::Vector3d::Zero();
  double spread_mm = 0;
  double farthest_mm = 0;  // from the place that is left, in the direction of the steps
};

Ball BallAbout(const Eigen::Vector3d& center_mm, double radius_mm, const Eigen::Vector3d& from_mm,
               const Eigen::Vector3d& direction, std::span<const PointBlock> blocks) {
  Ball crowd;
  double squares = 0;
  for (const PointBlock& block : blocks) {
    const double near_mm = radius_mm + block.half_diagonal_mm;
    if ((block.center_mm - center_mm).squaredNorm() > near_mm * near_mm) continue;
    for (const Eigen::Vector3d& point : block.points) {
      const Eigen::Vector3d off = point - center_mm;
      if (off.squaredNorm() > radius_mm * radius_mm) continue;
      ++crowd.points;
      crowd.middle_mm += off;
      squares += off.squaredNorm();
      crowd.farthest_mm = std::max(crowd.farthest_mm, (point - from_mm).dot(direction));
    }
  }
  if (crowd.points == 0) return crowd;
  const auto n = static_cast<double>(crowd.points);
  crowd.middle_mm /= n;
  crowd.spread_mm = std::sqrt(std::max(0.0, squares / n - crowd.middle_mm.squaredNorm()));
  crowd.middle_mm += center_mm;
  return crowd;
}

// Steps from ball to ball, as far as there are points in them; beyond a thin end also to where the
// tube bends away.
double ContinuesMm(const PlainEnd& end, double r_mm, std::span<const PointBlock> others,
                   bool is_thin) {
  Eigen::Vector3d at = end.position_mm, direction = end.outward;
  double way_mm = 0, last_mm = 0;
  int empty = 0;
  for (int i = 0; i < kEndForms.most_steps && empty < 2; ++i) {
    const double step_mm = kEndForms.step * r_mm;
    const auto ahead = [&](const Eigen::Vector3d& towards) {
      return BallAbout(at + step_mm * towards, kEndForms.ball * r_mm, at, towards, others);
    };
    const auto is_tube = [r_mm](const Ball& ball) {
      return ball.points >= kEndForms.least_points && ball.spread_mm < kEndForms.widest_ball * r_mm;
    };
    Ball crowd = ahead(direction);
    if (is_thin && !is_tube(crowd)) {
      const Ball about = BallAbout(at + kEndForms.wide_ahead * r_mm * direction,
                                   kEndForms.wide_ball * r_mm, at, direction, others);
      const Eigen::Vector3d towards = (about.middle_mm - at).normalized();
      if (about.points >= kEndForms.least_points && towards.dot(direction) > kEndForms.back) {
        crowd = ahead(towards);
        if (is_tube(crowd)) direction = towards;
      }
    }
    const bool goes_on = is_tube(crowd);
    empty = goes_on ? 0 : empty + 1;
    if (goes_on) {
      const Eigen::Vector3d towards = (crowd.middle_mm - at).normalized();
      direction = (direction + towards).normalized();
      last_mm = way_mm + std::max(step_mm, crowd.farthest_mm);
    }
    at += step_mm * direction;
    way_mm += step_mm;
  }
  const double least = is_thin ? kEndForms.least_thin_continuation : kEndForms.least_continuation;
  return last_mm < least * r_mm ? 0.0 : last_mm;
}

}  // namespace

FoundEnd FindFitting(const PlainEnd& end, double pipe_radius_mm, double noise_mm,
                     std::span<const PointBlock> near) {
  return Fitting(Sorted(end, pipe_radius_mm, noise_mm, near), pipe_radius_mm, noise_mm);
}

FoundEnd FindEndForm(const PlainEnd& end, double pipe_radius_mm, double noise_mm,
                     std::span<const PointBlock> near, std::span<const PointBlock> others,
                     double usual_per_mm) {
  const AlongAxis along = Sorted(end, pipe_radius_mm, noise_mm, near);
  FoundEnd found = Fitting(along, pipe_radius_mm, noise_mm);
  const PlainEnd beyond{end.position_mm + found.form.length_mm * end.outward, end.outward};
  const bool is_thin =
      std::max(along.on_tube_per_mm, along.last_per_mm) < kEndForms.thin * usual_per_mm;
  found.form.continues_mm = ContinuesMm(beyond, pipe_radius_mm, others, is_thin);
  return found;
}

}  // namespace bendloop::pipeline
