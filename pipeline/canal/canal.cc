// SPDX-License-Identifier: Apache-2.0
// Pipes whose radius varies (tapered, end-formed) and spines without lines and arcs: Lee & Kim 2004
// for the way in, then one least-squares fit of everything.
#include "pipeline/canal/canal.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "pipeline/canal/canal_feet.h"
#include "pipeline/math/quantiles.h"
#include "pipeline/points/input_checks.h"
#include "pipeline/points/point_index.h"
#include "pipeline/points/sample_grid.h"
#include "pipeline/spine/closed_tube.h"
#include "pipeline/spine/oriented_samples.h"
#include "pipeline/spine/pipe_radius.h"
#include "pipeline/spine/shrinking.h"
#include "pipeline/spine/spine_polygon.h"
#include "pipeline/tube/stage_timer.h"

namespace bendloop::pipeline {
namespace {

// The way from points to a canal surface. Lengths in parts of the typical pipe radius; by trial
// where nothing else is said.
struct CanalSettings {
  // So many samples get normals; each costs the same.
  std::size_t shrink_samples = 20'000;
  // So many points are fitted: more add nothing that the scanner did not get wrong.
  std::size_t fit_points = 60'000;
  // Edge of a block of the grid: the radius of the local paraboloid (Bauer & Polthier 2009, section
  // 7).
  double block = 2.0 / 3.0;
  // Local radii are looked for from 1/2.5 to 2.5 of the typical one.
  double widest = 2.5;
  // [of the local radius] Supports of the cylinders, that with the longest spine counts.
  // Paraboloids make radii a tenth too small, and 1.2 (Bauer & Polthier 2009, section 3.2) of that
  // hardly reaches the surface; but tight bends want the smaller one.
  std::array<double, 2> supports = {1.5, 1.2};
  // [of the first one's length] A longer piece is another pipe, if its points are its own.
  double second_tube = 0.3;
  // [of the local radius] Points further from the surface belong to something else.
  double reach = 0.5;
  // The spine goes on straight for so long at either end, over so many places: nodes end before the
  // pipe does.
  double beyond = 1.5;
  int places_beyond = 6;
  // Between places where the spine is told.
  double spine_step = 0.5;
  // [sigma] Points within so much of the surface tell where the pipe ends.
  double on_surface = 4.0;
  // [of the density further in] Where fewer points are, or fewer than so many, a few fliers lie
  // beyond the end; so does a point with a gap of so many times the local spacing behind it.
  double crowd = 0.2, least_crowd = 4, lone_gap = 4.0;
  // Steps of a span for the table of arc lengths.
  int steps_of_span = 16;
};
constexpr CanalSettings kCanal;

// A pipe has one spine, so a node beside a better one is a fit to part of the circumference, which
// noise makes narrower or lays on from outside. Lengths in parts of the better one's radius; by
// trial.
struct SideSettings {
  double reach = 2.4;       // all that may be meant is as near: the corner of the next two
  double most_along = 0.7;  // the two stand side by side
  double least_across = 0.2, most_across = 2.2;  // the latter: laid on from outside, and noise
  double better = 1.3;                           // the better one has so many times the samples
};
constexpr SideSettings kSide;

std::vector<SpineNode> WithoutSideNodes(const std::vector<SpineNode>& nodes) {
  std::vector<Eigen::Vector3d> places;
  double widest_mm = 0;
  for (const SpineNode& node : nodes) {
    places.push_back(node.position_mm);
    widest_mm = std::max(widest_mm, node.radius_mm);
  }
  if (nodes.empty()) return {};
  const PointIndex index(places, widest_mm);
  std::vector<SpineNode> kept;
  for (const SpineNode& node : nodes) {
    bool beside = false;
    index.Visit(node.position_mm, kSide.reach * widest_mm, [&](std::size_t j) {
      const SpineNode& other = nodes[j];
      if (static_cast<double>(other.samples) < kSide.better * static_cast<double>(node.samples)) {
        return;
      }
      const Eigen::Vector3d v = node.position_mm - other.position_mm;
      const double along = v.dot(other.tangent);
      const double across = (v - along * other.tangent).norm();
      beside = beside || (std::abs(along) < kSide.most_along * other.radius_mm &&
                          across > kSide.least_across * other.radius_mm &&
                          across < kSide.most_across * other.radius_mm);
    });
    if (!beside) kept.push_back(node);
  }
  return kept;
}

// Ends included: straight on from the first and last node.
std::vector<Eigen::Vector4d> Extended(const SpinePolygon& polygon, double radius_mm) {
  const auto node = [](const SpineNode& n) {
    return Eigen::Vector4d(n.position_mm.x(), n.position_mm.y(), n.position_mm.z(), n.radius_mm);
  };
  std::vector<Eigen::Vector4d> spine;
  const auto beyond = [&](const SpineNode& end, double sign) {
    const Eigen::Vector4d at = node(end);
    for (int i = 1; i <= kCanal.places_beyond; ++i) {
      Eigen::Vector4d p = at;
      p.head<3>() += sign * kCanal.beyond * radius_mm * i /
                     static_cast<double>(kCanal.places_beyond) * end.tangent;
      spine.push_back(p);
    }
  };
  beyond(polygon.front(), -1);
  std::reverse(spine.begin(), spine.end());
  for (const SpineNode& n : polygon) spine.push_back(node(n));
  beyond(polygon.back(), 1);
  return spine;
}

// Where the samples begin. `inward` grows into the pipe and is sorted: lone points before the crowd
// are fliers, and the border is half the local spacing before the first point of the crowd.
double BorderMm(const std::vector<double>& inward, double window_mm) {
  const auto within = [&inward](double low, double high) {
    return static_cast<double>(std::lower_bound(inward.begin(), inward.end(), high) -
                               std::lower_bound(inward.begin(), inward.end(), low));
  };
  for (std::size_t i = 0; i + 1 < inward.size(); ++i) {
    const double at = inward[i];
    const double here = within(at, at + window_mm);
    if (here < kCanal.least_crowd ||
        here < kCanal.crowd * within(at + window_mm, at + 2 * window_mm))
      continue;
    double sum = 0, sum2 = 0;
    for (std::size_t k = i; k + 1 < inward.size() && inward[k + 1] < at + window_mm; ++k) {
      const double gap = inward[k + 1] - inward[k];
      sum += gap;
      sum2 += gap * gap;
    }
    const double spacing = sum > 0 ? sum2 / sum : 0.0;
    if (inward[i + 1] - at > kCanal.lone_gap * spacing && spacing > 0) continue;
    return at - 0.5 * spacing;
  }
  return inward.empty() ? 0.0 : inward.front();
}

// Parameter at an arc length, from the table of ArcLengths.
double ParameterAt(const std::vector<double>& lengths, double along_mm, int spans) {
  const auto upper = std::lower_bound(lengths.begin(), lengths.end(), along_mm);
  if (upper == lengths.begin()) return 0;
  if (upper == lengths.end()) return spans;
  const auto i = static_cast<double>(upper - lengths.begin());
  const double step = *upper - *(upper - 1);
  const double part = step > 0 ? (along_mm - *(upper - 1)) / step : 0.0;
  return (i - 1 + part) / static_cast<double>(lengths.size() - 1) * spans;
}

void PlaceEndsAndSpine(CanalScan& scan) {
  const CanalSurface& surface = scan.fit.surface;
  const std::vector<double> lengths = surface.ArcLengths(kCanal.steps_of_span * surface.spans());
  const double cut_mm = kCanal.on_surface * scan.fit.sigma_mm;
  std::vector<double> inward;
  scan.along_mm.assign(scan.points.size(), 0.0);
  for (std::size_t i = 0; i < scan.points.size(); ++i) {
    const CanalFoot& foot = scan.feet[i];
    if (foot.beyond) continue;
    const double place = foot.t * kCanal.steps_of_span;
    const auto k = std::min(static_cast<std::size_t>(place), lengths.size() - 2);
    // The sphere of a tapered pipe touches it before or behind its centre.
    const Eigen::Vector3d tangent = surface.DerivativeAt(foot.t).head<3>().normalized();
    scan.along_mm[i] = lengths[k] +
                       (place - static_cast<double>(k)) * (lengths[k + 1] - lengths[k]) +
                       (scan.points[i] - surface.At(foot.t).head<3>()).dot(tangent);
    if (std::abs(foot.distance_mm) < cut_mm) inward.push_back(scan.along_mm[i]);
  }
  std::sort(inward.begin(), inward.end());
  scan.from_mm = std::max(0.0, BorderMm(inward, scan.radius_mm));
  for (double& s : inward) s = lengths.back() - s;
  std::reverse(inward.begin(), inward.end());
  scan.to_mm = std::min(lengths.back(), lengths.back() - BorderMm(inward, scan.radius_mm));

  const double length_mm = std::max(0.0, scan.to_mm - scan.from_mm);
  const int steps =
      std::max(1, static_cast<int>(std::ceil(length_mm / (kCanal.spine_step * scan.radius_mm))));
  for (int i = 0; i <= steps; ++i) {
    const double t = ParameterAt(lengths, scan.from_mm + length_mm * i / steps, surface.spans());
    const Eigen::Vector4d c = surface.At(t);
    scan.spine.push_back({c.head<3>(), c[3]});
    scan.tangents.push_back(surface.DerivativeAt(t).head<3>().normalized());
  }
}

// Whether a piece of spine stands for points of its own. Noise lays cylinders on a pipe from
// outside; their points lie on the pipe that was found.
bool IsOfItsOwn(const SpinePolygon& polygon, const CanalFit& fit, const SampleGrid& grid,
                double radius_mm) {
  std::vector<Eigen::Vector3d> points;
  std::vector<Eigen::Vector3d> ball;
  for (const SpineNode& node : polygon) {
    grid.GatherBall(node.position_mm, 1.3 * node.radius_mm, ball);
    points.insert(points.end(), ball.begin(), ball.end());
  }
  const std::vector<CanalFoot> feet = FindFeet(fit.surface, points, radius_mm, kCanal.reach);
  std::size_t strangers = 0;
  for (const CanalFoot& foot : feet) {
    strangers += foot.beyond || std::abs(foot.distance_mm) > 5 * fit.sigma_mm ? 1 : 0;
  }
  return 2 * strangers > points.size();
}

// Those that are somewhere, and no more than a grid holds.
std::vector<Eigen::Vector3d> Places(std::span<const Eigen::Vector3d> all_points) {
  std::vector<Eigen::Vector3d> points;
  points.reserve(std::min(all_points.size(), SampleGrid::kMaxPoints));
  for (const Eigen::Vector3d& p : all_points) {
    if (IsPlace(p) && points.size() < SampleGrid::kMaxPoints) points.push_back(p);
  }
  return points;
}

hal::Result<double> RadiusOf(std::span<const Eigen::Vector3d> points, const CanalOptions& options) {
  double radius_mm = options.pipe_radius_mm.value_or(0.0);
  if (!options.pipe_radius_mm) {
    const auto radius = EstimatePipeRadius(points);
    if (!radius) return hal::Fail(radius.error());
    radius_mm = radius->radius_mm;
  }
  if (const auto units = CheckUnits(radius_mm); !units) return hal::Fail(units.error());
  return radius_mm;
}

// Samples to pieces of spine, the longest first.
std::vector<SpinePolygon> SpinesOf(const SampleGrid& grid, double radius_mm, SpineMethod method) {
  const std::vector<OrientedSample> samples =
      OrientSamples(grid, radius_mm, kCanal.widest, kCanal.shrink_samples);
  if (method == SpineMethod::kShrinking) {
    return SpinePolygons(
        WithoutSideNodes(
            ShrinkCanal(samples, {.radius_mm = radius_mm, .most = 1.1 * kCanal.widest}).nodes),
        radius_mm);
  }
  std::vector<SpinePolygon> polygons;
  for (const double support : kCanal.supports) {
    std::vector<SpinePolygon> found = SpinePolygons(
        WithoutSideNodes(ProjectWithFreeRadius(grid, samples, radius_mm, support)), radius_mm);
    if (found.empty()) continue;
    if (polygons.empty() || LengthOf(found.front()) > 1.05 * LengthOf(polygons.front())) {
      polygons = std::move(found);
    }
  }
  return polygons;
}

std::vector<Eigen::Vector3d> PointsNear(std::span<const Eigen::Vector4d> spine,
                                        const SampleGrid& grid, double radius_mm) {
  std::vector<Eigen::Vector3d> places, points;
  double widest_mm = radius_mm;
  for (const Eigen::Vector4d& c : spine) {
    places.emplace_back(c.head<3>());
    widest_mm = std::max(widest_mm, c[3]);
  }
  for (const std::int32_t near : grid.BlocksNear(places, 1.5 * widest_mm)) {
    const SampleGrid::Block& found = grid.blocks()[static_cast<std::size_t>(near)];
    points.insert(points.end(), found.points.begin(), found.points.end());
  }
  return points;
}

// The canal surface next to the scan's points; of a free form one of constant radius, if that does.
void FitSurfaceTo(CanalScan& scan, std::span<const Eigen::Vector4d> spine, bool freeform) {
  std::vector<Eigen::Vector3d> fitted;
  const std::size_t stride = scan.points.size() / kCanal.fit_points + 1;
  for (std::size_t i = 0; i < scan.points.size(); i += stride) fitted.push_back(scan.points[i]);
  scan.fit = FitCanal(spine, fitted, {.varying_radius = true, .radius_mm = scan.radius_mm});
  if (!freeform) return;
  CanalFit constant =
      FitCanal(spine, fitted, {.varying_radius = false, .radius_mm = scan.radius_mm});
  if (constant.criterion > scan.fit.criterion) return;
  scan.fit = std::move(constant);
  scan.varying_radius = false;
}

// kBadInput: another piece of spine is nearly as long, and its points are its own.
hal::Result<void> CheckIsOne(std::span<const SpinePolygon> polygons, const CanalFit& fit,
                             const SampleGrid& grid, double radius_mm) {
  const double first_mm = LengthOf(polygons.front());
  for (const SpinePolygon& polygon : polygons.subspan(1)) {
    const double other_mm = LengthOf(polygon);
    if (other_mm <= kCanal.second_tube * first_mm) break;  // they are sorted
    if (!IsOfItsOwn(polygon, fit, grid, radius_mm)) continue;
    return hal::Fail(hal::ErrorKind::kBadInput,
                     "two tubes in the points (" + Mm(first_mm) + " and " + Mm(other_mm) +
                         " long), or one with a gap that is too long to bridge: scan one tube "
                         "at a time, and the gap again");
  }
  return {};
}

// kBadInput: the surface shrinks to nothing somewhere.
hal::Result<void> CheckIsPipe(const CanalScan& scan) {
  double least_mm = std::numeric_limits<double>::infinity();
  for (const SpineSample& sample : scan.spine) least_mm = std::min(least_mm, sample.pipe_radius_mm);
  if (scan.to_mm - scan.from_mm > scan.radius_mm && least_mm > 0) return {};
  return hal::Fail(hal::ErrorKind::kBadInput,
                   "no pipe found in the points: the surface next to them shrinks to nothing");
}

}  // namespace

hal::Result<CanalScan> FitCanalScan(std::span<const Eigen::Vector3d> all_points,
                                    const CanalOptions& options, const hal::Clock& clock) {
  StageTimer timer(clock);
  const std::vector<Eigen::Vector3d> points = Places(all_points);
  if (const auto shape = CheckShape(points); !shape) return hal::Fail(shape.error());
  const auto radius = RadiusOf(points, options);
  if (!radius) return hal::Fail(radius.error());
  CanalScan scan;
  scan.radius_mm = *radius;
  scan.all_points = all_points.size();
  timer.Done("pipe_radius");
  SampleGrid grid(kCanal.block * scan.radius_mm);
  std::int32_t block = 0;
  for (const Eigen::Vector3d& p : points) grid.Insert(p, block);
  timer.Done("samples");
  std::vector<SpinePolygon> polygons = SpinesOf(grid, scan.radius_mm, options.spine_method);
  timer.Done("projection");
  if (polygons.empty()) {
    return hal::Fail(hal::ErrorKind::kBadInput,
                     "no pipe of about " + Mm(scan.radius_mm) +
                         " radius in the points: expected a surface curved like that");
  }
  scan.is_closed = IsLoop(polygons.front(), scan.radius_mm) &&
                   !OpenAtGap(points, scan.radius_mm, polygons.front());
  const std::vector<Eigen::Vector4d> spine = Extended(polygons.front(), scan.radius_mm);
  timer.Done("curve");
  scan.points = PointsNear(spine, grid, scan.radius_mm);
  FitSurfaceTo(scan, spine, options.freeform);
  if (const auto one = CheckIsOne(polygons, scan.fit, grid, scan.radius_mm); !one) {
    return hal::Fail(one.error());
  }
  timer.Done("fit");
  scan.feet = FindFeet(scan.fit.surface, scan.points, scan.radius_mm, kCanal.reach);
  PlaceEndsAndSpine(scan);
  timer.Done("ends");
  if (const auto pipe = CheckIsPipe(scan); !pipe) return hal::Fail(pipe.error());
  scan.timing = std::move(timer.times);
  return scan;
}

}  // namespace bendloop::pipeline
