// SPDX-License-Identifier: Apache-2.0
#include "pipeline/structure/nominal_radii.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

#include "hal/angles.h"
#include "pipeline/fit/tube_parameters.h"
#include "pipeline/fit/usual_bend_radius.h"
#include "pipeline/inspection/direction.h"
#include "pipeline/math/quantiles.h"
#include "pipeline/structure/nominal_along.h"
#include "pipeline/tube/representations.h"

namespace bendloop::pipeline {
namespace {

struct NominalRadiiSettings {
  // [of the prior's variance] Radii with less are known by the samples.
  double known = 0.5;
  // [sigma] Of one die.
  double same = 3.0;
  // [variances] By which samples contradict another radius.
  double contradicted = 9.0;
};
constexpr NominalRadiiSettings kNominalRadii;

// The fit with this bend's radius by so much greater, and as sure as `sigma_mm`; its corner stays.
void MoveRadius(const TubeParameters& parameters, std::size_t bend, double by_mm, double sigma_mm,
                SurfaceFit& fit, Eigen::MatrixXd& covariance) {
  auto& rows = fit.tube.program.rows;
  const double tangent = std::tan(0.5 * rows[bend].angle_deg * hal::kRadiansPerDegree);
  *rows[bend].bend_radius_mm += by_mm;
  rows[bend].length_mm = std::max(0.0, rows[bend].length_mm - tangent * by_mm);
  rows[bend + 1].length_mm = std::max(0.0, rows[bend + 1].length_mm - tangent * by_mm);
  Eigen::VectorXd moves = Eigen::VectorXd::Zero(parameters.size());
  const int radius = parameters.bend_radius(bend);
  moves[radius] = 1.0;
  moves[parameters.length(bend)] = -tangent;
  if (bend + 1 < parameters.bends()) moves[parameters.length(bend + 1)] = -tangent;
  const double missing_mm2 = sigma_mm * sigma_mm - covariance(radius, radius);
  if (missing_mm2 > 0) covariance += missing_mm2 * moves * moves.transpose();
}

}  // namespace

NominalRadii NominalRadiiOf(const hal::BendProgram& nominal) {
  NominalRadii radii;
  for (const hal::BendRow& row : nominal.rows) {
    if (!row.bend_radius_mm) continue;
    radii.least_mm =
        radii.most_mm > 0 ? std::min(radii.least_mm, *row.bend_radius_mm) : *row.bend_radius_mm;
    radii.most_mm = std::max(radii.most_mm, *row.bend_radius_mm);
  }
  return radii;
}

void TakeNominalRadii(const hal::BendProgram& nominal, bool free_pipe_radius, SurfaceFit& fit) {
  const auto usual = ExpectedRadius(fit);
  if (!usual || NominalRadiiOf(nominal).AreOfOneDie() ||
      !MayBeByCorners(nominal, fit.tube, fit.sigma))
    return;
  const bool is_reversed = MatchDirection(nominal, fit.tube.program, fit.sigma, {}).reversed;
  const hal::BendProgram wanted = is_reversed ? ReverseProgram(nominal) : nominal;
  const TubeParameters parameters(fit.tube, free_pipe_radius, fit.flattening, fit.easing);
  const double prior_mm2 = usual->sigma_mm * usual->sigma_mm;
  const auto variance_mm2 = [&](std::size_t bend) {
    const int i = parameters.bend_radius(bend);
    return fit.covariance(i, i);
  };
  const auto is_known = [&](std::size_t bend) {
    return variance_mm2(bend) < kNominalRadii.known * prior_mm2;
  };
  std::vector<double> of_die;  // the found radius over the nominal's
  for (std::size_t i = 0; i < parameters.bends(); ++i) {
    const auto &found = fit.tube.program.rows[i].bend_radius_mm,
               &told = wanted.rows[i].bend_radius_mm;
    if (is_known(i) && found && told && *told > 0) of_die.push_back(*found / *told);
  }
  const double over_nominal = of_die.empty() ? 1.0 : Median(std::move(of_die));
  Eigen::MatrixXd covariance = fit.covariance;
  for (std::size_t i = 0; i < parameters.bends(); ++i) {
    const auto& told = wanted.rows[i].bend_radius_mm;
    if (is_known(i) || !told) continue;
    const double to_mm = over_nominal * *told;
    const double by_mm = to_mm - fit.tube.program.rows[i].bend_radius_mm.value_or(to_mm);
    if (std::abs(by_mm) < kNominalRadii.same * usual->sigma_mm) continue;
    const double of_samples = std::max(0.0, 1.0 / variance_mm2(i) - 1.0 / prior_mm2);
    if (of_samples * by_mm * by_mm > kNominalRadii.contradicted) continue;
    MoveRadius(parameters, i, by_mm, usual->sigma_mm / usual->mean_mm * to_mm, fit, covariance);
  }
  SetCovariance(std::move(covariance), free_pipe_radius, fit);
}

}  // namespace bendloop::pipeline
