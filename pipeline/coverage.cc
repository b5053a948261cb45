// SPDX-License-Identifier: Apache-2.0
#include "pipeline/coverage.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "pipeline/statistics.h"

namespace bendloop::pipeline {
namespace {

constexpr double kOutlier = 5.0;             // sigma
constexpr std::size_t kMaxSurface = 20'000;  // samples kept for deviations and pictures
constexpr double kBin = 0.5;                 // of r_P: resolution of coverage and spine
constexpr double kMostBins = 1e5;

}  // namespace

void DescribeSamples(std::span<const PointBlock> blocks, std::size_t all_samples, double sigma_mm,
                     Measurement& measurement) {
  const hal::Tube& tube = measurement.tube;
  const auto segments = hal::SpineSegments(tube.program, tube.X_WT);
  const double length_mm = hal::SpineLength(tube.program);
  const double bin_mm = std::max(kBin * tube.pipe_radius_mm, length_mm / kMostBins);
  const auto bins = static_cast<std::size_t>(std::ceil(length_mm / bin_mm)) + 1;
  std::vector<std::size_t> count(bins, 0);
  std::vector<double> sum(bins, 0.0);
  std::vector<double> magnitudes;
  std::vector<SurfaceSample> surface;
  const std::vector<SegmentFrame> frames = SegmentFrames(segments);
  std::vector<std::int32_t> candidates;
  const std::size_t most = CountPoints(blocks);
  magnitudes.reserve(most);
  // Of very many points not even the candidates for a picture are all kept.
  const std::size_t sparse = most / (4 * kMaxSurface) + 1;
  double sum2 = 0;
  for (const PointBlock& block : blocks) {
    CandidateSegments(block, frames, 1.5 * tube.pipe_radius_mm, candidates);
    if (candidates.empty()) continue;
    for (const Eigen::Vector3d& point : block.points) {
      const SpineFoot foot = NearestFoot(point, segments, frames, candidates);
      const double d = foot.distance_mm - tube.pipe_radius_mm;
      const double s =
          segments[static_cast<std::size_t>(foot.segment)].from_start_mm + foot.along_mm;
      const double margin_mm = 0.2 * tube.pipe_radius_mm;
      if (std::abs(d) > kOutlier * sigma_mm || s < -margin_mm || s > length_mm + margin_mm)
        continue;
      magnitudes.push_back(std::abs(d));
      sum2 += d * d;
      if (magnitudes.size() % sparse == 0) surface.push_back({point, d});
      const auto bin = static_cast<std::size_t>(std::clamp(s, 0.0, length_mm) / bin_mm);
      ++count[bin];
      sum[bin] += d;
    }
  }
  FitQuality& fit = measurement.fit;
  fit.samples = magnitudes.size();
  fit.outliers = all_samples - std::min(all_samples, magnitudes.size());
  fit.rms_distance_mm =
      magnitudes.empty() ? 0.0 : std::sqrt(sum2 / static_cast<double>(magnitudes.size()));
  fit.p95_abs_distance_mm = Quantile(magnitudes, 0.95);
  fit.median_abs_distance_mm = Median(std::move(magnitudes));

  measurement.surface.clear();
  const std::size_t stride = surface.size() / kMaxSurface + 1;
  for (std::size_t i = 0; i < surface.size(); i += stride)
    measurement.surface.push_back(surface[i]);

  // A place is covered when samples lie within a pipe radius along the spine: laser lines further
  // apart than that leave gaps that a bend could hide in.
  double uncovered = 0;
  double gap = 0;
  const auto covered = [&](std::size_t bin) {
    const std::size_t low = bin == 0 ? 0 : bin - 1;
    const std::size_t high = std::min(bin + 1, bins - 1);
    return count[low] + count[bin] + count[high] > 0;
  };
  measurement.longest_gap_mm = 0;
  for (std::size_t bin = 0; bin + 1 < bins; ++bin) {
    if (covered(bin)) {
      gap = 0;
      continue;
    }
    uncovered += bin_mm;
    gap += bin_mm;
    measurement.longest_gap_mm = std::max(measurement.longest_gap_mm, gap);
  }
  measurement.coverage = length_mm > 0 ? std::clamp(1.0 - uncovered / length_mm, 0.0, 1.0) : 0.0;

  measurement.spine.clear();
  std::size_t segment = 0;
  for (std::size_t bin = 0; bin < bins; ++bin) {
    const double s = std::min(static_cast<double>(bin) * bin_mm, length_mm);
    while (segment + 1 < segments.size() &&
           s > segments[segment].from_start_mm + segments[segment].length_mm) {
      ++segment;
    }
    const double mean = count[bin] > 0 ? sum[bin] / static_cast<double>(count[bin]) : 0.0;
    measurement.spine.push_back({segments[segment].PointAt(s - segments[segment].from_start_mm),
                                 tube.pipe_radius_mm + mean});
  }
}

}  // namespace bendloop::pipeline
