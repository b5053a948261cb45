// SPDX-License-Identifier: Apache-2.0
#include "pipeline/structure/nominal_die.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>
#include <vector>

#include "hal/angles.h"
#include "pipeline/fit/one_die.h"
#include "pipeline/structure/nominal_along.h"

namespace bendloop::pipeline {
namespace {

struct NominalDieSettings {
  // [of the radius] Its springback, give or take, which all bends of a die have in common.
  double springback = 0.02;
  // [of the radius] By less they are as wide as the nominal's; of so few bends, that do not tell a
  // die by themselves (one_die.cc), by less.
  double as_wide = 0.02, few_as_wide = 0.002;
  std::size_t few_bends = 3;
  // [sigma] From which on they are wider.
  double wider_sigmas = 3.0;
  // [of the radius] Nominal radii that differ by no more are of one die.
  double same = 0.03;
  // [twice the logarithm of the odds] What an easing costs (bends_with_bows.cc).
  double easing_price = 2.0;
};
constexpr NominalDieSettings kNominalDie;

// Of the bends' radii, along the found tube. None: not all are of one die, or it is another part.
std::optional<double> NominalRadiusMm(const hal::BendProgram& nominal, const SurfaceFit& fit) {
  if (nominal.bend_count() != fit.tube.program.bend_count()) return std::nullopt;
  double least_mm = 0, most_mm = 0;
  for (std::size_t i = 0; i < nominal.bend_count(); ++i) {
    const double radius_mm = nominal.rows[i].bend_radius_mm.value_or(0.0);
    if (!(radius_mm > 0)) return std::nullopt;
    least_mm = i == 0 ? radius_mm : std::min(least_mm, radius_mm);
    most_mm = std::max(most_mm, radius_mm);
  }
  if (most_mm > (1.0 + kNominalDie.same) * least_mm) return std::nullopt;
  if (!MayBeByCorners(nominal, fit.tube, fit.sigma)) return std::nullopt;
  return 0.5 * (least_mm + most_mm);
}

// Of bends that ease, whether the samples leave their arcs open.
bool IsVague(const SurfaceFit& fit, double nominal_mm) {
  const auto& rows = fit.sigma.rows;
  return std::any_of(rows.begin(), rows.end() - 1, [nominal_mm](const hal::BendRow& row) {
    return row.bend_radius_mm.value_or(0.0) > kNominalDie.springback * nominal_mm;
  });
}

// [mm^2] Of what bends of that radius ease over to look as they do. None: they are no wider.
std::optional<double> EasingMm2(const SurfaceFit& fit, double nominal_mm) {
  double sum = 0, weights = 0, wider = 0;
  const std::size_t bends = fit.tube.program.bend_count();
  for (std::size_t i = 0; i < bends; ++i) {
    const hal::BendRow& row = fit.tube.program.rows[i];
    const double angle = row.angle_deg * hal::kRadiansPerDegree, square = angle * angle / 12.0;
    const double radius_mm = row.bend_radius_mm.value_or(0.0);
    const double eased_mm2 = fit.easing.empty() ? 0.0 : fit.easing.variance_mm2[i];
    const double sigma_mm2 = square * 2.0 * std::max(1e-9, radius_mm) *
                             std::max(1e-9, fit.sigma.rows[i].bend_radius_mm.value_or(0.0));
    const double weight = 1.0 / (sigma_mm2 * sigma_mm2);
    sum += weight * (square * (radius_mm * radius_mm - nominal_mm * nominal_mm) + eased_mm2);
    weights += weight;
    wider = std::max(wider, radius_mm / nominal_mm - 1.0);
  }
  const double mean_mm2 = sum / weights;
  if (!fit.easing.empty()) return mean_mm2 > 0 ? std::optional(mean_mm2) : std::nullopt;
  const bool is_few = bends <= kNominalDie.few_bends;
  if (wider < (is_few ? kNominalDie.few_as_wide : kNominalDie.as_wide)) return std::nullopt;
  if (!(mean_mm2 > kNominalDie.wider_sigmas / std::sqrt(weights))) return std::nullopt;
  return mean_mm2;
}

// [twice the logarithm of the odds] Against radii that differ so from the nominal's, as springback
// makes all of them, and from each other.
double AgainstRadii(const hal::BendProgram& program, double nominal_mm) {
  const auto bends = static_cast<double>(program.bend_count());
  double mean = 0, apart = 0;
  for (std::size_t i = 0; i < program.bend_count(); ++i) {
    mean += (program.rows[i].bend_radius_mm.value_or(0.0) / nominal_mm - 1.0) / bends;
  }
  for (std::size_t i = 0; i < program.bend_count(); ++i) {
    const double off = program.rows[i].bend_radius_mm.value_or(0.0) / nominal_mm - 1.0 - mean;
    apart += std::pow(off / kRadiiOfOneDie, 2);
  }
  return std::pow(mean / kNominalDie.springback, 2) + apart;
}

}  // namespace

void TryNominalDie(const hal::BendProgram& nominal, std::span<const PointBlock> blocks,
                   const SurfaceFitOptions& options, BowedSolution& solution) {
  const SurfaceFit& fit = solution.fit;
  const std::size_t bends = fit.tube.program.bend_count();
  const bool is_sharp = fit.easing.empty();
  if (bends == 0) return;
  const auto nominal_mm = NominalRadiusMm(nominal, fit);
  if (!nominal_mm || !(is_sharp || IsVague(fit, *nominal_mm))) return;
  const auto easing_mm2 = EasingMm2(fit, *nominal_mm);
  if (!easing_mm2) return;
  const auto start = WithBendRadii(fit.tube, *nominal_mm);
  if (!start) return;
  SurfaceFitOptions of_die = options;
  of_die.priors.radii_alike = 0;
  of_die.priors.bend_radius = UsualBendRadius{*nominal_mm, kNominalDie.springback * *nominal_mm};
  of_die.easing = fit.easing;
  of_die.easing.variance_mm2.assign(bends, *easing_mm2);
  BowedSolution eased = SolveWithBows(*start, blocks, of_die);
  if (eased.fit.tube.program.bend_count() != bends || eased.fit.easing.empty()) return;
  const double better = AdvantageOf(eased, solution, blocks, options.reach_mm) +
                        AgainstRadii(fit.tube.program, *nominal_mm) -
                        AgainstRadii(eased.fit.tube.program, *nominal_mm) -
                        (is_sharp ? kNominalDie.easing_price : 0.0);
  const double of_eased = 1.0 / (1.0 + std::exp(-0.5 * better));
  if (better > 0) std::swap(eased, solution);
  DoubtBy(eased, std::min(of_eased, 1.0 - of_eased), options.free_pipe_radius, solution);
}

}  // namespace bendloop::pipeline
