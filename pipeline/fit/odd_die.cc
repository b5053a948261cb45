// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/odd_die.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>
#include <optional>
#include <utility>

#include "pipeline/fit/one_die.h"
#include "pipeline/fit/tube_parameters.h"
#include "pipeline/fit/usual_bend_radius.h"

namespace bendloop::pipeline {
namespace {

struct OddDieSettings {
  // [of what is expected, its variance] Radii of less are known by the samples.
  double known = 0.5;
  // [variances] By which samples speak against the usual radius at least.
  double pulls = 2.0;
  // [of the usual radius] How far off the fit starts. [sigma] No other radius that is as near.
  double least = 0.6, most = 2.0, same = 4.0;
  // [of how far it eases] Room beside a bend: with less the radius takes what easing has none for.
  double room = 3.0;
  // One bend in so many is of another die, of any radius up to so many times the usual one.
  double one_in = 10.0, widest = 2.0;
};
constexpr OddDieSettings kOddDie;

// How far a bend's radius is from what is expected of it, with the variance that is expected and
// the one that is left.
struct Apart {
  double off_mm = 0, expected_mm2 = 0, left_mm2 = 0;
};
Apart ApartOf(const SurfaceFit& fit, const UsualBendRadius& usual, const TubeParameters& parameters,
              std::size_t bend) {
  const double radius_mm = fit.tube.program.rows[bend].bend_radius_mm.value_or(0.0);
  const double usual_mm2 = usual.sigma_mm * usual.sigma_mm;
  Eigen::VectorXd apart = Eigen::VectorXd::Zero(fit.covariance.rows());
  apart[parameters.bend_radius(bend)] = 1.0;
  if (fit.priors.bend_radius) {
    return {radius_mm - usual.mean_mm, usual_mm2, apart.dot(fit.covariance * apart)};
  }
  // From the mean of the others.
  double others = 0, sum_mm = 0;
  for (std::size_t i = 0; i < parameters.bends(); ++i) {
    if (i == bend || fit.priors.IsOdd(i)) continue;
    others += 1;
    sum_mm += fit.tube.program.rows[i].bend_radius_mm.value_or(0.0);
  }
  if (others < 1) return {};
  for (std::size_t i = 0; i < parameters.bends(); ++i) {
    if (i != bend && !fit.priors.IsOdd(i)) apart[parameters.bend_radius(i)] = -1.0 / others;
  }
  return {radius_mm - sum_mm / others, usual_mm2 * (1.0 + 1.0 / others),
          apart.dot(fit.covariance * apart)};
}

// The same of how it eases, by what is expected: no more is asked of it.
double EasingApart(const SurfaceFit& fit, std::size_t bend, double& others_mm2) {
  const auto& variance_mm2 = fit.easing.variance_mm2;
  const auto others = static_cast<double>(variance_mm2.size()) - 1.0;
  if (others < 1) return 0.0;
  const double sum = std::accumulate(variance_mm2.begin(), variance_mm2.end(), 0.0);
  others_mm2 = (sum - variance_mm2[bend]) / others;
  const double expected = fit.priors.easings_alike * others_mm2 * std::sqrt(1.0 + 1.0 / others);
  return (variance_mm2[bend] - others_mm2) / expected;
}

bool HasRoom(const SurfaceFit& fit, std::size_t bend) {
  if (fit.easing.empty()) return true;
  const double eased_mm = std::sqrt(fit.easing.variance_mm2[bend]);
  return EasingWithin(fit.tube.program, fit.easing).room_mm[bend] > kOddDie.room * eased_mm;
}

// The radius that the samples of a bend ask for. None: they know it, or do not mind the usual one.
std::optional<double> AskedForMm(const SurfaceFit& fit, const UsualBendRadius& usual,
                                 const TubeParameters& parameters, std::size_t bend) {
  if (fit.covariance.rows() != parameters.size() || !HasRoom(fit, bend)) return std::nullopt;
  const Apart apart = ApartOf(fit, usual, parameters, bend);
  if (!(apart.left_mm2 > kOddDie.known * apart.expected_mm2)) return std::nullopt;
  const hal::BendRow& row = fit.tube.program.rows[bend];
  const double radius_mm = row.bend_radius_mm.value_or(0.0);
  const auto within = [&](double asked_mm) {
    return std::clamp(asked_mm, kOddDie.least * usual.mean_mm, kOddDie.most * usual.mean_mm);
  };
  // Where the samples' slope and the prior's are each other's opposite.
  const double of_samples = 1.0 / apart.left_mm2 - 1.0 / apart.expected_mm2;
  const double pull = apart.off_mm / apart.expected_mm2;
  double others_mm2 = 0;
  const double eased_apart = EasingApart(fit, bend, others_mm2);
  if (of_samples > 0 && pull * pull > kOddDie.pulls * of_samples) {
    return within(radius_mm + pull / of_samples);
  }
  // The samples know how long arc and easing are together: what is of neither's length is of both.
  if (eased_apart * eased_apart > kOddDie.pulls) {
    const double square = VarianceOfArc(row);
    const double arc_mm2 =
        square * radius_mm * radius_mm + fit.easing.variance_mm2[bend] - others_mm2;
    return within(std::sqrt(std::max(0.0, arc_mm2) / square));
  }
  return std::nullopt;
}

// [twice the logarithm of the odds] That a bend is of another die, which its samples alone tell so.
double OddsOfOdd(const hal::BendRow& found, const hal::BendRow& sigma,
                 const UsualBendRadius& usual) {
  const double sigma_mm = sigma.bend_radius_mm.value_or(0.0);
  const double off_mm = found.bend_radius_mm.value_or(0.0) - usual.mean_mm;
  // Of any radius they leave so much (MacKay, Bayesian interpolation, 1992: the Occam factor).
  const double left =
      std::sqrt(2.0 * std::numbers::pi) * sigma_mm / (kOddDie.widest * usual.mean_mm);
  const double likelier = off_mm * off_mm / (sigma_mm * sigma_mm + usual.sigma_mm * usual.sigma_mm);
  return likelier + 2.0 * std::log(std::min(1.0, left) / (kOddDie.one_in - 1.0));
}

// `asked_mm`: where the fit starts.
std::optional<Doubt> TryOdd(std::size_t bend, double asked_mm, const UsualBendRadius& usual,
                            std::span<const PointBlock> blocks, const SurfaceFitOptions& options,
                            BowedSolution& solution) {
  const auto start = WithBendRadii(solution.straight, asked_mm, bend);
  if (!start) return std::nullopt;
  SurfaceFitOptions from_there = options;
  from_there.priors = solution.fit.priors;
  from_there.priors.odd_bends.push_back(bend);
  from_there.easing = solution.fit.easing;
  BowedSolution odd = SolveWithBows(*start, blocks, from_there);
  if (!IsOfSameBends(odd, solution)) return std::nullopt;
  const auto& rows = odd.fit.tube.program.rows;
  const double off_mm = rows[bend].bend_radius_mm.value_or(0.0) - usual.mean_mm;
  if (std::abs(off_mm) < kOddDie.same * usual.sigma_mm) return std::nullopt;
  const double better = OddsOfOdd(rows[bend], odd.fit.sigma.rows[bend], usual);
  const double of_odd = 1.0 / (1.0 + std::exp(-0.5 * better));
  if (better > 0) std::swap(odd, solution);
  return Doubt{std::move(odd.fit), std::min(of_odd, 1.0 - of_odd)};
}

}  // namespace

void TryOddDie(std::span<const PointBlock> blocks, const SurfaceFitOptions& options,
               std::vector<Doubt>& doubts, BowedSolution& solution) {
  for (std::size_t bend = 0; bend < solution.fit.tube.program.bend_count(); ++bend) {
    const SurfaceFit& fit = solution.fit;
    const auto usual = ExpectedRadius(fit);
    if (!usual) return;
    if (fit.priors.IsOdd(bend)) continue;
    const TubeParameters parameters(fit.tube, options.free_pipe_radius, fit.flattening, fit.easing);
    const auto asked_mm = AskedForMm(fit, *usual, parameters, bend);
    if (!asked_mm) continue;
    if (auto doubt = TryOdd(bend, *asked_mm, *usual, blocks, options, solution)) {
      doubts.push_back(std::move(*doubt));
    }
  }
}

}  // namespace bendloop::pipeline
