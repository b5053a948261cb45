// SPDX-License-Identifier: Apache-2.0
// What a canal surface says in the words of a tube.
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

#include "hal/spine.h"
#include "pipeline/canal/canal.h"
#include "pipeline/fit/surface_fit.h"
#include "pipeline/fit/tube_ends.h"
#include "pipeline/math/quantiles.h"
#include "pipeline/points/input_checks.h"
#include "pipeline/points/point_index.h"
#include "pipeline/spine/closed_tube.h"
#include "pipeline/structure/structure.h"
#include "pipeline/tube/spine_distance.h"
#include "pipeline/tube/stage_timer.h"

namespace bendloop::pipeline {
namespace {

// What is told of a canal surface.
struct DescriptionSettings {
  // [sigma] Samples further from the surface are outliers: of normal noise hardly one in a million.
  double outlier_sigmas = 5.0;
  // Samples that are kept for deviations and pictures (by trial).
  std::size_t most_surface = 20'000;
  // [of the tightest bend] The thickest pipe that lines and arcs are looked for on: a thicker one
  // would nearly fold there (by trial).
  double tightest = 0.7;
  // So many points tell lines and arcs: more add nothing that the scanner did not get wrong.
  std::size_t arc_points = 60'000;
  // Times the usual evidence for a bend: what shrinking to an even pipe leaves, neighbours have in
  // common (by trial).
  double caution = 4.0;
  // [of r_P] Of the spine that lines and arcs leave by as much, one way.
  double spine_together = 4.0;
};
constexpr DescriptionSettings kDescription;

double MeanRadius(const CanalScan& scan) {
  double sum = 0;
  for (const SpineSample& sample : scan.spine) sum += sample.pipe_radius_mm;
  return sum / static_cast<double>(scan.spine.size());
}

// Of the radius along the spine about its mean: no surer is it, if it is to be that of one pipe.
double RadiusScatterMm(const CanalScan& scan) {
  const double mean_mm = MeanRadius(scan);
  double sum2 = 0;
  for (const SpineSample& sample : scan.spine) {
    sum2 += (sample.pipe_radius_mm - mean_mm) * (sample.pipe_radius_mm - mean_mm);
  }
  return std::sqrt(sum2 / static_cast<double>(scan.spine.size()));
}

// What lines and arcs leave of the spine (`rms_mm`), all points of a few pipe radii have in common:
// by how much that makes the variances of the fit greater.
double OfSpineLeft(const SurfaceFit& fit, double rms_mm) {
  const double together_mm = kDescription.spine_together * fit.tube.pipe_radius_mm;
  const double points =
      static_cast<double>(fit.used) * together_mm / hal::SpineLength(fit.tube.program);
  const double ratio = rms_mm / fit.sigma_mm;
  return points * ratio * ratio / fit.design_effect;
}

// Variance of means over small patches against that of independent distances, at least 1: scanners
// err alike at neighbouring points.
double DesignEffect(const CanalScan& scan) {
  struct Patch {
    double sum = 0, count = 0;
  };
  std::map<std::uint64_t, Patch> patches;
  double sum2 = 0, count = 0;
  for (std::size_t i = 0; i < scan.points.size(); ++i) {
    const CanalFoot& foot = scan.feet[i];
    if (foot.beyond ||
        std::abs(foot.distance_mm) > kDescription.outlier_sigmas * scan.fit.sigma_mm) {
      continue;
    }
    Patch& patch = patches[CellKey(CellOf(scan.points[i], 0.5 * scan.radius_mm))];
    patch.sum += foot.distance_mm;
    patch.count += 1;
    sum2 += foot.distance_mm * foot.distance_mm;
    count += 1;
  }
  if (count < 2 || !(sum2 > 0)) return 1;
  double between = 0;
  for (const auto& [key, patch] : patches) between += patch.sum * patch.sum;
  return std::max(1.0, between / sum2);
}

void DescribePoints(const CanalScan& scan, Measurement& measurement) {
  std::vector<double> magnitudes;
  std::vector<SurfaceSample> surface;
  const double length_mm = scan.to_mm - scan.from_mm;
  const auto bins = scan.spine.size();
  const double bin_mm = length_mm / static_cast<double>(bins - 1);
  std::vector<std::size_t> count(bins, 0);
  double sum2 = 0;
  for (std::size_t i = 0; i < scan.points.size(); ++i) {
    const CanalFoot& foot = scan.feet[i];
    const double s = scan.along_mm[i] - scan.from_mm;
    if (foot.beyond ||
        std::abs(foot.distance_mm) > kDescription.outlier_sigmas * scan.fit.sigma_mm ||
        s < -0.2 * scan.radius_mm || s > length_mm + 0.2 * scan.radius_mm) {
      continue;
    }
    magnitudes.push_back(std::abs(foot.distance_mm));
    sum2 += foot.distance_mm * foot.distance_mm;
    surface.push_back({scan.points[i], foot.distance_mm});
    ++count[static_cast<std::size_t>(std::lround(std::clamp(s, 0.0, length_mm) / bin_mm))];
  }
  FitQuality& fit = measurement.fit;
  fit.samples = magnitudes.size();
  fit.outliers = scan.all_points - std::min(scan.all_points, magnitudes.size());
  fit.rms_distance_mm =
      magnitudes.empty() ? 0.0 : std::sqrt(sum2 / static_cast<double>(magnitudes.size()));
  fit.p95_abs_distance_mm = Quantile(magnitudes, 0.95);
  fit.median_abs_distance_mm = Median(std::move(magnitudes));
  const std::size_t stride = surface.size() / kDescription.most_surface + 1;
  for (std::size_t i = 0; i < surface.size(); i += stride) {
    measurement.surface.push_back(surface[i]);
  }
  // As for tubes: covered where samples lie within a pipe radius along the spine.
  std::size_t uncovered = 0, gap = 0, longest = 0;
  for (std::size_t bin = 0; bin < bins; ++bin) {
    const std::size_t near =
        count[bin == 0 ? 0 : bin - 1] + count[bin] + count[std::min(bin + 1, bins - 1)];
    gap = near > 0 ? 0 : gap + 1;
    uncovered += near > 0 ? 0 : 1;
    longest = std::max(longest, gap);
  }
  measurement.coverage = 1.0 - static_cast<double>(uncovered) / static_cast<double>(bins);
  measurement.longest_gap_mm = static_cast<double>(longest) * bin_mm;
}

// The points as they would lie if the pipe had the same radius everywhere: their distance from the
// surface stays, the surface moves.
OwnedBlocks OnEvenPipe(const CanalScan& scan, double radius_mm) {
  const CanalSurface& surface = scan.fit.surface;
  const double cell_mm = 2.0 / 3.0 * radius_mm;
  std::map<std::uint64_t, std::pair<Eigen::Vector3i, std::vector<Eigen::Vector3d>>> cells;
  std::size_t count = 0;
  const std::size_t stride = scan.points.size() / kDescription.arc_points + 1;
  for (std::size_t i = 0; i < scan.points.size(); i += stride) {
    const CanalFoot& foot = scan.feet[i];
    if (foot.beyond ||
        std::abs(foot.distance_mm) > kDescription.outlier_sigmas * scan.fit.sigma_mm) {
      continue;
    }
    // Across the spine, from the place beside the point: the normals of a taper are inclined.
    double t = foot.t;
    for (int round = 0; round < 6; ++round) {
      const Eigen::Vector3d v = scan.points[i] - surface.At(t).head<3>();
      const Eigen::Vector3d d1 = surface.DerivativeAt(t).head<3>();
      const double slope = d1.squaredNorm() - v.dot(surface.SecondAt(t).head<3>());
      t = std::clamp(t + std::clamp(v.dot(d1) / std::max(slope, 0.1 * d1.squaredNorm()), -0.5, 0.5),
                     0.0, static_cast<double>(surface.spans()));
    }
    const Eigen::Vector3d center = surface.At(t).head<3>();
    const Eigen::Vector3d tangent = surface.DerivativeAt(t).head<3>().normalized();
    Eigen::Vector3d across = scan.points[i] - center;
    const double along = across.dot(tangent);  // beyond an end of the spline only
    across = (across - along * tangent).normalized();
    const Eigen::Vector3d p = center + along * tangent + (radius_mm + foot.distance_mm) * across;
    if (!p.allFinite()) continue;
    const Eigen::Vector3i cell = CellOf(p, cell_mm);
    auto& held = cells[CellKey(cell)];
    held.first = cell;
    held.second.push_back(p);
    ++count;
  }
  OwnedBlocks blocks(count);
  for (const auto& [key, held] : cells) {
    blocks.Begin((held.first.cast<double>() + Eigen::Vector3d::Constant(0.5)) * cell_mm,
                 0.5 * std::sqrt(3.0) * cell_mm);
    for (const Eigen::Vector3d& p : held.second) blocks.Add(p);
  }
  return blocks;
}

hal::Pose StartPose(const CanalScan& scan) {
  const Eigen::Vector3d x = scan.tangents.front();
  // The normal of the first turn, as the first bend's would be.
  Eigen::Vector3d z = x.unitOrthogonal();
  for (const Eigen::Vector3d& tangent : scan.tangents) {
    const Eigen::Vector3d turn = x.cross(tangent);
    if (turn.norm() > 0.1) {
      z = turn.normalized();
      break;
    }
  }
  Eigen::Matrix3d frame;
  frame << x, z.cross(x), z;
  return {scan.spine.front().position_mm, Eigen::Quaterniond(frame).normalized()};
}

std::string Range(const CanalScan& scan) {
  double least = scan.spine.front().pipe_radius_mm, most = least;
  for (const SpineSample& sample : scan.spine) {
    least = std::min(least, sample.pipe_radius_mm);
    most = std::max(most, sample.pipe_radius_mm);
  }
  return scan.varying_radius ? "pipe radius " + Mm(least) + " to " + Mm(most)
                             : "constant pipe radius " + Mm(most);
}

void FitRows(const CanalScan& scan, double design_effect, Measurement& measurement) {
  const double mean_mm = MeanRadius(scan);
  const CanalSurface& surface = scan.fit.surface;
  const double curvature = surface.MaxCurvature(0, surface.spans());
  const double radius_mm =
      curvature > 0 ? std::min(mean_mm, kDescription.tightest / curvature) : mean_mm;
  const double even_mm = std::max(radius_mm, 0.25 * mean_mm);
  const OwnedBlocks blocks = OnEvenPipe(scan, even_mm);
  SpinePolygon polygon;
  for (std::size_t i = 0; i < scan.spine.size(); ++i) {
    polygon.push_back({scan.spine[i].position_mm, scan.tangents[i], 0, 1, 0});
  }
  const SurfaceFit structure =
      FindStructure(polygon, even_mm, blocks, blocks, {.caution = kDescription.caution});
  SurfaceFitOptions options{.reach_mm = 0.5 * even_mm, .max_length_mm = 2.0 * LengthOf(polygon)};
  options.priors = structure.priors;
  SurfaceFit fit = FitSurface(structure.tube, blocks, options);
  // What lines and arcs leave of the spine turns straights as much as it moves them.
  fit.turn_surplus.resize(0);
  SetCovariance(fit.covariance, options.free_pipe_radius, fit);
  const TubeEnds ends = FindTubeEnds(fit.tube, fit.sigma_mm, blocks);
  measurement.tube = ends.tube;
  measurement.tube.pipe_radius_mm = mean_mm;

  const SpineDistance distance(hal::SpineSegments(measurement.tube.program, measurement.tube.X_WT),
                               scan.radius_mm);
  double sum2 = 0, most = 0;
  for (const SpineSample& sample : scan.spine) {
    const double d = distance(sample.position_mm);
    sum2 += d * d;
    most = std::max(most, d);
  }
  const double rms_mm = std::sqrt(sum2 / static_cast<double>(scan.spine.size()));

  // The even pipe takes the radius for known; that it is not makes the spine less sure.
  const double factor =
      std::sqrt(scan.fit.radius_inflation * std::max(1.0, design_effect / fit.design_effect) +
                OfSpineLeft(fit, rms_mm));
  measurement.sigma = fit.sigma;
  for (hal::BendRow& row : measurement.sigma.rows) {
    row.length_mm *= factor;
    row.rotation_deg *= factor;
    row.angle_deg *= factor;
    if (row.bend_radius_mm) *row.bend_radius_mm *= factor;
  }
  auto& rows = measurement.sigma.rows;
  if (rows.size() == 1) {
    rows.front().length_mm = std::hypot(ends.first_sigma_mm, ends.last_sigma_mm);
  } else if (!rows.empty()) {
    rows.front().length_mm = std::hypot(rows.front().length_mm, ends.first_sigma_mm);
    rows.back().length_mm = std::hypot(rows.back().length_mm, ends.last_sigma_mm);
  }
  measurement.warnings.push_back("canal model: " + Range(scan) +
                                 " along the spine; the rows are the lines and arcs nearest "
                                 "to that spine, which leaves them by " +
                                 Mm(rms_mm) + " rms and " + Mm(most) +
                                 " at most, and the pipe radius is the mean.");
}

}  // namespace

Measurement DescribeCanal(const CanalScan& scan, bool freeform, const hal::Clock& clock) {
  StageTimer timer(clock);
  Measurement measurement;
  measurement.spine = scan.spine;
  measurement.joint.is_known = false;
  measurement.structure_margin = measurement.halves_differ_sigma =
      std::numeric_limits<double>::quiet_NaN();
  measurement.noise_mm = scan.fit.sigma_mm;
  const double design_effect = DesignEffect(scan);
  measurement.pipe_radius_sigma_mm =
      std::hypot(scan.fit.pipe_radius_sigma_mm * std::sqrt(design_effect), RadiusScatterMm(scan));
  DescribePoints(scan, measurement);
  if (scan.is_closed) {
    measurement.warnings.push_back(std::string(kClosedTube) +
                                   "; where its spine begins and ends here is arbitrary.");
  }
  if (freeform) {
    measurement.tube.pipe_radius_mm = MeanRadius(scan);
    measurement.tube.X_WT = StartPose(scan);
    measurement.warnings.push_back(
        "free-form model: " + Range(scan) +
        "; a spine without lines and arcs has no lengths, rotations and angles, so there are no "
        "rows: see the spine.");
  } else {
    FitRows(scan, design_effect, measurement);
  }
  timer.Done("description");
  measurement.timing = scan.timing;
  measurement.timing.insert(measurement.timing.end(), timer.times.begin(), timer.times.end());
  return measurement;
}

}  // namespace bendloop::pipeline
