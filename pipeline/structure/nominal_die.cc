// SPDX-License-Identifier: Apache-2.0
#include "pipeline/structure/nominal_die.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>
#include <vector>

#include "pipeline/fit/one_die.h"
#include "pipeline/structure/nominal_along.h"
#include "pipeline/structure/nominal_radii.h"

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
  // [twice the logarithm of the odds] What an easing costs (bends_with_bows.cc).
  double easing_price = 2.0;
  // [twice the logarithm of the odds] Another die than the nominal's is so much less likely, before
  // the scan: one in twenty, of any radius up to a few times it.
  double another_die = 13.0;
  // [twice the logarithm of the odds] From which on samples tell by themselves. [variances] Radii
  // that are so far off are told where they do not.
  double decisive = 9.0, told_variances = 16.0;
};
constexpr NominalDieSettings kNominalDie;

// Of the bends' radii, along the found tube. None: not all are of one die, or it is another part.
std::optional<double> NominalRadiusMm(const hal::BendProgram& nominal, const SurfaceFit& fit) {
  if (nominal.bend_count() != fit.tube.program.bend_count()) return std::nullopt;
  for (std::size_t i = 0; i < nominal.bend_count(); ++i) {
    if (!(nominal.rows[i].bend_radius_mm.value_or(0.0) > 0)) return std::nullopt;
  }
  const NominalRadii radii = NominalRadiiOf(nominal);
  if (!radii.AreOfOneDie()) return std::nullopt;
  if (!MayBeByCorners(nominal, fit.tube, fit.sigma)) return std::nullopt;
  return 0.5 * (radii.least_mm + radii.most_mm);
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
    const double square = VarianceOfArc(row);
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

// How far the bends' radii are over the nominal's, all together as a die has them.
struct OffNominal {
  double mean = 0, variance = 0;  // the latter as the samples leave it
  double apart = 0;               // [variances] from each other
  // [variances] As springback makes all of them.
  double Wider() const { return mean * mean / (std::pow(kNominalDie.springback, 2) + variance); }
  // What is left of what springback leaves (MacKay, Bayesian interpolation, 1992: Occam factor).
  double Left() const {
    return std::sqrt(variance / (variance + std::pow(kNominalDie.springback, 2)));
  }
};
OffNominal OffNominalOf(const SurfaceFit& fit, double nominal_mm) {
  OffNominal off;
  double weights = 0, sum = 0, square = 0, of_samples = 0;
  for (std::size_t i = 0; i < fit.tube.program.bend_count(); ++i) {
    const double by = fit.tube.program.rows[i].bend_radius_mm.value_or(0.0) / nominal_mm - 1.0;
    const double sigma = fit.sigma.rows[i].bend_radius_mm.value_or(0.0) / nominal_mm;
    const double weight = 1.0 / (kRadiiOfOneDie * kRadiiOfOneDie + sigma * sigma);
    weights += weight, sum += weight * by, square += weight * by * by;
    of_samples += weight * weight * sigma * sigma;
  }
  off.mean = sum / weights;
  off.variance = of_samples / (weights * weights);
  off.apart = std::max(0.0, square - sum * off.mean);
  return off;
}

// [twice the logarithm of the odds] Against radii that differ so from the nominal's and from each
// other.
double Against(const OffNominal& off) {
  const double of_another = std::exp(-0.5 * kNominalDie.another_die);
  return off.apart - 2.0 * std::log(off.Left() * std::exp(-0.5 * off.Wider()) + of_another);
}

std::optional<OtherDie> MayBeOf(const OffNominal& sharp, double nominal_mm) {
  if (sharp.Wider() < kNominalDie.told_variances) return std::nullopt;
  return OtherDie{nominal_mm, (1.0 + sharp.mean) * nominal_mm,
                  std::sqrt(sharp.variance) * nominal_mm};
}

}  // namespace

std::optional<OtherDie> TryNominalDie(const hal::BendProgram& nominal,
                                      std::span<const PointBlock> blocks,
                                      const SurfaceFitOptions& options, std::vector<Doubt>& doubts,
                                      BowedSolution& solution) {
  const SurfaceFit& fit = solution.fit;
  const std::size_t bends = fit.tube.program.bend_count();
  const bool is_sharp = fit.easing.empty();
  if (bends == 0) return std::nullopt;
  const auto nominal_mm = NominalRadiusMm(nominal, fit);
  if (!nominal_mm || !(is_sharp || IsVague(fit, *nominal_mm))) return std::nullopt;
  const auto easing_mm2 = EasingMm2(fit, *nominal_mm);
  if (!easing_mm2) return std::nullopt;
  const auto start = WithBendRadii(fit.tube, *nominal_mm);
  if (!start) return std::nullopt;
  SurfaceFitOptions of_die = options;
  of_die.priors.radii_alike = 0;
  of_die.priors.bend_radius = UsualBendRadius{*nominal_mm, kNominalDie.springback * *nominal_mm};
  of_die.easing = fit.easing;
  of_die.easing.variance_mm2.assign(bends, *easing_mm2);
  BowedSolution eased = SolveWithBows(*start, blocks, of_die);
  if (eased.fit.tube.program.bend_count() != bends || eased.fit.easing.empty()) return std::nullopt;
  const OffNominal found = OffNominalOf(fit, *nominal_mm);
  const double of_samples = AdvantageOf(eased, solution, blocks, options.reach_mm) -
                            (is_sharp ? kNominalDie.easing_price : 0.0);
  // What eases anyway is only the more certain by the nominal's radius, if it is of that die.
  const double better =
      is_sharp ? of_samples + Against(found) - Against(OffNominalOf(eased.fit, *nominal_mm))
               : kNominalDie.another_die - found.Wider();
  const double of_eased = 1.0 / (1.0 + std::exp(-0.5 * better));
  if (better > 0) std::swap(eased, solution);
  if (!eased.bows.is_lost) {
    doubts.push_back({std::move(eased.fit), std::min(of_eased, 1.0 - of_eased)});
  }
  const bool samples_tell = better < 0 || of_samples > kNominalDie.decisive;
  return samples_tell ? std::nullopt : MayBeOf(found, *nominal_mm);
}

}  // namespace bendloop::pipeline
