// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/one_die.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>
#include <vector>

#include "hal/angles.h"
#include "pipeline/tube/representations.h"

namespace bendloop::pipeline {
namespace {

struct OneDieSettings {
  // [of r_P] No die is tighter.
  double tightest = 1.0;
  // [variances, a bend] By which radii of one die may explain the points worse, and their spread
  // cost: one that is known to 1.5 % and not to three pipe radii (ExpectedRange()) is worth twice
  // the logarithm of the ratio.
  double worse = 6.0;
  // Bends that may be sharp: of so many at least the radii must differ by so many sigma, root mean
  // square, and agree to so many, or to such a part of that, as those of one die. Two numbers say
  // how they differ then. Other reasons for which radii differ (springback, several dies) do not
  // follow the angle, and that of one die is one to such a part.
  std::size_t least_bends = 4;
  double differ_sigmas = 3.0, agree_sigmas = 1.5, agree_part = 0.2, alike = 0.0005;
  // Root mean square of the parts by which variances of curvatures differ from those of a die, up
  // to which all of them are its. Of radii that differ by a tenth it is some hundredths.
  double same = 0.01;
  // Nearer to it they are no surer to be.
  double nearest = 0.001;
};
constexpr OneDieSettings kOneDie;

struct Die {
  double bend_radius_mm = 0, easing_mm2 = 0;
};

std::vector<double> EasedMm2(const SurfaceFit& fit) {
  if (fit.easing.empty()) return std::vector<double>(fit.tube.program.bend_count(), 0.0);
  return EasingWithin(fit.tube.program, fit.easing).variance_mm2;
}

// Least squares of the curvatures' variances by the squares of the angles. None: greater angles
// have no longer arcs.
std::optional<Die> DieOf(const SurfaceFit& fit) {
  const auto bends = static_cast<double>(fit.tube.program.bend_count());
  const std::vector<double> eased_mm2 = EasedMm2(fit);
  double x = 0, y = 0, xx = 0, xy = 0;
  for (std::size_t i = 0; i < fit.tube.program.bend_count(); ++i) {
    const hal::BendRow& row = fit.tube.program.rows[i];
    const double square = VarianceOfArc(row);
    const double radius_mm = row.bend_radius_mm.value_or(0.0);
    const double variance = square * radius_mm * radius_mm + eased_mm2[i];
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

// Sharp bends whose radii differ, and just so as those of one die do where their easing was not
// found: the slighter the bend, the wider.
bool LooksEased(const SurfaceFit& fit, const Die& die) {
  const auto bends = static_cast<double>(fit.tube.program.bend_count());
  double differ = 0, agree = 0;
  for (std::size_t i = 0; i < fit.tube.program.bend_count(); ++i) {
    const hal::BendRow& row = fit.tube.program.rows[i];
    const double radius_mm = row.bend_radius_mm.value_or(0.0);
    const double sigma_mm = std::hypot(fit.sigma.rows[i].bend_radius_mm.value_or(0.0),
                                       kOneDie.alike * die.bend_radius_mm);
    const double as_sharp_mm =
        std::sqrt(std::pow(die.bend_radius_mm, 2) + die.easing_mm2 / VarianceOfArc(row));
    differ += std::pow((radius_mm - die.bend_radius_mm) / sigma_mm, 2) / bends;
    agree += std::pow((radius_mm - as_sharp_mm) / sigma_mm, 2) / bends;
  }
  return differ > std::pow(kOneDie.differ_sigmas, 2) &&
         agree <
             std::max(std::pow(kOneDie.agree_sigmas, 2), std::pow(kOneDie.agree_part, 2) * differ);
}

// Root mean square of the parts by which variances of the bends' curvatures are not those of bends
// of this die.
double ApartFrom(const Die& die, const BowedSolution& solution) {
  const auto& rows = solution.fit.tube.program.rows;
  const std::size_t bends = solution.fit.tube.program.bend_count();
  const std::vector<double> eased_mm2 = EasedMm2(solution.fit);
  double apart = 0;
  for (std::size_t i = 0; i < bends; ++i) {
    const double radius_mm = rows[i].bend_radius_mm.value_or(0.0), square = VarianceOfArc(rows[i]);
    const double of_die_mm2 = square * die.bend_radius_mm * die.bend_radius_mm + die.easing_mm2;
    const double off = (square * radius_mm * radius_mm + eased_mm2[i]) / of_die_mm2 - 1.0;
    apart += off * off / static_cast<double>(bends);
  }
  return std::sqrt(apart);
}

// How much worse bends of one die may explain the points [variances]. Where all of them tell of the
// die, what is arc, and what is easing, is all that is another: what neither tube explains tells
// these apart, too, by chance; and by chance bends of other radii would hardly tell of one, each
// beyond the two that any die fits as hardly as they are near to it. Else that is a reason not to
// take other radii.
double MayBeWorse(const BowedSolution& solution, const Die& die) {
  const auto bends = static_cast<double>(solution.fit.tube.program.bend_count());
  const double worse = kOneDie.worse * bends;
  if (solution.fit.tube.program.bend_count() < kOneDie.least_bends) return worse;
  const double apart = ApartFrom(die, solution);
  if (apart > kOneDie.same) return worse;
  const double unexplained =
      std::max(1.0, solution.fit.design_effect / std::max(1.0, solution.bows.worth));
  return unexplained * worse - 2.0 * (bends - 2.0) * std::log(std::max(apart, kOneDie.nearest));
}

}  // namespace

double VarianceOfArc(const hal::BendRow& row) {
  const double angle = row.angle_deg * hal::kRadiansPerDegree;
  return angle * angle / 12.0;
}

std::optional<hal::Tube> WithBendRadii(const hal::Tube& tube, double bend_radius_mm,
                                       std::optional<std::size_t> only) {
  auto corners = PolygonFromTube(tube);
  if (!corners) return std::nullopt;
  for (std::size_t i = 0; i < corners->bend_radii_mm.size(); ++i) {
    if (!only || i == *only) corners->bend_radii_mm[i] = bend_radius_mm;
  }
  auto with = TubeFromPolygon(*corners);
  if (!with) return std::nullopt;
  with->pipe_radius_mm = tube.pipe_radius_mm;
  return *with;
}

void TryOneDie(std::span<const PointBlock> blocks, const SurfaceFitOptions& options,
               BowedSolution& solution) {
  const SurfaceFit& fit = solution.fit;
  const std::size_t bends = fit.tube.program.bend_count();
  const bool is_sharp = fit.easing.empty();
  if (bends < (is_sharp ? kOneDie.least_bends : 2)) return;
  const auto die = DieOf(fit);
  if (!die || (is_sharp && !LooksEased(fit, *die))) return;
  const auto start = WithBendRadii(fit.tube, die->bend_radius_mm);
  if (!start) return;
  SurfaceFitOptions of_die = options;
  of_die.priors.bend_radius.reset();
  of_die.priors.radii_alike = kRadiiOfOneDie;
  of_die.easing = fit.easing;
  of_die.easing.variance_mm2.assign(bends, die->easing_mm2);
  BowedSolution other = SolveWithBows(*start, blocks, of_die);
  if (other.fit.tube.program.bend_count() != bends) return;
  FitPriors alike;
  alike.radii_alike = kRadiiOfOneDie;
  const double better = AdvantageOf(other, solution, blocks, options.reach_mm) -
                        alike.ChiSquare(other.fit.tube.program, {});
  if (!(better > -MayBeWorse(solution, *die))) return;
  solution = std::move(other);
}

}  // namespace bendloop::pipeline
