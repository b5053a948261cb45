// SPDX-License-Identifier: Apache-2.0
#include "pipeline/structure/end_sleeves.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <numeric>
#include <utility>
#include <vector>

#include "hal/spine.h"
#include "pipeline/fit/surface_points.h"
#include "pipeline/math/circle_sectors.h"
#include "pipeline/math/quantiles.h"

namespace bendloop::pipeline {
namespace {

struct SleeveSettings {
  // Bends that one may make at an end.
  std::size_t most_bends = 2;
  // [of r_P] How far from the end of the straight inside points are looked at, in bins so long; no
  // sleeve is longer than `longest`, none shorter, and none wider.
  double before = 3.0, beyond = 10.0, bin = 0.25, longest = 7.0, least_length = 0.75, widest = 1.6;
  // [of r_P] and [sigma of a bin's median] So much wider than the tube it is.
  double wider = 0.02, wider_sigmas = 4.0;
  // Points of a bin; fewer are fliers. Bins without that its points may leave.
  std::size_t least_points = 4, most_empty = 2;
  // [of r_P] and of it: one that no bends lead into is no thicker, and as thick everywhere.
  double in_reach = 0.25, even = 0.7;
  // Points of the tube that may be its face's. [of r_P] So far before them no others are.
  std::ptrdiff_t few = 3;
  double rim = 0.1;
  // [of r_P] About its axis its points are left out.
  double cut_wide = 2.0;
  // Of the points about an end: so many are looked at.
  std::size_t asked = 20'000;
  // Nodes that a tube is followed along.
  std::ptrdiff_t least_nodes = 3;
  // [of r_P] From its end on its face may be seen.
  double face = 0.5;
  // [sigma] A point on it, or on the tube, is no further off.
  double on_sigmas = 4.0;
  // Of the points: so many lie on the straight tube and the sleeve, and of those of the sleeve so
  // many on the tube with its bends at most.
  double explained = 0.85, by_bends = 0.8;
  // Of the sides that show the tube: so many show the sleeve.
  double of_sides = 0.6;
};
constexpr SleeveSettings kSleeve;
constexpr unsigned kSleeveSides = 16;
constexpr auto kFaceBins = static_cast<std::size_t>(kSleeve.face / kSleeve.bin);

struct AxisPoint {
  double out_mm, off_axis_mm;
  unsigned side;
  const Eigen::Vector3d* point;
};

// Points about an axis, by their place along it; of many a part.
std::vector<AxisPoint> PointsAbout(const PlainEnd& axis, double r_mm,
                                   std::span<const PointBlock> blocks) {
  const Eigen::Vector3d u = axis.outward.unitOrthogonal(), v = axis.outward.cross(u);
  std::vector<PointBlock> near;
  std::copy_if(blocks.begin(), blocks.end(), std::back_inserter(near),
               [&](const PointBlock& block) {
                 const Eigen::Vector3d to = block.center_mm - axis.position_mm;
                 const double along_mm = to.dot(axis.outward), more_mm = block.half_diagonal_mm;
                 return along_mm >= -kSleeve.before * r_mm - more_mm &&
                        along_mm <= kSleeve.beyond * r_mm + more_mm &&
                        to.cross(axis.outward).norm() <= kSleeve.widest * r_mm + more_mm;
               });
  const std::size_t stride = StrideTo(CountPoints(near), kSleeve.asked);
  std::vector<AxisPoint> points;
  std::size_t at = 0;  // in the block, of the next
  for (const PointBlock& block : near) {
    for (; at < block.points.size(); at += stride) {
      const Eigen::Vector3d from = block.points[at] - axis.position_mm;
      const double x = from.dot(u), y = from.dot(v), out_mm = from.dot(axis.outward);
      const double off_mm = std::sqrt(x * x + y * y);
      if (out_mm < -kSleeve.before * r_mm || out_mm > kSleeve.beyond * r_mm ||
          off_mm > kSleeve.widest * r_mm) {
        continue;
      }
      points.push_back({out_mm, off_mm, AzimuthSector<kSleeveSides>(x, y), &block.points[at]});
    }
    at -= block.points.size();
  }
  return points;
}

// Says of points whether they lie on the tube with its bends.
class OnBends {
 public:
  explicit OnBends(const SurfaceFit& fit)
      : frames_(SegmentFrames(hal::SpineSegments(fit.tube.program, fit.tube.X_WT),
                              kBeyond * fit.tube.pipe_radius_mm, fit.flattening)),
        all_(frames_.size()),
        r_mm_(fit.tube.pipe_radius_mm),
        reach_mm_(kSleeve.on_sigmas * fit.sigma_mm) {
    std::iota(all_.begin(), all_.end(), 0);
  }
  bool operator()(const Eigen::Vector3d& point) const {
    const NearSegment nearest = NearestSegment(point, frames_, all_);
    return nearest.segment >= 0 && std::abs(nearest.distance_mm - r_mm_) < reach_mm_;
  }

