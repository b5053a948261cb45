// SPDX-License-Identifier: Apache-2.0
#include "pipeline/structure/structure_criterion.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "pipeline/fit/surface_sums.h"

namespace bendloop::pipeline {
namespace {

// Prices above what FitPriors::OccamPenalty() says, in parameters (price()). By trial where nothing
// else is said.
struct CriterionSettings {
  // A bend of which the samples know nothing costs so much, and any other that much more.
  double bend_price = 1;
  // [degrees] Two straights joined by less are one, unless the samples insist.
  double slight_deg = 1.0, slight_price = 2;
  // So are two bends that could be one, or one that the next undoes: [degrees] the rotation between
  // them, [sigma] how unsure it may be, [of r_P] the straight between them, [sigma] an angle that
  // is not clear.
  double twin_deg = 3.0, twin_unsure = 1.0, twin_straight = 0.1, twin_unclear = 5.0;
  double twin_price = 4;
  // [sigma] What a sample costs at most: one further off is explained by neither structure.
  double truncated = 6.0;
  // [sigma] By which samples must insist on bends that are not round.
  double insist = 6.0;
  // [of the mean square by which sides of straights disagree] That no ovality of bends explains.
  double beyond_sides = 0.5;
  // Of the samples that the other structure reaches: with less this one lost the tube.
  double lost = 0.6;
};
constexpr CriterionSettings kCriterion;
constexpr double kFar = std::numeric_limits<double>::infinity();

double Cost(const SurfaceFit& fit, double limit_mm) {
  double cost = static_cast<double>(fit.points - fit.distances_mm.size()) * limit_mm * limit_mm;
  for (const double d : fit.distances_mm) cost += std::min(d * d, limit_mm * limit_mm);
  return cost;
}

// A bend and the one before it.
bool AreOne(const SurfaceFit& fit, std::size_t bend) {
  const hal::BendRow& row = fit.tube.program.rows[bend];
  if (row.length_mm > kCriterion.twin_straight * fit.tube.pipe_radius_mm) return false;
  const double unclear_deg = kCriterion.twin_unsure * fit.sigma.rows[bend].rotation_deg;
  const double turned_deg = std::max(0.0, std::abs(row.rotation_deg) - unclear_deg);
  const auto unclear = [&fit](std::size_t i) {
    return fit.tube.program.rows[i].angle_deg <
           kCriterion.twin_unclear * fit.sigma.rows[i].angle_deg;
  };
  return turned_deg < kCriterion.twin_deg ||
         (turned_deg > 180.0 - kCriterion.twin_deg && (unclear(bend) || unclear(bend - 1)));
}

}  // namespace

StructureCriterion::StructureCriterion(std::size_t samples, double caution)
    : caution_(caution), price_(caution * std::log(static_cast<double>(samples))) {}

double StructureCriterion::Variance(const SurfaceFit& fit) { return fit.variance_mm2; }

double StructureCriterion::LimitMm(const SurfaceFit& fit) {
  return kCriterion.truncated * std::hypot(fit.sigma_mm, fit.form_mm);
}

double StructureCriterion::Gain(const SurfaceFit& a, const SurfaceFit& b) const {
  // One that lost the tube has next to no distances, and a small sigma of these.
  const auto reached_a = static_cast<double>(a.distances_mm.size());
  const auto reached_b = static_cast<double>(b.distances_mm.size());
  if (reached_a < kCriterion.lost * reached_b) return -kFar;
  if (reached_b < kCriterion.lost * reached_a) return kFar;
  const double variance = std::min(Variance(a), Variance(b));
  const double limit_mm = std::min(LimitMm(a), LimitMm(b));
  const auto chi_square = [&](const SurfaceFit& fit) {
    return Cost(fit, limit_mm) / variance + fit.priors.ChiSquare(fit.tube.program, fit.flattening);
  };
  return chi_square(b) - chi_square(a);
}

bool StructureCriterion::IsFlattened(const SurfaceFit& round, const SurfaceFit& flattened) const {
  const double more = static_cast<double>(flattened.tube.program.bend_count()) -
                      static_cast<double>(round.tube.program.bend_count());
  const double price = 4.0 * std::max(0.0, more) * price_;
  const double limit_mm = kCriterion.truncated * flattened.sigma_mm;
  const double variance_mm2 = flattened.sigma_mm * flattened.sigma_mm * flattened.design_effect;
  return Cost(round, limit_mm) - Cost(flattened, limit_mm) - AsSidesMm2(flattened) >
         variance_mm2 * (price + InsistOnFlattened(flattened));
}

double StructureCriterion::InsistOnFlattened(const SurfaceFit& flattened) {
  const double freedom =
      kFlatteningParameters * static_cast<double>(flattened.tube.program.bend_count());
  return freedom + kCriterion.insist * std::sqrt(2.0 * freedom);
}

double StructureCriterion::AsSidesMm2(const SurfaceFit& flattened) {
  double on_bends = 0;
  for (std::size_t k = 1; k < flattened.segment_samples.size(); k += 2) {
    on_bends += flattened.segment_samples[k];
  }
  return kCriterion.beyond_sides * flattened.sides_mm2 * on_bends;
}

double StructureCriterion::PriceOf(const SurfaceFit& fit) const {
  double price =
      caution_ * fit.occam_penalty +
      kCriterion.bend_price * price_ * static_cast<double>(fit.tube.program.bend_count());
  for (std::size_t i = 0; i < fit.tube.program.bend_count(); ++i) {
    if (fit.tube.program.rows[i].angle_deg < kCriterion.slight_deg)
      price += kCriterion.slight_price * price_;
    if (i > 0 && AreOne(fit, i)) price += kCriterion.twin_price * price_;
  }
  return price;
}

}  // namespace bendloop::pipeline
