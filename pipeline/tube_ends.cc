// SPDX-License-Identifier: Apache-2.0
#include "pipeline/tube_ends.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>
#include <vector>

#include "hal/spine.h"
#include "pipeline/statistics.h"

namespace bendloop::pipeline {
namespace {

constexpr double kOnSurface = 4.0;  // sigma
constexpr double kWindow = 3.0;     // of r_P: how far inward the local spacing is looked at
constexpr double kCrowd = 0.15;     // of the points that usually stand together; less are fliers
constexpr double kEven = 0.3;       // scatter of the gaps between laser lines, of their mean

constexpr double kBeyondNodes = 2.0;  // of r_P: the nodes reach this near to the tube's ends
constexpr std::size_t kSectors = 16;
constexpr double kDisagreement = 0.15;  // of r_P, beyond the borders' own width

struct Border {
  double at_mm = 0;
  double sigma_mm = 0;
};

// How the points of a straight follow each other along it.
struct Spacing {
  // Length-weighted mean gap: the distance between laser lines however dense they are along
  // themselves, and twice the mean gap of scattered points.
  double gap_mm = 0;
  double usual_crowd = 0;  // points within a third of a gap after a point, median
  bool even = false;       // the gaps that matter are alike, as between laser lines
};

double CrowdAt(const std::vector<double>& inward, std::size_t i, double reach_mm) {
  return static_cast<double>(std::upper_bound(inward.begin() + static_cast<std::ptrdiff_t>(i),
                                              inward.end(), inward[i] + reach_mm) -
                             (inward.begin() + static_cast<std::ptrdiff_t>(i)));
}

Spacing SpacingWithin(const std::vector<double>& inward, std::size_t begin, std::size_t end) {
  Spacing spacing;
  double sum = 0, sum2 = 0;
  for (std::size_t k = begin; k + 1 < end; ++k) {
    const double gap = inward[k + 1] - inward[k];
    sum += gap;
    sum2 += gap * gap;
  }
  if (sum <= 0) return spacing;
  spacing.gap_mm = sum2 / sum;
  double count = 0;
  sum = sum2 = 0;
  std::vector<double> crowds;
  for (std::size_t k = begin; k + 1 < end; ++k) {
    crowds.push_back(CrowdAt(inward, k, spacing.gap_mm / 3.0));
    const double gap = inward[k + 1] - inward[k];
    if (gap < 0.3 * spacing.gap_mm) continue;
    count += 1;
    sum += gap;
    sum2 += gap * gap;
  }
  spacing.usual_crowd = Median(std::move(crowds));
  const double mean = sum / std::max(1.0, count);
  spacing.even = count > 0 && sum2 / count - mean * mean < kEven * kEven * mean * mean;
  return spacing;
}

// `inward`: distances along the straight, growing into the tube, sorted.
std::optional<Border> FindBorder(const std::vector<double>& inward, double pipe_radius_mm) {
  if (inward.size() < 5) return std::nullopt;
  // Where the straight certainly has begun.
  const std::size_t begin = inward.size() / 20;
  std::size_t end = begin;
  while (end < inward.size() && inward[end] < inward[begin] + kWindow * pipe_radius_mm) ++end;
  if (end - begin < 4) return std::nullopt;
  const Spacing spacing = SpacingWithin(inward, begin, end);
  if (spacing.gap_mm <= 0) return std::nullopt;
  for (std::size_t i = 0; i < end; ++i) {
    // Lone points beyond the tube are fliers; the border has as many neighbours as the rest.
    if (CrowdAt(inward, i, spacing.gap_mm / 3.0) < kCrowd * spacing.usual_crowd) continue;
    if (i + 1 < inward.size() && inward[i + 1] - inward[i] > 4.0 * spacing.gap_mm) continue;
    // The tube ends anywhere before the next line would have come, or one mean gap on.
    return Border{inward[i] - 0.5 * spacing.gap_mm,
                  spacing.gap_mm / (spacing.even ? std::sqrt(12.0) : 1.0)};
  }
  return std::nullopt;
}

// The border that most of the circumference agrees on: a table that the tube lies on, or a clamp
// beside its end, goes on along a part of the turn only and is left out.
std::optional<Border> CommonBorder(std::array<std::vector<double>, kSectors>& sectors,
                                   double pipe_radius_mm) {
  std::vector<double> borders;
  std::array<double, kSectors> own{};
  double width_mm = 0;
  for (std::size_t i = 0; i < kSectors; ++i) {
    std::sort(sectors[i].begin(), sectors[i].end());
    const auto border = FindBorder(sectors[i], pipe_radius_mm);
    own[i] = border ? border->at_mm : -std::numeric_limits<double>::infinity();
    if (!border) continue;
    borders.push_back(border->at_mm);
    width_mm = std::max(width_mm, border->sigma_mm);
  }
  const double common = Median(borders);
  const double tolerance_mm = kDisagreement * pipe_radius_mm + 2.0 * width_mm;
  std::vector<double> pooled;
  for (std::size_t i = 0; i < kSectors; ++i) {
    if (!borders.empty() && std::abs(own[i] - common) > tolerance_mm) continue;
    pooled.insert(pooled.end(), sectors[i].begin(), sectors[i].end());
  }
  std::sort(pooled.begin(), pooled.end());
  return FindBorder(pooled, pipe_radius_mm);
}

// Which part of the turn around a straight's axis the point lies in.
std::size_t SectorOf(const Eigen::Vector3d& point, const hal::SpineSegment& straight) {
  const Eigen::Vector3d v = point - straight.start_mm;
  const double turn =
      std::atan2(v.dot(straight.normal), v.dot(straight.normal.cross(straight.tangent))) /
          (2.0 * std::numbers::pi) +
      0.5;
  return static_cast<std::size_t>(turn * kSectors) % kSectors;
}

}  // namespace

TubeEnds FindTubeEnds(const hal::Tube& tube, double sigma_mm, std::span<const PointBlock> blocks) {
  // An end that no sample shows is where the nodes stopped, give or take two pipe radii.
  const double unseen_mm = 2.0 * tube.pipe_radius_mm;
  TubeEnds ends{tube, unseen_mm, unseen_mm, false, false};
  const auto segments = hal::SpineSegments(tube.program, tube.X_WT);
  const auto last = static_cast<std::int32_t>(segments.size()) - 1;
  std::array<std::vector<double>, kSectors> from_start;
  std::array<std::vector<double>, kSectors> from_end;
  const std::vector<SegmentFrame> frames = SegmentFrames(segments);
  std::vector<std::int32_t> candidates;
  for (const PointBlock& block : blocks) {
    CandidateSegments(block, frames, 1.5 * tube.pipe_radius_mm, candidates);
    if (candidates.empty()) continue;
    if (candidates.front() != 0 && candidates.back() != last) continue;
    for (const Eigen::Vector3d& point : block.points) {
      const SpineFoot foot = NearestFoot(point, segments, frames, candidates);
      if (std::abs(foot.distance_mm - tube.pipe_radius_mm) > kOnSurface * sigma_mm) continue;
      // Further out another part of the tube may lie where the straight would go on.
      const double outward_mm = foot.segment == 0      ? -foot.along_mm
                                : foot.segment == last ? foot.along_mm - segments.back().length_mm
                                                       : 0.0;
      if (outward_mm > kBeyondNodes * tube.pipe_radius_mm) continue;
      if (foot.segment == 0) {
        from_start[SectorOf(point, segments.front())].push_back(foot.along_mm);
      }
      if (foot.segment == last) {
        from_end[SectorOf(point, segments.back())].push_back(-foot.along_mm);
      }
    }
  }
  auto& rows = ends.tube.program.rows;
  const double first_mm = rows.front().length_mm;
  double start_mm = 0;
  if (const auto border = CommonBorder(from_start, tube.pipe_radius_mm)) {
    start_mm = std::min(border->at_mm, first_mm);
    ends.first_sigma_mm = border->sigma_mm;
    ends.first_seen = true;
  }
  ends.tube.X_WT.position_mm += start_mm * segments.front().tangent;
  rows.front().length_mm = first_mm - start_mm;
  if (const auto border = CommonBorder(from_end, tube.pipe_radius_mm)) {
    ends.last_sigma_mm = border->sigma_mm;
    ends.last_seen = true;
    rows.back().length_mm = std::max(0.0, -border->at_mm - (last == 0 ? start_mm : 0.0));
  } else if (last == 0) {
    rows.back().length_mm -= start_mm;
  }
  return ends;
}

}  // namespace bendloop::pipeline
