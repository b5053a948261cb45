// SPDX-License-Identifier: Apache-2.0
#include "pipeline/tube_ends.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

#include "hal/spine.h"

namespace bendloop::pipeline {
namespace {

constexpr double kOnSurface = 4.0;  // sigma
constexpr double kWindow = 1.0;     // of r_P: how far inward the local spacing is looked at
constexpr double kCrowd = 0.2;      // of the inner density; less is a few fliers

struct Border {
  double at_mm = 0;
  double sigma_mm = 0;
};

// `inward`: distances along the straight, growing into the tube, sorted.
std::optional<Border> FindBorder(const std::vector<double>& inward, double pipe_radius_mm) {
  if (inward.size() < 5) return std::nullopt;
  const double window = kWindow * pipe_radius_mm;
  const auto count_within = [&inward](double low, double high) {
    return std::lower_bound(inward.begin(), inward.end(), high) -
           std::lower_bound(inward.begin(), inward.end(), low);
  };
  for (std::size_t i = 0; i + 1 < inward.size(); ++i) {
    const double at = inward[i];
    const auto here = count_within(at, at + window);
    const auto further = count_within(at + window, at + 2.0 * window);
    if (static_cast<double>(here) < kCrowd * static_cast<double>(further)) continue;
    // A flier is followed by nothing for a while; a border by the next line or point.
    std::size_t end = i;
    while (end + 1 < inward.size() && inward[end + 1] < at + window) ++end;
    if (end - i < 3) continue;
    double sum = 0, sum2 = 0;
    for (std::size_t k = i; k < end; ++k) {
      const double gap = inward[k + 1] - inward[k];
      sum += gap;
      sum2 += gap * gap;
    }
    // Length-weighted mean gap: the distance between laser lines however dense they are along
    // themselves, and twice the mean gap of scattered points. The border is half of it further out.
    const double spacing = sum > 0 ? sum2 / sum : 0.0;
    if (i + 1 < inward.size() && inward[i + 1] - at > 4.0 * spacing) continue;
    return Border{at - 0.5 * spacing, 0.4 * spacing};
  }
  return std::nullopt;
}

}  // namespace

TubeEnds FindTubeEnds(const hal::Tube& tube, double sigma_mm, std::span<const PointBlock> blocks) {
  TubeEnds ends{tube, 0, 0};
  const auto segments = hal::SpineSegments(tube.program, tube.X_WT);
  const auto last = static_cast<std::int32_t>(segments.size()) - 1;
  std::vector<double> from_start;
  std::vector<double> from_end;
  std::vector<std::int32_t> candidates;
  for (const PointBlock& block : blocks) {
    CandidateSegments(block, segments, 1.5 * tube.pipe_radius_mm, candidates);
    if (candidates.empty()) continue;
    if (candidates.front() != 0 && candidates.back() != last) continue;
    for (const Eigen::Vector3d& point : block.points) {
      const SpineFoot foot = NearestFoot(point, segments, candidates);
      if (std::abs(foot.distance_mm - tube.pipe_radius_mm) > kOnSurface * sigma_mm) continue;
      if (foot.segment == 0) from_start.push_back(foot.along_mm);
      if (foot.segment == last) from_end.push_back(-foot.along_mm);
    }
  }
  std::sort(from_start.begin(), from_start.end());
  std::sort(from_end.begin(), from_end.end());
  auto& rows = ends.tube.program.rows;
  const double first_mm = rows.front().length_mm;
  double start_mm = 0;
  if (const auto border = FindBorder(from_start, tube.pipe_radius_mm)) {
    start_mm = std::min(border->at_mm, first_mm);
    ends.first_sigma_mm = border->sigma_mm;
  }
  ends.tube.X_WT.position_mm += start_mm * segments.front().tangent;
  rows.front().length_mm = first_mm - start_mm;
  if (const auto border = FindBorder(from_end, tube.pipe_radius_mm)) {
    ends.last_sigma_mm = border->sigma_mm;
    rows.back().length_mm = std::max(0.0, -border->at_mm - (last == 0 ? start_mm : 0.0));
  } else if (last == 0) {
    rows.back().length_mm -= start_mm;
  }
  return ends;
}

}  // namespace bendloop::pipeline
