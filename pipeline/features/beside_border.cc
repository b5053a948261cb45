// SPDX-License-Identifier: Apache-2.0
#include "pipeline/features/beside_border.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <utility>
#include <vector>

#include "pipeline/math/quantiles.h"

namespace bendloop::pipeline {
namespace {

struct BesideSettings {
  double most_gap_probes = 400;
  // Sides are as many as have so many samples each, at most and at least so many.
  double of_side = 5.0;
  int most_sides = 24, least_sides = 8;
};
constexpr BesideSettings kBeside;

}  // namespace

double GapBeside(const OpeningBorder& border, const PlaneSamples& present, double pipe_radius_mm) {
  std::vector<double> gaps;
  const double from_mm = 0.25 * border.width_mm, to_mm = from_mm + 0.5 * border.width_mm;
  // Places spread evenly over the ring (Vogel's spiral).
  const double reach_mm = 0.5 * border.length_mm + to_mm;
  const double n = kBeside.most_gap_probes;
  for (double i = 0.5; i < n; i += 1.0) {
    const double radius = reach_mm * std::sqrt(i / n);
    const double turn = i * std::numbers::pi * (3.0 - std::sqrt(5.0));
    const Eigen::Vector2d place =
        border.middle_mm + radius * Eigen::Vector2d(std::cos(turn), std::sin(turn));
    const double off_mm = border.DistanceMm(place);
    if (std::abs(place.y()) > kLimb * pipe_radius_mm) continue;
    if (off_mm > from_mm && off_mm < to_mm) gaps.push_back(present.NearestMm(place));
  }
  return Quantile(std::move(gaps), 0.98);
}

BorderSides SidesOf(const OpeningBorder& border, std::span<const Eigen::Vector2d> wall,
                    double clear_mm, double reach_mm, double least_side_mm) {
  std::vector<double> turns;
  for (const Eigen::Vector2d& place : wall) {
    const double off_mm = border.DistanceMm(place);
    if (off_mm < -clear_mm || off_mm > reach_mm) continue;
    // Sides by how far around the border: that of a long slot is stretched to be round.
    const double c = std::cos(border.axis_rad), s = std::sin(border.axis_rad);
    const Eigen::Vector2d from = place - border.middle_mm;
    const double x = (c * from.x() + s * from.y()) * border.width_mm / border.length_mm;
    turns.push_back(std::atan2(c * from.y() - s * from.x(), x) / (2.0 * std::numbers::pi) + 0.5);
  }
  const double around_mm =
      std::numbers::pi * border.width_mm + 2.0 * (border.length_mm - border.width_mm);
  const double most = std::min(static_cast<double>(turns.size()) / kBeside.of_side,
                               around_mm / std::max(least_side_mm, 1e-9));
  const int sides = std::clamp(static_cast<int>(std::min<double>(most, kBeside.most_sides)),
                               kBeside.least_sides, kBeside.most_sides);
  std::vector<bool> has(static_cast<std::size_t>(sides), false);
  for (const double turn : turns) {
    has[std::min(static_cast<std::size_t>(turn * sides), has.size() - 1)] = true;
  }
  return {static_cast<int>(std::count(has.begin(), has.end(), true)), sides};
}

}  // namespace bendloop::pipeline
