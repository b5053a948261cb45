// SPDX-License-Identifier: Apache-2.0
#include "pipeline/features/end_profile.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <vector>

#include "pipeline/fit/end_face.h"
#include "pipeline/math/circle_sectors.h"
#include "pipeline/math/quantiles.h"

namespace bendloop::pipeline {
namespace {

struct ProfileSettings {
  // [of r_P] From the end of all into the tube, at most its end straight: what begins further in is
  // no form of the end, and bends are none.
  double look = 5.0;
  // [of r_P] What is further from the axis, or nearer to it, is not the end's.
  double widest = 3.0, narrowest = 0.8;
  // [of r_P] Of the places along the axis at least, and points in each of them on average.
  double place = 0.05, points = 48.0;
  // Points of a side that tell its radius, and sides of sixteen that tell the place's.
  double least_of_side = 2.0;
  int least_sides = 6;
  // [of r_P] and [sigma] A place is wider than the pipe, and something is there at all.
  double wider = 0.015, wider_sigmas = 4.0, least_height = 0.03;
  // Points further out than that, and [sigma] than noise takes them: with fewer nobody need look
  // closer.
  double by_noise = 3.5;
  double face_sigmas = 3.5;  // about the face of its cut where that is seen
  // Points of a place that tell whether the bore is among them: fewer are lines' or strays.
  std::size_t tells_bore = 40;
  // Part of a place's points that lie further in than what is certainly of its outer wall.
  double outer = 0.75;
  // [of r_P] and [sigma] The bore lies so far below the outer wall at least. [of a place] Where one
  // begins along the axis as the other ends they are a step of the wall.
  double below = 0.01, below_sigmas = 4.0, step = 0.33;
  std::size_t least_points = 20;
  std::size_t asked = 40'000;  // of all points, whether there are any
  // [of its height] The flank, whose line says where it begins.
  double flank_from = 0.15, flank_to = 0.7;
};
constexpr ProfileSettings kProfile;
constexpr unsigned kProfileSides = 16;

// Place and radius of a point near the end: from the end of all into the tube.
struct EndPoint {
  double from_end_mm = 0, radius_mm = 0;
  unsigned side = 0;
};

// A point beside the end's axis.
struct Beside {
  double from_end_mm, x, y, square;
};

// Calls `take` with every `stride`-th that is no further from the axis than what sits on an end,
// nor nearer, and no further than `beyond_mm` beyond the end of all.
template <class Take>
void ForBeside(const PlainEnd& end, double r_mm, double length_mm, std::span<const PointBlock> near,
               std::size_t stride, double beyond_mm, Take take) {
  const Eigen::Vector3d u = end.outward.unitOrthogonal(), v = end.outward.cross(u);
  const double widest_mm = kProfile.widest * r_mm, narrowest_mm = kProfile.narrowest * r_mm;
  const double look_mm = std::min(kProfile.look * r_mm, length_mm + end.straight_mm);
  std::size_t next = 0;
  for (const PointBlock& block : near) {
    for (; next < block.points.size(); next += stride) {
      const Eigen::Vector3d from = block.points[next] - end.position_mm;
      const double from_end_mm = length_mm - from.dot(end.outward);
      if (from_end_mm < -beyond_mm || from_end_mm > look_mm) continue;
      const double x = from.dot(u), y = from.dot(v), square = x * x + y * y;
      if (square > widest_mm * widest_mm || square < narrowest_mm * narrowest_mm) continue;
      take(Beside{from_end_mm, x, y, square});
    }
    next -= block.points.size();
  }
}

// The points about an end, from so far into the tube on as no face is seen any more.
struct EndPoints {
  std::vector<EndPoint> points;
  double from_mm = 0;
};
EndPoints PointsOf(const PlainEnd& end, double r_mm, double noise_mm, double length_mm,
                   std::span<const PointBlock> near) {
  const double out_mm = r_mm + std::max(kProfile.least_height * r_mm, kProfile.by_noise * noise_mm);
  // Of most ends some say that nothing is wider than the pipe.
  std::size_t wider = 0;
  const std::size_t stride = StrideTo(CountPoints(near), kProfile.asked);
  ForBeside(end, r_mm, length_mm, near, stride, 0.0,
            [&](const Beside& of) { wider += of.square > out_mm * out_mm ? 1 : 0; });
  EndPoints of_end;
  std::vector<EndPoint>& points = of_end.points;
  if (wider < kProfile.least_points) return of_end;
  ForBeside(end, r_mm, length_mm, near, 1, kProfile.face_sigmas * noise_mm, [&](const Beside& of) {
    points.push_back(
        {of.from_end_mm, std::sqrt(of.square), AzimuthSector<kProfileSides>(of.x, of.y)});
  });
  const bool knows_passes = std::any_of(
      near.begin(), near.end(), [](const PointBlock& block) { return !block.to_sensor.empty(); });
  if (!knows_passes) {
    std::vector<double> places_mm;  // from the end on, outwards
    for (const EndPoint& of : points) places_mm.push_back(-of.from_end_mm);
    const auto face = FindEndFace(places_mm, 0.0, noise_mm);
    if (face) of_end.from_mm = std::max(0.0, kProfile.face_sigmas * noise_mm - face->at_mm);
  }
  std::erase_if(points, [&](const EndPoint& of) { return of.from_end_mm < of_end.from_mm; });
  return of_end;
}

// A piece of the axis, and its points.
struct Piece {
  double middle_mm = 0, place_mm = 0;
  double slope = 0;  // of the outer wall in it, along the axis
  std::span<EndPoint> points;

