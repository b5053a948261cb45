// SPDX-License-Identifier: Apache-2.0
#include "pipeline/structure/explained_parts.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <utility>

#include "hal/spine.h"
#include "pipeline/fit/surface_pass.h"
#include "pipeline/math/quantiles.h"

namespace bendloop::pipeline {
namespace {

// Where samples are explained worse than elsewhere. By trial.
struct ExplainedSettings {
  // [variances of a sample] Least excess of a segment's squared distances.
  double least_excess = 100;
  // [sigma of the excess] What is no chance.
  double clear_excess_sigmas = 6;
  // [sigma of a sample] What a distance counts at most.
  double cut_sigmas = 5;
};
constexpr ExplainedSettings kExplained;

// By segment: by how much the squared distances of its samples are more than elsewhere, in
// variances; 0 where that may be chance. What is far off counts no more than a few sigma: fliers
// are everywhere.
std::vector<double> Excess(const SurfaceFit& fit, std::span<const PointBlock> blocks,
                           double reach_mm) {
  const double r = fit.tube.pipe_radius_mm;
  const auto segments = hal::SpineSegments(fit.tube.program, fit.tube.X_WT);
  SurfaceAssignment assignment;
  AssignPoints(SegmentFrames(segments, kBeyond * r, fit.flattening), r, blocks, reach_mm,
               assignment);
  const double limit_mm = kExplained.cut_sigmas * std::hypot(fit.sigma_mm, fit.form_mm);
  const double scale_mm = std::sqrt(fit.variance_mm2 / fit.design_effect);
  std::vector<double> excess, mean_square;
  for (const SegmentPoints& points : assignment.segments) {
    double sum = 0;
    const auto n = static_cast<double>(points.size);
    for (const double distance : points.distance.head(static_cast<Eigen::Index>(points.size))) {
      const double d = std::min(std::abs(distance), limit_mm) / scale_mm;
      sum += d * d;
    }
    if (points.size > 0) mean_square.push_back(sum / n);
    excess.push_back(sum);
  }
  const double usual = std::max(1.0, Median(mean_square));
  for (std::size_t k = 0; k < excess.size(); ++k) {
    const auto n = static_cast<double>(assignment.segments[k].size);
    excess[k] -= usual * n;
    const double chance =
        kExplained.clear_excess_sigmas * std::sqrt(2.0 * n) * usual * fit.design_effect;
    if (excess[k] < std::max(kExplained.least_excess, chance)) excess[k] = 0;
  }
  return excess;
}

}  // namespace

std::vector<StructureWindow> BadlyExplainedParts(const SurfaceFit& fit,
                                                 std::span<const PointBlock> blocks,
                                                 double reach_mm) {
  const std::vector<double> excess = Excess(fit, blocks, reach_mm);
  std::vector<std::pair<double, StructureWindow>> parts;
  for (std::size_t k = 0; k < excess.size(); ++k) {
    if (excess[k] <= 0) continue;
    const std::size_t first = k;
    double sum = 0;
    for (; k < excess.size() && excess[k] > 0; ++k) sum += excess[k];
    // The bends in it, and the one before and after.
    const std::size_t before = first / 2, after = k / 2;
    parts.push_back({-sum,
                     {before - std::min<std::size_t>(before, 1),
                      std::min(after + 1, fit.tube.program.bend_count())}});
  }
  std::stable_sort(parts.begin(), parts.end(),
                   [](const auto& a, const auto& b) { return a.first < b.first; });
  std::vector<StructureWindow> windows;
  for (const auto& part : parts) windows.push_back(part.second);
  return windows;
}

}  // namespace bendloop::pipeline
