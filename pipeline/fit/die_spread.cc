// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/die_spread.h"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

#include "pipeline/fit/tube_parameters.h"
#include "pipeline/math/quantiles.h"

namespace bendloop::pipeline {
namespace {

struct DieSpreadSettings {
  // [of what is usual] As likely as each other before the points are looked at; as usual (root
  // mean square) where these tell nothing. With an eighth for the least, radii of bends that one
  // die made exactly alike are as uncertain as that where the points know three times as much.
  std::array<double, 7> spreads = {1.0 / 32, 1.0 / 16, 0.125, 0.25, 0.5, 1.0, 2.4};
  // Of what is usual for the bends: 1 sigma of how far their walls sink in; [of r_P] and at least.
  double as_sunk = 3.0, hardly_sunk = 0.005;
};
constexpr DieSpreadSettings kDieSpread;

// Of numbers that one die makes alike, how they differ from their mean. The columns of `base` are
// orthonormal, of all parameters (Helmert's contrasts).
struct Alike {
  Eigen::MatrixXd base;
  double usual;         // 1 sigma along each
  double* of_priors;    // what says so, over the mean
  double spread = 1.0;  // [of the usual one]
};

Alike AlikeOf(const std::vector<int>& numbers, const Eigen::VectorXd& x, double& of_priors) {
  const auto bends = static_cast<Eigen::Index>(numbers.size());
  Eigen::MatrixXd base = Eigen::MatrixXd::Zero(x.size(), bends - 1);
  double sum = x[numbers.front()];
  for (Eigen::Index k = 1; k < bends; ++k) {
    const auto before = static_cast<double>(k);
    const double length = std::sqrt(before * (before + 1.0));
    for (Eigen::Index i = 0; i < k; ++i) {
      base(numbers[static_cast<std::size_t>(i)], k - 1) = 1.0 / length;
    }
    const int own = numbers[static_cast<std::size_t>(k)];
    base(own, k - 1) = -before / length;
    sum += x[own];
  }
  return {std::move(base), of_priors * sum / static_cast<double>(bends), &of_priors};
}

// The numbers that `priors` expects to be alike.
std::vector<Alike> AllAlike(const TubeParameters& parameters, const Eigen::VectorXd& x,
                            FitPriors& priors) {
  std::vector<int> radii, easings;
  for (std::size_t i = 0; i < parameters.bends(); ++i) {
    if (!priors.IsOdd(i)) radii.push_back(parameters.bend_radius(i));
    if (parameters.eased()) easings.push_back(parameters.easing(i));
  }
  std::vector<Alike> alike;
  if (priors.radii_alike > 0 && radii.size() > 1)
    alike.push_back(AlikeOf(radii, x, priors.radii_alike));
  if (parameters.eased()) alike.push_back(AlikeOf(easings, x, priors.easings_alike));
  return alike;
}

// All of these differences in turn, each over what is usual of it, as the fit with the usual priors
// has them; and the root of their covariance. What else made the fit less certain than its priors
// are (dents, places that disagree) tells nothing of these: no difference is vaguer than usual.
struct Differences {
  Eigen::VectorXd apart;
  Eigen::MatrixXd root;
};

Differences DifferencesOf(const std::vector<Alike>& alike, const SurfaceFit& fit,
                          const Eigen::VectorXd& x) {
  Eigen::MatrixXd base(x.size(), 0);
  for (const Alike& one : alike) {
    Eigen::MatrixXd wider(x.size(), base.cols() + one.base.cols());
    wider << base, one.base / one.usual;
    base = std::move(wider);
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> of(base.transpose() * fit.covariance * base);
  const Eigen::VectorXd sigmas = of.eigenvalues().cwiseMax(0.0).cwiseMin(1.0).cwiseSqrt();
  return {base.transpose() * x,
          of.eigenvectors() * sigmas.asDiagonal() * of.eigenvectors().transpose()};
}

// The logarithm of what the points say for priors of these spreads in place of the usual ones: a
// normal distribution times the ratio of two priors is another one, and this is its integral.
double LogEvidence(const Differences& differences, const std::vector<Alike>& alike) {
  const Eigen::Index count = differences.apart.size();
  Eigen::VectorXd more(count);  // of the priors' inverse covariance
  double narrower = 0;
  Eigen::Index first = 0;
  for (const Alike& one : alike) {
    const Eigen::Index own = one.base.cols();
    more.segment(first, own).setConstant(1.0 / (one.spread * one.spread) - 1.0);
    narrower -= static_cast<double>(own) * std::log(one.spread);
    first += own;
  }
  const Eigen::MatrixXd with_priors = Eigen::MatrixXd::Identity(count, count) +
                                      differences.root * more.asDiagonal() * differences.root;
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> pivots(with_priors);
  // (1 + C D)^-1 = 1 - R (1 + R D R)^-1 R D, of C = R R.
  const Eigen::VectorXd pull = more.asDiagonal() * differences.apart;
  const Eigen::VectorXd felt = pivots.eigenvectors().transpose() * (differences.root * pull);
  const double moved = felt.cwiseAbs2().cwiseQuotient(pivots.eigenvalues()).sum();
  return narrower - 0.5 * pivots.eigenvalues().array().log().sum() -
         0.5 * (differences.apart.dot(pull) - moved);
}

}  // namespace

FitPriors LearnDieSpread(const SurfaceFit& fit, bool free_pipe_radius) {
  const TubeParameters parameters(fit.tube, free_pipe_radius, fit.flattening, fit.easing);
  FitPriors priors = fit.priors;
  if (parameters.bends() < 2 || fit.covariance.rows() != parameters.size() ||
      !fit.covariance.allFinite()) {
    return priors;
  }
  const Eigen::VectorXd x = parameters.Initial();
  std::vector<Alike> alike = AllAlike(parameters, x, priors);
  if (alike.empty()) return priors;
  const Differences differences = DifferencesOf(alike, fit, x);
  // Of all combinations, by their evidence.
  constexpr std::size_t kSpreads = kDieSpread.spreads.size();
  std::size_t combinations = 1;
  for (std::size_t i = 0; i < alike.size(); ++i) combinations *= kSpreads;
  std::vector<double> evidence(combinations);
  const auto choose = [&](std::size_t combination) {
    for (Alike& one : alike) {
      one.spread = kDieSpread.spreads[combination % kSpreads];
      combination /= kSpreads;
    }
  };
  for (std::size_t c = 0; c < combinations; ++c) {
    choose(c);
    evidence[c] = LogEvidence(differences, alike);
  }
  const double most = *std::max_element(evidence.begin(), evidence.end());
  double weights = 0;
  std::vector<double> squares(alike.size(), 0.0);
  for (std::size_t c = 0; c < combinations; ++c) {
    choose(c);
    const double weight = std::exp(evidence[c] - most);
    weights += weight;
    for (std::size_t i = 0; i < alike.size(); ++i) {
      squares[i] += weight * alike[i].spread * alike[i].spread;
    }
  }
  for (std::size_t i = 0; i < alike.size(); ++i) {
    *alike[i].of_priors *= std::sqrt(squares[i] / weights);
  }
  return priors;
}

double LearnSunk(const SurfaceFit& fit) {
  if (fit.flattening.size() < 2) return fit.priors.sunk;
  std::vector<double> sunk;
  for (const Flattening& of : fit.flattening) sunk.push_back(std::abs(of.collapse + of.plateau));
  return std::clamp(kDieSpread.as_sunk * Median(std::move(sunk)), kDieSpread.hardly_sunk,
                    fit.priors.sunk);
}

}  // namespace bendloop::pipeline