  // The radius that a point would have in the middle.
  double Level(const EndPoint& point) const {
    return point.radius_mm - slope * (point.from_end_mm - middle_mm);
  }
};

// The points of a piece's outer wall: without those of the bore where that is seen, which lie all
// along it as much further in as the wall is thick.
std::span<const EndPoint> WithoutBore(const Piece& piece, double r_mm, double noise_mm) {
  const std::span<EndPoint> points = piece.points;
  std::sort(points.begin(), points.end(),
            [&](const EndPoint& a, const EndPoint& b) { return piece.Level(a) < piece.Level(b); });
  std::size_t outer = 0;
  double widest_mm = kProfile.below * r_mm + kProfile.below_sigmas * noise_mm;
  if (points.size() < kProfile.tells_bore) return points;
  // A stray outside is no wall.
  const double of_outer = kProfile.outer * static_cast<double>(points.size());
  for (std::size_t i = 1; i < static_cast<std::size_t>(of_outer); ++i) {
    const double gap_mm = piece.Level(points[i]) - piece.Level(points[i - 1]);
    if (gap_mm > widest_mm) widest_mm = gap_mm, outer = i;
  }
  const auto middle_mm = [](std::span<const EndPoint> of) {
    double sum_mm = 0;
    for (const EndPoint& point : of) sum_mm += point.from_end_mm;
    return sum_mm / static_cast<double>(of.size());
  };
  if (outer == 0) return points;
  const auto of_bore = points.first(outer), of_wall = points.subspan(outer);
  const double apart_mm = std::abs(middle_mm(of_bore) - middle_mm(of_wall));
  return apart_mm > kProfile.step * piece.place_mm ? std::span<const EndPoint>(points) : of_wall;
}

// Radius of a piece's outer wall, roughly.
double OuterMm(const Piece& piece) {
  std::vector<double> radii;
  for (const EndPoint& point : piece.points) radii.push_back(point.radius_mm);
  return Quantile(std::move(radii), kProfile.outer);
}

// One after the other, `place_mm` long, without those that have no points. They become sorted.
std::vector<Piece> PiecesOf(EndPoints& of_end, double place_mm) {
  std::vector<EndPoint>& points = of_end.points;
  const auto place_of = [&](const EndPoint& point) {
    return std::floor((point.from_end_mm - of_end.from_mm) / place_mm);
  };
  std::sort(points.begin(), points.end(),
            [&](const EndPoint& a, const EndPoint& b) { return place_of(a) < place_of(b); });
  std::vector<Piece> pieces;
  std::vector<double> outer_mm;
  for (auto first = points.begin(); first != points.end();) {
    const double at = place_of(*first);
    const auto last = std::find_if(first, points.end(),
                                   [&](const EndPoint& point) { return place_of(point) != at; });
    pieces.push_back({of_end.from_mm + (at + 0.5) * place_mm, place_mm, 0.0, {first, last}});
    outer_mm.push_back(OuterMm(pieces.back()));
    first = last;
  }
  for (std::size_t i = 0; i < pieces.size(); ++i) {
    const std::size_t before = i > 0 ? i - 1 : i, after = std::min(i + 1, pieces.size() - 1);
    const double way_mm = pieces[after].middle_mm - pieces[before].middle_mm;
    if (way_mm > 0) pieces[i].slope = (outer_mm[after] - outer_mm[before]) / way_mm;
  }
  return pieces;
}

// Radii of the points of a place along the axis, side by side.
struct Place {
  std::array<double, kProfileSides> count{}, sum_mm{};
  double points = 0;
};

// A place with its radius: the mean of its sides, whose scatter says how sure it is.
std::optional<RadiusAt> RadiusOf(double from_end_mm, const Place& place, double noise_mm) {
  double sides = 0, mean = 0, square = 0;
  for (std::size_t i = 0; i < kProfileSides; ++i) {
    if (place.count[i] < kProfile.least_of_side) continue;
    const double radius_mm = place.sum_mm[i] / place.count[i];
    sides += 1;
    mean += radius_mm;
    square += radius_mm * radius_mm;
  }
  if (sides < kProfile.least_sides) return std::nullopt;
  mean /= sides;
  const double variance = std::max(0.0, square / sides - mean * mean) / (sides - 1);
  const double least = noise_mm * noise_mm / place.points;
  return RadiusAt{from_end_mm, mean, std::sqrt(std::max(variance, least))};
}

// They become sorted.
std::vector<RadiusAt> Radii(EndPoints& of_end, double r_mm, double noise_mm) {
  const std::vector<EndPoint>& points = of_end.points;
  double far_mm = 0;
  for (const EndPoint& point : points) far_mm = std::max(far_mm, point.from_end_mm);
  const double place_mm = std::max(kProfile.place * r_mm,
                                   kProfile.points * far_mm / static_cast<double>(points.size()));
  std::vector<RadiusAt> radii;
  for (const Piece& piece : PiecesOf(of_end, place_mm)) {
    Place place;
    for (const EndPoint& point : WithoutBore(piece, r_mm, noise_mm)) {
      place.count[point.side] += 1;
      place.sum_mm[point.side] += point.radius_mm;
      place.points += 1;
    }
    if (const auto radius = RadiusOf(piece.middle_mm, place, noise_mm)) radii.push_back(*radius);
  }
  return radii;
}

// A place's radius is that of its middle, and not the mean of a wall that curves; and no surer than
// the end is that it is counted from. `radii`: one after the other, means.
void TakeToMiddles(double end_sigma_mm, std::vector<RadiusAt>& radii) {
  std::vector<RadiusAt> means = radii;
  for (std::size_t i = 0; i < radii.size(); ++i) {
    const RadiusAt& at = means[i];
    const RadiusAt& before = means[i > 0 ? i - 1 : i];
    const RadiusAt& after = means[std::min(i + 1, means.size() - 1)];
    const double up_mm = after.radius_mm - at.radius_mm, down_mm = at.radius_mm - before.radius_mm;
    const double steepest =
        std::max(std::abs(up_mm) / std::max(1e-9, after.from_end_mm - at.from_end_mm),
                 std::abs(down_mm) / std::max(1e-9, at.from_end_mm - before.from_end_mm));
    // Beside a kink, as where a flare begins, it curves by anything up to that.
    const double curved_mm = (up_mm - down_mm) / 24.0;
    radii[i].radius_mm -= curved_mm;
    radii[i].sigma_mm = std::hypot(std::hypot(at.sigma_mm, curved_mm), steepest * end_sigma_mm);
  }
}

struct Crossing {
  double at_mm = 0, sigma_mm = 0;
};

// Where the flank between two places, the first at the height's foot, meets the plain radius.
Crossing FlankFoot(std::span<const RadiusAt> radii, std::size_t foot, std::size_t top,
                   double r_mm) {
  const double height_mm = radii[top].radius_mm - r_mm;
  const int step = foot < top ? 1 : -1;
  double weights = 0, x = 0, h = 0, xx = 0, xh = 0, count = 0;
  const double about_mm = radii[top].from_end_mm;
  for (std::size_t i = foot;; i = static_cast<std::size_t>(static_cast<int>(i) + step)) {
    const double part = (radii[i].radius_mm - r_mm) / height_mm;
    if (part > kProfile.flank_from && part < kProfile.flank_to) {
      const double weight = 1.0 / (radii[i].sigma_mm * radii[i].sigma_mm);
      const double at = radii[i].from_end_mm - about_mm, up = radii[i].radius_mm - r_mm;
      weights += weight, x += weight * at, h += weight * up;
      xx += weight * at * at, xh += weight * at * up, count += 1;
    }
    if (i == top) break;
  }
  const double place_mm =
      radii.size() > 1 ? std::abs(radii[1].from_end_mm - radii[0].from_end_mm) : 0.0;
  const double spread = weights * xx - x * x;
  // Too steep for a line: between the last plain place and the first wider one.
  const Crossing step_up{radii[foot].from_end_mm - 0.5 * step * place_mm,
                         place_mm / std::sqrt(3.0)};
  if (count < 3 || !(spread > 0)) return step_up;
  const double slope = (weights * xh - x * h) / spread;
  if (slope * step <= 0) return step_up;
  const double mean = x / weights, up = h / weights;
  const double at = mean - up / slope;
  const double variance =
      (1.0 / weights + (at - mean) * (at - mean) * weights / spread) / (slope * slope);
  return {about_mm + at, std::hypot(std::sqrt(variance), place_mm / std::sqrt(12.0 * count))};
}

}  // namespace

void MeasureEndProfile(const PlainEnd& end, double pipe_radius_mm, double noise_mm,
                       double end_sigma_mm, std::span<const PointBlock> near, EndForm& form) {
  EndPoints of_end = PointsOf(end, pipe_radius_mm, noise_mm, form.length_mm, near);
  if (of_end.points.empty()) return;
  const std::vector<RadiusAt> radii = Radii(of_end, pipe_radius_mm, noise_mm);
  const auto is_wider = [&](const RadiusAt& at) {
    return at.radius_mm - pipe_radius_mm >
           std::max(kProfile.wider * pipe_radius_mm, kProfile.wider_sigmas * at.sigma_mm);
  };
  // The widest place, and what is wider about it.
  std::size_t top = 0;
  for (std::size_t i = 0; i < radii.size(); ++i) {
    if (radii[i].radius_mm > radii[top].radius_mm) top = i;
  }
  std::size_t first = top, last = top;
  while (first > 0 && is_wider(radii[first - 1])) --first;
  while (last < radii.size() && is_wider(radii[last])) ++last;
  // It has to begin within what is seen, and be high.
  if (last >= radii.size() || last - first < 2 ||
      radii[top].radius_mm - pipe_radius_mm < kProfile.least_height * pipe_radius_mm) {
    return;
  }
  const Crossing begins = FlankFoot(radii, last - 1, top, pipe_radius_mm);
  form.begins_mm = begins.at_mm;
  form.begins_sigma_mm = std::hypot(begins.sigma_mm, end_sigma_mm);
  if (first > 0) {
    const Crossing returns = FlankFoot(radii, first, top, pipe_radius_mm);
    form.returns_mm = returns.at_mm;
    form.returns_sigma_mm = std::hypot(returns.sigma_mm, end_sigma_mm);
  }
  form.profile.assign(
      radii.begin(), radii.begin() + static_cast<std::ptrdiff_t>(std::min(last + 2, radii.size())));
  TakeToMiddles(end_sigma_mm, form.profile);
}

}  // namespace bendloop::pipeline
