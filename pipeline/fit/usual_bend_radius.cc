// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/usual_bend_radius.h"

#include <cmath>
#include <vector>

namespace bendloop::pipeline {
namespace {

struct UsualBendSettings {
  // [of the radius] 1 sigma of bends of one die: springback opens them. By trial.
  double spread = 0.015;
  // [of the radius] 1 sigma of a radius that may speak for others: twice the spread.
  double known = 0.03;
  // [of r_P] Tighter bends stand where the fit holds them (FitBounds) and say nothing.
  double tightest = 1.05;
  // [sigma] Radii of one die differ by less: 1 % of them by more.
  double same = 2.5;
  // [sigma] From the usual one and still to be tried with it.
  double may = 4.0;
  // Of the known ones so many agree; of two dies neither is usual. By trial.
  double most = 0.7;
};
constexpr UsualBendSettings kUsual;

}  // namespace

std::optional<UsualBendRadius> FindUsualBendRadius(const SurfaceFit& fit) {
  struct Known {
    double radius_mm, sigma_mm;
  };
  std::vector<Known> known;
  const hal::BendProgram& program = fit.tube.program;
  for (std::size_t i = 0; i < program.bend_count(); ++i) {
    const double radius_mm = *program.rows[i].bend_radius_mm;
    const double sigma_mm = fit.sigma.rows[i].bend_radius_mm.value_or(0.0);
    const bool held = radius_mm < kUsual.tightest * fit.tube.pipe_radius_mm;
    if (sigma_mm < kUsual.known * radius_mm && !held) known.push_back({radius_mm, sigma_mm});
  }
  UsualBendRadius best;
  std::size_t most = 0;
  for (const Known& one : known) {
    double weights = 0, sum = 0;
    std::size_t count = 0;
    const double usual_mm = kUsual.spread * one.radius_mm;
    for (const Known& other : known) {
      const double sigma_mm = std::hypot(usual_mm, one.sigma_mm, other.sigma_mm);
      if (std::abs(other.radius_mm - one.radius_mm) > kUsual.same * sigma_mm) continue;
      const double weight = 1.0 / (usual_mm * usual_mm + other.sigma_mm * other.sigma_mm);
      weights += weight;
      sum += weight * other.radius_mm;
      ++count;
    }
    if (count <= most) continue;
    most = count;
    best = {sum / weights, kUsual.spread * sum / weights};
  }
  const bool shared =
      most >= 2 && static_cast<double>(most) >= kUsual.most * static_cast<double>(known.size());
  if (!shared || most == program.bend_count()) return std::nullopt;
  return best;
}

std::optional<UsualBendRadius> ExpectedRadius(const SurfaceFit& fit) {
  if (fit.priors.bend_radius || !(fit.priors.radii_alike > 0)) return fit.priors.bend_radius;
  const auto mean_mm = fit.priors.MeanRadiusMm(fit.tube.program);
  if (!mean_mm) return std::nullopt;
  return UsualBendRadius{*mean_mm, fit.priors.radii_alike * *mean_mm};
}

hal::Tube WithUsualRadii(const SurfaceFit& fit, const UsualBendRadius& usual) {
  hal::Tube tube = fit.tube;
  for (std::size_t i = 0; i < tube.program.bend_count(); ++i) {
    double& radius_mm = *tube.program.rows[i].bend_radius_mm;
    const double sigma_mm =
        std::hypot(usual.sigma_mm, fit.sigma.rows[i].bend_radius_mm.value_or(0.0));
    if (std::abs(radius_mm - usual.mean_mm) < kUsual.may * sigma_mm) radius_mm = usual.mean_mm;
  }
  return tube;
}

}  // namespace bendloop::pipeline
