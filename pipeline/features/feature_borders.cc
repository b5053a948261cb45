// SPDX-License-Identifier: Apache-2.0
#include "pipeline/features/feature_borders.h"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

#include "pipeline/features/border_fit_ceres.h"
#include "pipeline/features/border_points.h"
#include "pipeline/features/point_characteristics.h"
#include "pipeline/features/regions.h"
#include "pipeline/math/quantiles.h"

namespace bendloop::pipeline {
namespace {

using Eigen::Vector3d;

struct DoorSettings {
  std::size_t least_points = 200;
  // The reach holds about so many neighbours.
  std::size_t neighbours = 18;
  // Points whose neighbours are counted to find it.
  std::size_t probes = 200;
  // [sigma of the points off their planes] What is deeper lies below the hull.
  double clear_sigmas = 5;
  // With more of the points below the hull than this it says nothing of features: the object itself
  // is bent or hollow.
  double most_below_hull = 0.5;
  std::size_t least_of_region = 40;
};
constexpr DoorSettings kDoor;

bool IsBefore(const Vector3d& a, const Vector3d& b) {
  return std::lexicographical_compare(a.begin(), a.end(), b.begin(), b.end());
}

// Each place once, in an order that does not depend on the points' own.
std::vector<Vector3d> Places(std::span<const Vector3d> points_mm) {
  std::vector<Vector3d> places(points_mm.begin(), points_mm.end());
  std::sort(places.begin(), places.end(), IsBefore);
  places.erase(std::unique(places.begin(), places.end()), places.end());
  return places;
}

double DiagonalMm(std::span<const Vector3d> points) {
  Vector3d low = points.front(), high = points.front();
  for (const Vector3d& p : points) {
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  return (high - low).norm();
}

// One point for each cube, the first of them.
std::vector<Vector3d> OneForEachCube(std::span<const Vector3d> points, double cube_mm) {
  std::vector<std::pair<std::uint64_t, std::size_t>> cubes(points.size());
  for (std::size_t i = 0; i < points.size(); ++i) {
    cubes[i] = {CellKey(CellOf(points[i] - points.front(), cube_mm)), i};
  }
  std::sort(cubes.begin(), cubes.end());
  std::vector<Vector3d> few;
  for (std::size_t i = 0; i < cubes.size(); ++i) {
    if (i == 0 || cubes[i].first != cubes[i - 1].first) few.push_back(points[cubes[i].second]);
  }
  return few;
}

std::vector<Vector3d> ThinnedTo(std::size_t most, const std::vector<Vector3d>& points) {
  if (points.size() <= most) return points;
  // A surface has as many cubes as its area over theirs.
  double cube_mm = DiagonalMm(points) / 300;
  std::vector<Vector3d> few;
  for (int attempt = 0; attempt < 4; ++attempt) {
    few = OneForEachCube(points, cube_mm);
    const double ratio = static_cast<double>(few.size()) / static_cast<double>(most);
    if (ratio < 1.0 && (ratio > 0.6 || attempt == 3)) return few;
    cube_mm *= std::sqrt(ratio / 0.8);
  }
  while (few.size() > most) {
    cube_mm *= 1.2;
    few = OneForEachCube(points, cube_mm);
  }
  return few;
}

// Within it most points have as many neighbours as asked for.
double ReachMm(const std::vector<Vector3d>& points) {
  const std::size_t step = std::max<std::size_t>(1, points.size() / kDoor.probes);
  std::vector<double> reach_mm;
  std::vector<double> square_mm2(points.size());
  for (std::size_t i = 0; i < points.size(); i += step) {
    for (std::size_t k = 0; k < points.size(); ++k) {
      square_mm2[k] = (points[k] - points[i]).squaredNorm();
    }
    const auto place = square_mm2.begin() +
                       static_cast<std::ptrdiff_t>(std::min(kDoor.neighbours, points.size() - 1));
    std::nth_element(square_mm2.begin(), place, square_mm2.end());
    reach_mm.push_back(std::sqrt(*place));
  }
  return Quantile(std::move(reach_mm), 0.7);
}

FeatureRegion Describe(std::span<const Vector3d> points,
                       std::span<const PointCharacteristics> characteristics,
                       const Regions& regions, std::size_t number) {
  FeatureRegion region;
  region.concave = regions.concave[number];
  std::vector<Vector3d> own;
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (regions.of_point[i] != static_cast<int>(number)) continue;
    own.push_back(points[i]);
    region.depth_mm = std::max(region.depth_mm, characteristics[i].concavity_mm);
    region.center_mm += points[i];
  }
  region.points = own.size();
  if (own.empty()) return region;
  region.center_mm /= static_cast<double>(own.size());
  Eigen::Matrix3d spread = Eigen::Matrix3d::Zero();
  for (const Vector3d& p : own) {
    spread += (p - region.center_mm) * (p - region.center_mm).transpose();
  }
  const Eigen::Matrix3d axes =
      Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(spread).eigenvectors();
  Vector3d low = axes.transpose() * own.front(), high = low;
  for (const Vector3d& p : own) {
    low = low.cwiseMin(axes.transpose() * p);
    high = high.cwiseMax(axes.transpose() * p);
  }
  region.size_mm = (high - low).reverse();
  return region;
}

hal::Result<void> CheckCloud(std::span<const Vector3d> points_mm) {
  for (std::size_t i = 0; i < points_mm.size(); ++i) {
    if (points_mm[i].allFinite()) continue;
    return hal::Fail(hal::ErrorKind::kBadInput, "point " + std::to_string(i + 1) +
                                                    " is no place (NaN or infinite): leave it "
                                                    "out");
  }
  return {};
}

hal::Result<void> CheckPlaces(const std::vector<Vector3d>& places) {
  if (places.size() >= kDoor.least_points) return {};
  return hal::Fail(hal::ErrorKind::kBadInput,
                   "points in " + std::to_string(places.size()) + " places show no features: " +
                       std::to_string(kDoor.least_points) + " are the least, scan denser");
}

// From where a point lies below the hull.
double ClearOfHullMm(const std::vector<PointCharacteristics>& characteristics,
                     const FeatureOptions& options, FeatureBorders& found) {
  std::vector<double> off_mm, depth_mm;
  for (const PointCharacteristics& c : characteristics) {
    off_mm.push_back(c.off_plane_mm);
    depth_mm.push_back(c.concavity_mm);
  }
  found.noise_sigma_mm = Median(std::move(off_mm));
  const double clear_mm =
      options.concavity_mm > 0 ? options.concavity_mm : kDoor.clear_sigmas * found.noise_sigma_mm;
  if (options.concavity_mm > 0 || Quantile(depth_mm, 1 - kDoor.most_below_hull) <= clear_mm) {
    return clear_mm;
  }
  found.warnings.push_back(
      "more than half of the points lie below the convex hull: the object is bent or hollow, and "
      "only its normals and edges tell its features");
  return std::numeric_limits<double>::infinity();
}

void FitBorders(std::vector<FoundBorder>&& lines, FeatureBorders& found) {
  for (FoundBorder& line : lines) {
    FeatureBorder border{static_cast<std::size_t>(line.region),
                         line.beside,
                         line.border.points_mm.size(),
                         line.gaps,
                         line.branches,
                         {}};
    CurveFitOptions options;
    // Places of a border are smoothed over about twice the reach.
    const auto& points = line.border.points_mm;
    double length_mm = 0;
    for (std::size_t i = 1; i < points.size(); ++i) length_mm += (points[i] - points[i - 1]).norm();
    options.points_of_independent = 2 * found.reach_mm * static_cast<double>(points.size()) /
                                    std::max(length_mm, found.reach_mm);
    auto fit = FitBorder(line.border, options);
    if (!fit) continue;  // too short for a curve
    border.fit = std::move(*fit);
    found.borders.push_back(std::move(border));
  }
}

}  // namespace

hal::Result<FeatureBorders> FindFeatureBorders(std::span<const Vector3d> points_mm,
                                               const FeatureOptions& options, Workers* workers) {
  if (const auto good = CheckCloud(points_mm); !good) return hal::Fail(good.error());
  const std::vector<Vector3d> places = Places(points_mm);
  if (const auto good = CheckPlaces(places); !good) return hal::Fail(good.error());
  const std::vector<Vector3d> points = ThinnedTo(options.most_points, places);
  FeatureBorders found;
  found.points_used = points.size();
  found.reach_mm = ReachMm(points);
  if (points.size() < points_mm.size()) {
    found.warnings.push_back("features are looked for in " + std::to_string(points.size()) +
                             " of the " + std::to_string(points_mm.size()) +
                             " points, evenly spread");
  }
  const PointIndex index(points, found.reach_mm);
  std::vector<PointCharacteristics> characteristics =
      CharacteriseSurface(points, index, found.reach_mm, workers);
  const auto concavity_mm = ConcavityMm(points, workers);
  if (!concavity_mm) return hal::Fail(concavity_mm.error());
  for (std::size_t i = 0; i < points.size(); ++i) {
    characteristics[i].concavity_mm = (*concavity_mm)[i];
  }
  RegionOptions growing;
  growing.reach_mm = found.reach_mm;
  growing.normal_turn = options.normal_turn_deg * std::numbers::pi / 180;
  growing.concavity_mm = ClearOfHullMm(characteristics, options, found);
  growing.least_points =
      std::max(kDoor.least_of_region,
               static_cast<std::size_t>(options.least_part * static_cast<double>(points.size())));
  found.concavity_mm = growing.concavity_mm;
  const Regions regions = GrowRegions(points, index, characteristics, growing);
  for (std::size_t r = 0; r < regions.count; ++r) {
    found.regions.push_back(Describe(points, characteristics, regions, r));
  }
  FitBorders(FindBorders(points, index, characteristics, regions, growing), found);
  if (found.regions.empty()) {
    found.warnings.push_back("no region is smooth: scan denser, or allow normals to turn faster");
  }
  return found;
}

}  // namespace bendloop::pipeline
