// SPDX-License-Identifier: Apache-2.0
#include "pipeline/structure/structure_criterion.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "pipeline/fit/surface_sums.h"

namespace bendloop::pipeline {
namespace {

// A bend of which the samples know nothing costs so much, and any other that much more.
constexpr double kBendPrice = 1;  // in parameters
// Two straights joined by less than this are one, unless the samples insist.
constexpr double kSlightDeg = 1.0;
constexpr double kSlightPrice = 2;  // in parameters, above those of the bend
// So are two bends that could be one, or one that the next undoes.
constexpr double kTwinDeg = 3.0;       // rotation between them
constexpr double kTwinUnsure = 1.0;    // sigma of it
constexpr double kTwinStraight = 0.1;  // of r_P, between them
constexpr double kTwinUnclear = 5.0;   // sigma, of an angle
constexpr double kTwinPrice = 4;       // in parameters
constexpr double kTruncated = 6.0;     // sigma
constexpr double kInsist = 6.0;        // sigma, for flattened bends
constexpr double kLost = 0.6;          // of the samples that the other reaches
constexpr double kFar = std::numeric_limits<double>::infinity();

double Cost(const SurfaceFit& fit, double limit_mm) {
  double cost = static_cast<double>(fit.points - fit.distances_mm.size()) * limit_mm * limit_mm;
  for (const double d : fit.distances_mm) cost += std::min(d * d, limit_mm * limit_mm);
  return cost;
}

// A bend and the one before it.
bool AreOne(const SurfaceFit& fit, std::size_t bend) {
  const hal::BendRow& row = fit.tube.program.rows[bend];
  if (row.length_mm > kTwinStraight * fit.tube.pipe_radius_mm) return false;
  const double unclear_deg = kTwinUnsure * fit.sigma.rows[bend].rotation_deg;
  const double turned_deg = std::max(0.0, std::abs(row.rotation_deg) - unclear_deg);
  const auto unclear = [&fit](std::size_t i) {
    return fit.tube.program.rows[i].angle_deg < kTwinUnclear * fit.sigma.rows[i].angle_deg;
  };
  return turned_deg < kTwinDeg ||
         (turned_deg > 180.0 - kTwinDeg && (unclear(bend) || unclear(bend - 1)));
}

}  // namespace

StructureCriterion::StructureCriterion(std::size_t samples, double caution)
    : caution_(caution), price_(caution * std::log(static_cast<double>(samples))) {}

double StructureCriterion::Variance(const SurfaceFit& fit) { return fit.variance_mm2; }

double StructureCriterion::LimitMm(const SurfaceFit& fit) {
  return kTruncated * std::hypot(fit.sigma_mm, fit.form_mm);
}

double StructureCriterion::Gain(const SurfaceFit& a, const SurfaceFit& b) const {
  // One that lost the tube has next to no distances, and a small sigma of these.
  const auto reached_a = static_cast<double>(a.distances_mm.size());
  const auto reached_b = static_cast<double>(b.distances_mm.size());
  if (reached_a < kLost * reached_b) return -kFar;
  if (reached_b < kLost * reached_a) return kFar;
  const double variance = std::min(Variance(a), Variance(b));
  const double limit_mm = std::min(LimitMm(a), LimitMm(b));
  const auto chi_square = [&](const SurfaceFit& fit) {
    return Cost(fit, limit_mm) / variance + fit.priors.ChiSquare(fit.tube.program, fit.flattening);
  };
  return chi_square(b) - chi_square(a);
}

bool StructureCriterion::IsFlattened(const SurfaceFit& round, const SurfaceFit& flattened) const {
  const auto bends = static_cast<double>(flattened.tube.program.bend_count());
  const double freedom = kFlatteningParameters * bends;
  const double more = bends - static_cast<double>(round.tube.program.bend_count());
  const double price = 4.0 * std::max(0.0, more) * price_;
  const double limit_mm = kTruncated * flattened.sigma_mm;
  const double variance_mm2 = flattened.sigma_mm * flattened.sigma_mm * flattened.design_effect;
  return Cost(round, limit_mm) - Cost(flattened, limit_mm) >
         variance_mm2 * (price + freedom + kInsist * std::sqrt(2.0 * freedom));
}

double StructureCriterion::PriceOf(const SurfaceFit& fit) const {
  double price = caution_ * fit.learnt +
                 kBendPrice * price_ * static_cast<double>(fit.tube.program.bend_count());
  for (std::size_t i = 0; i < fit.tube.program.bend_count(); ++i) {
    if (fit.tube.program.rows[i].angle_deg < kSlightDeg) price += kSlightPrice * price_;
    if (i > 0 && AreOne(fit, i)) price += kTwinPrice * price_;
  }
  return price;
}

}  // namespace bendloop::pipeline
