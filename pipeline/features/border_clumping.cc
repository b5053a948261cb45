// SPDX-License-Identifier: Apache-2.0
#include "pipeline/features/border_clumping.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <vector>

#include "pipeline/features/plane_samples.h"
#include "pipeline/fit/surface_points.h"

namespace bendloop::pipeline {
namespace {

// [of the border's width] So far beside it samples are asked; and how many of a side tell.
constexpr double kReachOfWidth = 0.5;
constexpr std::size_t kLeastOfSide = 8;
// Samples whose distance to the nearest says how evenly they are scattered.
constexpr std::size_t kAskedForNearest = 150;

// Scattered samples have their nearest half of 1 / sqrt(density) away (Clark & Evans 1954), so
// these count as many as would have theirs where it is.
double ClumpingOfNearest(const OpeningBorder& border, std::span<const Eigen::Vector2d> samples) {
  const SampleDensity density = DensityBeside(border, samples);
  const PlaneSamples in_cells(samples);
  const std::size_t stride = StrideTo(samples.size(), kAskedForNearest);
  double sum_mm = 0, count = 0;
  for (std::size_t i = 0; i < samples.size(); i += stride) {
    if (border.DistanceMm(samples[i]) > kReachOfWidth * border.width_mm) continue;
    sum_mm += in_cells.NearestOtherMm(samples[i]);
    count += 1;
  }
  if (!(sum_mm > 0) || !(density.per_mm2 > 0)) return 1.0;
  return std::max(1.0, 0.5 / std::sqrt(density.per_mm2) / (sum_mm / count));
}

// 1 sigma of how far the next one is from anywhere, over that of as many scattered ones (Cox,
// Renewal Theory, 1962, section 5.2: forward recurrence time). `offsets_mm`: become sorted.
double ClumpingOf(std::vector<double>& offsets_mm) {
  if (offsets_mm.size() < kLeastOfSide) return 1.0;
  std::sort(offsets_mm.begin(), offsets_mm.end());
  double sum = 0, squares = 0, cubes = 0;
  for (std::size_t i = 1; i < offsets_mm.size(); ++i) {
    const double gap_mm = offsets_mm[i] - offsets_mm[i - 1];
    sum += gap_mm;
    squares += gap_mm * gap_mm;
    cubes += gap_mm * gap_mm * gap_mm;
  }
  if (!(sum > 0)) return 1.0;
  const double mean_mm = 0.5 * squares / sum;
  const double variance_mm2 = cubes / (3.0 * sum) - mean_mm * mean_mm;
  const double of_scattered_mm = sum / static_cast<double>(offsets_mm.size() - 1);
  return std::max(1.0, std::sqrt(std::max(0.0, variance_mm2)) / of_scattered_mm);
}

}  // namespace

Clumping ClumpingBeside(const OpeningBorder& border, std::span<const Eigen::Vector2d> samples) {
  if (samples.empty()) return {};
  // Ends and sides, each on either.
  std::array<std::array<std::vector<double>, 2>, 2> offsets_mm;
  const double line_mm = border.length_mm - border.width_mm;
  for (const Eigen::Vector2d& sample : samples) {
    const double off_mm = border.DistanceMm(sample);
    if (off_mm < 0 || off_mm > kReachOfWidth * border.width_mm) continue;
    const Eigen::Vector2d from = sample - border.middle_mm;
    const double along = from.dot(border.Axis()), across = from.dot(border.Across());
    const bool is_side = std::abs(along) - 0.5 * line_mm < std::abs(across);
    const bool is_first = (is_side ? across : along) < 0;
    offsets_mm[is_side ? 1 : 0][is_first ? 0 : 1].push_back(off_mm);
  }
  const double least = ClumpingOfNearest(border, samples);
  const auto of = [least](std::array<std::vector<double>, 2>& sides) {
    const double first = ClumpingOf(sides[0]), last = ClumpingOf(sides[1]);
    return std::max(least, std::sqrt(0.5 * (first * first + last * last)));
  };
  return {of(offsets_mm[0]), of(offsets_mm[1])};
}

}  // namespace bendloop::pipeline