 private:
  std::vector<SegmentFrame> frames_;
  std::vector<std::int32_t> all_;
  double r_mm_, reach_mm_;
};

// The radius of a pipe from bin to bin along the axis, as far as it goes on.
struct RadiusBin {
  std::size_t points = 0;
  double median_mm = 0;
  bool is_wider = false;
};
std::vector<RadiusBin> RadiiOf(std::span<const AxisPoint> points, double r_mm, double sigma_mm) {
  const double bin_mm = kSleeve.bin * r_mm;
  std::vector<std::vector<double>> off_axis_mm(
      static_cast<std::size_t>(kSleeve.beyond / kSleeve.bin) + 1);
  for (const AxisPoint& point : points) {
    if (point.out_mm < 0) continue;
    off_axis_mm[static_cast<std::size_t>(point.out_mm / bin_mm)].push_back(point.off_axis_mm);
  }
  std::vector<RadiusBin> bins;
  std::size_t last = 0, empty = 0;
  for (std::vector<double>& in_bin : off_axis_mm) {
    RadiusBin& bin = bins.emplace_back();
    bin.points = in_bin.size();
    empty = bin.points < kSleeve.least_points ? empty + 1 : 0;
    if (empty > kSleeve.most_empty) break;
    if (empty > 0) continue;
    last = bins.size();
    bin.median_mm = Median(in_bin);
    const double unsure_mm =
        kSleeve.wider_sigmas * 1.25 * sigma_mm / std::sqrt(static_cast<double>(bin.points));
    bin.is_wider = bin.median_mm - r_mm > std::max(kSleeve.wider * r_mm, unsure_mm);
  }
  bins.resize(last);
  return bins;
}

// The bin that a sleeve begins in; as many as there are: there is none.
std::size_t BeginOf(std::span<const RadiusBin> bins) {
  const std::size_t end = bins.size() - std::min(bins.size(), kFaceBins);
  std::size_t begin = end;
  while (begin > 0 && (bins[begin - 1].is_wider || bins[begin - 1].points < kSleeve.least_points)) {
    --begin;
  }
  const double long_in_r = static_cast<double>(bins.size() - begin) * kSleeve.bin;
  const bool is_one =
      begin < end && long_in_r > kSleeve.least_length && long_in_r < kSleeve.longest;
  return is_one ? begin : bins.size();
}

// Whether the points lie on a straight tube with that sleeve, and not on its bends.
bool IsExplained(std::span<const AxisPoint> points, std::span<const RadiusBin> bins,
                 std::size_t begin, const SurfaceFit& fit) {
  const double r_mm = fit.tube.pipe_radius_mm, sigma_mm = fit.sigma_mm;
  const OnBends is_on_bends(fit);
  std::size_t all = 0, on_either = 0, on_sleeve = 0, on_bends = 0;
  std::array<bool, kSleeveSides> of_tube{}, of_sleeve{};
  for (const AxisPoint& point : points) {
    if (point.out_mm < 0) {
      of_tube[point.side] |= std::abs(point.off_axis_mm - r_mm) < kSleeve.on_sigmas * sigma_mm;
      continue;
    }
    const auto at = static_cast<std::size_t>(point.out_mm / (kSleeve.bin * r_mm));
    if (at + kFaceBins >= bins.size() || at + 1 == begin) continue;
    const double radius_mm = at < begin ? r_mm : bins[at].median_mm;
    const bool is_on = std::abs(point.off_axis_mm - radius_mm) < kSleeve.on_sigmas * sigma_mm;
    all += 1, on_either += is_on ? 1 : 0;
    if (at < begin) continue;
    on_sleeve += is_on ? 1 : 0, on_bends += is_on_bends(*point.point) ? 1 : 0;
    of_sleeve[point.side] |= is_on;
  }
  const auto sides = [](const std::array<bool, kSleeveSides>& seen) {
    return static_cast<double>(std::count(seen.begin(), seen.end(), true));
  };
  return static_cast<double>(on_either) > kSleeve.explained * static_cast<double>(all) &&
         static_cast<double>(on_bends) < kSleeve.by_bends * static_cast<double>(on_sleeve) &&
         sides(of_sleeve) >= kSleeve.of_sides * sides(of_tube);
}

// [mm] Where the last points of the tube lie before it, but for a few.
double FaceMm(std::span<const AxisPoint> points, std::span<const RadiusBin> bins, std::size_t begin,
              double r_mm) {
  const double bin_mm = kSleeve.bin * r_mm;
  const double from_mm = (static_cast<double>(begin) - 1.0) * bin_mm;
  const double between_mm = 0.5 * (r_mm + bins[begin].median_mm);
  std::vector<double> tube_mm;
  for (const AxisPoint& point : points) {
    if (point.out_mm > from_mm && point.out_mm < from_mm + 2.0 * bin_mm &&
        point.off_axis_mm < between_mm) {
      tube_mm.push_back(point.out_mm);
    }
  }
  if (std::ssize(tube_mm) <= kSleeve.few) return from_mm;
  std::nth_element(tube_mm.begin(), tube_mm.end() - 1 - kSleeve.few, tube_mm.end());
  return *(tube_mm.end() - 1 - kSleeve.few) - kSleeve.rim * r_mm;
}

// Whether a fit of the straight that it is on may take it for tube: it is no thicker than the fit
// looks for points, and of one radius.
bool MayPull(std::span<const RadiusBin> bins, std::size_t begin, double r_mm) {
  double least_mm = 1e9, most_mm = 0;
  for (std::size_t i = begin + 1; i + kFaceBins < bins.size(); ++i) {
    if (bins[i].points < kSleeve.least_points) continue;
    least_mm = std::min(least_mm, bins[i].median_mm - r_mm);
    most_mm = std::max(most_mm, bins[i].median_mm - r_mm);
  }
  return most_mm < kSleeve.in_reach * r_mm && least_mm > kSleeve.even * most_mm;
}

}  // namespace

std::optional<PlainEnd> FindEndSleeve(const SurfaceFit& fit, bool at_start,
                                      std::span<const PointBlock> blocks) {
  const double r_mm = fit.tube.pipe_radius_mm;
  const auto segments = hal::SpineSegments(fit.tube.program, fit.tube.X_WT);
  const std::size_t bends = fit.tube.program.bend_count();
  for (std::size_t i = 0; i <= std::min(bends, kSleeve.most_bends); ++i) {
    const hal::SpineSegment& straight = segments[2 * (at_start ? i : bends - i)];
    if (straight.length_mm < r_mm) continue;
    // Its end, or where a sleeve on it begins at the earliest.
    const double inside_mm = i == 0 ? std::min(straight.length_mm, kSleeve.longest * r_mm) : 0.0;
    PlainEnd end{straight.PointAt(at_start ? inside_mm : straight.length_mm - inside_mm),
                 at_start ? Eigen::Vector3d(-straight.tangent) : straight.tangent};
    const auto points = PointsAbout(end, r_mm, blocks);
    const auto bins = RadiiOf(points, r_mm, fit.sigma_mm);
    const std::size_t begin = BeginOf(bins);
    if (begin >= bins.size() || !IsExplained(points, bins, begin, fit)) continue;
    if (i == 0 && !MayPull(bins, begin, r_mm)) continue;
    end.position_mm += FaceMm(points, bins, begin, r_mm) * end.outward;
    return end;
  }
  return std::nullopt;
}

bool CutAt(const PlainEnd& begin, bool at_start, SpinePolygon& polygon) {
  const auto is_beyond = [&](const auto& node) {
    return (node.position_mm - begin.position_mm).dot(begin.outward) > 0;
  };
  const auto first =
      at_start ? std::find_if_not(polygon.begin(), polygon.end(), is_beyond) : polygon.begin();
  const auto last = at_start ? polygon.end()
                             : std::find_if_not(polygon.rbegin(), polygon.rend(), is_beyond).base();
  if (std::distance(first, last) < kSleeve.least_nodes) return false;
  polygon = SpinePolygon(first, last);
  return true;
}

void LeaveOut(const PlainEnd& begin, double pipe_radius_mm, std::vector<PointBlock>& blocks,
              std::vector<PartedBlock>& parted) {
  const auto is_of_sleeve = [&](const Eigen::Vector3d& point, double more_mm) {
    const Eigen::Vector3d from = point - begin.position_mm;
    const double out_mm = from.dot(begin.outward);
    return out_mm > -more_mm && out_mm < kSleeve.beyond * pipe_radius_mm + more_mm &&
           from.cross(begin.outward).norm() < kSleeve.cut_wide * pipe_radius_mm + more_mm;
  };
  for (PointBlock& block : blocks) {
    if (!is_of_sleeve(block.center_mm, block.half_diagonal_mm)) continue;
    PartedBlock left;
    for (std::size_t i = 0; i < block.points.size(); ++i) {
      if (is_of_sleeve(block.points[i], 0.0)) continue;
      left.points.push_back(block.points[i]);
      if (!block.to_sensor.empty()) left.to_sensor.push_back(block.to_sensor[i]);
    }
    if (left.points.size() == block.points.size()) continue;
    parted.push_back(std::move(left));
    block.points = parted.back().points;
    block.to_sensor = parted.back().to_sensor;
  }
}

}  // namespace bendloop::pipeline
