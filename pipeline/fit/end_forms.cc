// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/end_forms.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <tuple>
#include <utility>
#include <vector>

#include "pipeline/fit/end_face.h"
#include "pipeline/math/circle_sectors.h"

namespace bendloop::pipeline {
namespace {

struct EndFormSettings {
  // So many points about an end tell.
  std::size_t enough_points = 40'000;
  // [sigma] and [of r_P] A point further out than both is none of the plain tube's.
  double out_sigmas = 5.0, out = 0.04;
  // [of r_P] What is further from the axis is no fitting.
  double widest = 3.0;
  // [of r_P] Of the places along the axis that are looked at one by one.
  double bin = 0.25;
  std::size_t together = 3;  // of them that show the sides of one place
  // [of r_P] A fitting begins no further than this before the plain tube's end, and has no longer
  // gaps than this.
  double overlap = 1.0, gap = 0.75;
  // Of the points that the tube has in a bin: so many stand for the fitting there.
  double least_part = 0.1;
  // Of sixteen sides: a fitting is seen on so many, a clamp or a table on fewer; and on so many of
  // those that show the tube right behind it, another tube that passes its end on fewer.
  int least_sides = 6;
  double of_tubes_sides = 0.6;
  // [of r_P] What sticks out no further than this along the tube is a burr, unless it does so on so
  // many of the tube's sides, and further than points lie apart: then it was made.
  double least_length = 0.15, made_sides = 0.9, made_gaps = 4.0;

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

// Points about an end by their place along its axis; of many a part.
struct AlongAxis {
  std::vector<std::pair<double, unsigned>> on;  // of the wall beyond the end: where, and the side
  std::vector<double> out_mm;                   // beyond the end, of points that stand out
  std::vector<double> standing_mm;              // how far, of the same points
  std::vector<unsigned> side;                   // of the turn, of the same points
  std::array<bool, kEndSides> tube_side{};      // of the turn: where the plain tube is seen
  double on_tube_per_mm = 0;                    // points of the plain tube
  double last_per_mm = 0;                       // of its last piece, however short its straight is
  double part_of = 1;                           // each of these stands for so many
};

AlongAxis Sorted(const PlainEnd& end, double r_mm, double noise_mm,
                 std::span<const PointBlock> near) {
  const Eigen::Vector3d u = end.outward.unitOrthogonal(), v = end.outward.cross(u);
  const double out_mm = std::max(kEndForms.out_sigmas * noise_mm, kEndForms.out * r_mm);
  const std::size_t stride = StrideTo(CountPoints(near), kEndForms.enough_points);
  const OwnedBlocks few = Thinned(near, stride);
  AlongAxis along;
  along.part_of = static_cast<double>(stride);
  double on_tube = 0, last = 0;
  for (const PointBlock& block : std::span<const PointBlock>(few)) {
    for (const Eigen::Vector3d& point : block.points) {
      const Eigen::Vector3d from = point - end.position_mm;
      const double at_mm = from.dot(end.outward);
      if (at_mm < -3.0 * r_mm || at_mm > kEndFormReach * r_mm) continue;
      const double x = from.dot(u), y = from.dot(v);
      const double off_mm = std::sqrt(x * x + y * y) - r_mm;
      const bool is_on = std::abs(off_mm) < out_mm && at_mm < 0;
      if (is_on && at_mm < -r_mm) on_tube += 1;
      if (is_on) along.tube_side[AzimuthSector<kEndSides>(x, y)] = true;
      if (is_on && at_mm > -kEndForms.last_piece * r_mm) last += 1;
      if (std::abs(off_mm) < out_mm && at_mm >= 0) {
        along.on.emplace_back(at_mm, AzimuthSector<kEndSides>(x, y));
      }
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

// Bins along an end's axis, from the overlap on.
class EndBins {
 public:
  explicit EndBins(double r_mm)
      : r_mm_(r_mm),
        count_(static_cast<std::size_t>((kEndFormReach + kEndForms.overlap) / kEndForms.bin) + 1) {}
  std::size_t Of(double at_mm) const {
    return std::min(count_ - 1,
                    static_cast<std::size_t>((at_mm + kEndForms.overlap * r_mm_) / length_mm()));
  }
  std::size_t count() const { return count_; }
  double length_mm() const { return kEndForms.bin * r_mm_; }
  // Points that a fitting has in a bin, at least.
  double Least(const AlongAxis& along) const {
    return std::max(4.0, kEndForms.least_part * along.on_tube_per_mm * length_mm());
  }
  static std::size_t MostGap() { return static_cast<std::size_t>(kEndForms.gap / kEndForms.bin); }

 private:
  double r_mm_;
  std::size_t count_;
};

// Whether what is seen on these sides is seen all round: on this part of the tube's sides. On
// others a table may lie.
bool IsAllRound(const std::array<bool, kEndSides>& seen, const AlongAxis& along,
                double part = kEndForms.of_tubes_sides) {
  int sides = 0, of_tube = 0;
  for (unsigned i = 0; i < kEndSides; ++i) {
    of_tube += along.tube_side[i] ? 1 : 0;
    sides += along.tube_side[i] && seen[i] ? 1 : 0;
  }
  return sides >= kEndForms.least_sides &&
         static_cast<double>(sides) >= part * static_cast<double>(of_tube);
}

// The last bin in which enough points stand out, from the plain end on without wide gaps.
std::optional<std::size_t> LastBin(const AlongAxis& along, const EndBins& bins) {
  std::vector<double> count(bins.count(), 0.0);
  for (const double at_mm : along.out_mm) count[bins.Of(at_mm)] += 1;
  const std::size_t at_end = bins.Of(0.0);
  std::optional<std::size_t> last;
  std::size_t since = 0;
  for (std::size_t i = 0;
       i < bins.count() && (since <= EndBins::MostGap() || i <= at_end + EndBins::MostGap()); ++i) {
    since = count[i] >= bins.Least(along) ? 0 : since + 1;
    if (since == 0) last = i;
  }
  return last;
}

// Beyond a bead the plain tube goes on: places of its points there, as far as they have no wide
// gap.
std::vector<double> WallBeyond(const AlongAxis& along, const EndBins& bins, std::size_t last_bin) {
  std::vector<double> count(bins.count(), 0.0);
  for (const auto& [at_mm, side] : along.on) count[bins.Of(at_mm)] += 1;
  std::size_t last = last_bin, i = last_bin;
  for (; i < bins.count() && i <= last + EndBins::MostGap(); ++i) {
    if (count[i] >= bins.Least(along)) last = i;
  }
  std::array<bool, kEndSides> seen{};
  std::vector<double> places_mm;
  for (const auto& [at_mm, side] : along.on) {
    if (bins.Of(at_mm) < last_bin || bins.Of(at_mm) > last + 1) continue;
    places_mm.push_back(at_mm);
    seen[side] = true;
  }
  return IsAllRound(seen, along) ? places_mm : std::vector<double>();
}

// Whether what stands out does so all round at one place, and not on one side here and on another
// there, as a table does that the end leans against.
bool IsAllRoundSomewhere(const AlongAxis& along, const EndBins& bins, std::size_t last_bin) {
  std::vector<std::array<bool, kEndSides>> seen(bins.count());
  for (std::size_t i = 0; i < along.out_mm.size(); ++i) {
    const std::size_t bin = bins.Of(along.out_mm[i]);
    for (std::size_t near = bin; near < std::min(bin + kEndForms.together, bins.count()); ++near) {
      seen[near][along.side[i]] = true;
    }
  }
  return std::any_of(seen.begin(), seen.begin() + static_cast<std::ptrdiff_t>(last_bin) + 1,
                     [&](const auto& sides) { return IsAllRound(sides, along); });
}

// The outermost few may be fliers. The third from the end lies three gaps before it, to the root of
// three, as points are spread by chance.
double ThirdFromEnd(std::vector<double>& places_mm) {
  const std::size_t outer = std::min<std::size_t>(2, places_mm.size() - 1);
  const auto at = places_mm.end() - 1 - static_cast<std::ptrdiff_t>(outer);
  std::nth_element(places_mm.begin(), at, places_mm.end());
  return *at;
}

// From the plain end on, as long as enough points stand out.
FoundEnd Fitting(const AlongAxis& along, double r_mm, double noise_mm) {
  const EndBins bins(r_mm);
  FoundEnd found;
  const auto last = LastBin(along, bins);
  if (!last) return found;
  std::vector<double> ends;
  std::array<bool, kEndSides> beyond{};
  double standing_mm = 0;
  for (std::size_t i = 0; i < along.out_mm.size(); ++i) {
    if (bins.Of(along.out_mm[i]) > *last + 1) continue;
    ends.push_back(along.out_mm[i]);
    if (along.out_mm[i] > 0) beyond[along.side[i]] = true;
    standing_mm = std::max(standing_mm, along.standing_mm[i]);
  }
  if (!IsAllRoundSomewhere(along, bins, *last)) return found;
  std::vector<double> places_mm = ends;  // of what the tube ends with
  double end_mm = ThirdFromEnd(ends);
  double per_point_mm = (end_mm + kEndForms.overlap * r_mm) / static_cast<double>(ends.size());
  const bool is_made = IsAllRound(beyond, along, kEndForms.made_sides) &&
                       end_mm > kEndForms.made_gaps * per_point_mm;
  if (end_mm < kEndForms.least_length * r_mm && !is_made) return found;
  if (auto wall = WallBeyond(along, bins, *last); wall.size() > 2) {
    const double wall_mm = ThirdFromEnd(wall);
    if (wall_mm > end_mm) {
      per_point_mm = (wall_mm - end_mm) / static_cast<double>(wall.size());
      end_mm = wall_mm;
      places_mm = std::move(wall);
    }
  }
  found.form.length_mm = end_mm + 3.0 * per_point_mm;
  found.form.outside_mm = standing_mm;
  found.sigma_mm = std::hypot(std::sqrt(3.0) * per_point_mm, noise_mm);
  if (const auto face = FindEndFace(places_mm, end_mm, noise_mm)) {
    std::tie(found.form.length_mm, found.sigma_mm) = std::tie(face->at_mm, face->sigma_mm);
  }
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
  const double per_mm = along.part_of * std::max(along.on_tube_per_mm, along.last_per_mm);
  const bool is_thin = per_mm < kEndForms.thin * usual_per_mm;
  found.form.continues_mm = ContinuesMm(beyond, pipe_radius_mm, others, is_thin);
  return found;
}

}  // namespace bendloop::pipeline
