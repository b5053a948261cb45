// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/one_die.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include "hal/angles.h"
#include "pipeline/tube/representations.h"

namespace bendloop::pipeline {
namespace {

struct OneDieSettings {
  // [of their mean] 1 sigma of the radii: as of usual ones (usual_bend_radius.cc).
  double alike = 0.015;
  // [of r_P] No die is tighter.
  double tightest = 1.0;
  // [variances, a bend] By which radii of one die may explain the points worse, and their spread
  // cost: one that is known to 1.5 % and not to three pipe radii (ExpectedRange()) is worth twice
  // the logarithm of the ratio.
  double worse = 6.0;
};
constexpr OneDieSettings kOneDie;

struct Die {
  double bend_radius_mm = 0, easing_mm2 = 0;
};

// Least squares of the curvatures' variances by the squares of the angles. None: greater angles
// have no longer arcs.
std::optional<Die> DieOf(const SurfaceFit& fit) {
  const auto bends = static_cast<double>(fit.tube.program.bend_count());
  const Easing within = EasingWithin(fit.tube.program, fit.easing);
  double x = 0, y = 0, xx = 0, xy = 0;
  for (std::size_t i = 0; i < fit.tube.program.bend_count(); ++i) {
    const hal::BendRow& row = fit.tube.program.rows[i];
    const double angle = row.angle_deg * hal::kRadiansPerDegree;
    const double square = angle * angle / 12.0;
    const double radius_mm = row.bend_radius_mm.value_or(0.0);
    const double variance = square * radius_mm * radius_mm + within.variance_mm2[i];
    x += square / bends;
    y += variance / bends;
    xx += square * square / bends;
    xy += square * variance / bends;
  }
  const double spread = xx - x * x;
  if (!(spread > 1e-6)) return std::nullopt;
  const double slope = (xy - x * y) / spread;
  const double r_mm = kOneDie.tightest * fit.tube.pipe_radius_mm;
  if (!(slope > r_mm * r_mm) || !(y - slope * x > 0)) return std::nullopt;
  return Die{std::sqrt(slope), y - slope * x};
}

}  // namespace

void TryOneDie(std::span<const PointBlock> blocks, const SurfaceFitOptions& options,
               BowedSolution& solution) {
  const SurfaceFit& fit = solution.fit;
  const std::size_t bends = fit.tube.program.bend_count();
  if (fit.easing.empty() || bends < 2) return;
  const auto die = DieOf(fit);
  auto corners = PolygonFromTube(fit.tube);
  if (!die || !corners) return;
  for (auto& radius_mm : corners->bend_radii_mm) radius_mm = die->bend_radius_mm;
  auto start = TubeFromPolygon(*corners);
  if (!start) return;
  start->pipe_radius_mm = fit.tube.pipe_radius_mm;
  SurfaceFitOptions of_die = options;
  of_die.priors.bend_radius.reset();
  of_die.priors.radii_alike = kOneDie.alike;
  of_die.easing = fit.easing;
  of_die.easing.variance_mm2.assign(bends, die->easing_mm2);
  BowedSolution other = SolveWithBows(*start, blocks, of_die);
  if (other.fit.tube.program.bend_count() != bends) return;
  FitPriors alike;
  alike.radii_alike = kOneDie.alike;
  const double better = AdvantageOf(other, solution, blocks, options.reach_mm) -
                        alike.ChiSquare(other.fit.tube.program, {});
  if (!(better > -kOneDie.worse * static_cast<double>(bends))) return;
  solution = std::move(other);
}

}  // namespace bendloop::pipeline
