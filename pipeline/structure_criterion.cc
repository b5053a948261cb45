// SPDX-License-Identifier: Apache-2.0
#include "pipeline/structure_criterion.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "pipeline/surface_sums.h"

namespace bendloop::pipeline {
namespace {

// The price of a parameter is this many times the criterion's log(n) variances: systematic errors
// reach further than the blocks in which they are estimated.
constexpr double kPrice = 1.2;
// Two straights joined by less than this are one, unless the samples insist.
constexpr double kSlightDeg = 1.0;
constexpr double kSlightPrice = 8;  // in parameters, above those of the bend
constexpr double kTruncated = 6.0;  // sigma
constexpr double kInsist = 6.0;     // sigma, for flattened bends
constexpr double kLost = 0.6;       // of the samples that the other reaches
constexpr double kFar = std::numeric_limits<double>::infinity();

double Cost(const SurfaceFit& fit, double limit_mm) {
  double cost = static_cast<double>(fit.points - fit.distances_mm.size()) * limit_mm * limit_mm;
  for (const double d : fit.distances_mm) cost += std::min(d * d, limit_mm * limit_mm);
  return cost;
}

}  // namespace

StructureCriterion::StructureCriterion(std::size_t samples, double caution)
    : price_(caution * kPrice * std::log(static_cast<double>(samples))) {}

double StructureCriterion::Variance(const SurfaceFit& fit) {
  return fit.sigma_mm * fit.sigma_mm * fit.design_effect;
}

double StructureCriterion::Advantage(const SurfaceFit& a, const SurfaceFit& b) const {
  // One that lost the tube has next to no distances, and a small sigma of these.
  const auto reached_a = static_cast<double>(a.distances_mm.size());
  const auto reached_b = static_cast<double>(b.distances_mm.size());
  if (reached_a < kLost * reached_b) return -kFar;
  if (reached_b < kLost * reached_a) return kFar;
  const double variance = std::min(Variance(a), Variance(b));
  const double limit_mm = kTruncated * std::min(a.sigma_mm, b.sigma_mm);
  const auto criterion = [&](const SurfaceFit& fit) {
    return Cost(fit, limit_mm) / variance + PriceOf(fit) +
           fit.priors.ChiSquare(fit.tube.program, fit.flattening);
  };
  return criterion(b) - criterion(a);
}

bool StructureCriterion::IsFlattened(const SurfaceFit& round, const SurfaceFit& flattened) const {
  const auto bends = static_cast<double>(flattened.tube.program.bend_count());
  const double freedom = kFlatteningParameters * bends;
  const double price = std::max(0.0, PriceOf(flattened) - PriceOf(round));
  const double limit_mm = kTruncated * flattened.sigma_mm;
  return Cost(round, limit_mm) - Cost(flattened, limit_mm) >
         Variance(flattened) * (price + freedom + kInsist * std::sqrt(2.0 * freedom));
}

// One that is known before costs as much as the points know it better.
double StructureCriterion::PriceOf(const SurfaceFit& fit) const {
  double price = price_ * fit.parameters;
  for (std::size_t i = 0; i < fit.tube.program.bend_count(); ++i) {
    const hal::BendRow& row = fit.tube.program.rows[i];
    if (row.angle_deg < kSlightDeg) price += kSlightPrice * price_;
    const auto& usual = fit.priors.bend_radius;
    if (!usual || RobustWeight(*row.bend_radius_mm - usual->mean_mm, usual->sigma_mm) < 0.5) {
      continue;
    }
    const double better = usual->sigma_mm / fit.sigma.rows[i].bend_radius_mm.value_or(0.0);
    price += std::clamp(2.0 * kPrice * std::log(better), 0.0, price_) - price_;
  }
  return price;
}

}  // namespace bendloop::pipeline
