// SPDX-License-Identifier: Apache-2.0
#include "pipeline/structure/bows.h"

#include <cmath>

#include "pipeline/structure/kink_evidence.h"

namespace bendloop::pipeline {
namespace {

// By trial where nothing else is said.
struct BowSettings {
  // [degrees] Bends that may be bows: those of L / 100, the worst that are straightened, look like
  // one of less.
  double slight_deg = 5.0, wide_deg = 2.8;
  // Twice the logarithm of the odds against a bow.
  double kink_odds = 12;
  // [of r_P] A die for slight bends has less.
  double widest = 25;
  // [degrees] Beside another bend, where a straight is too short to tell, what eases looks like a
  // bend of less, on tubes that do ease: of more than this FormDeviation::across.
  double eased_deg = 1.5, eased_across = 0.002;
  // A wide bend that runs into another is how that one begins, on a bowed straight: of less than
  // so many degrees, so many times as wide, with less than so much [of r_P] between them, planes so
  // near to each other [degrees].
  double beginning_deg = 10, times_as_wide = 3, between = 0.5, planes_deg = 60;
};
constexpr BowSettings kBows;

bool IsBeginning(const SurfaceFit& fit, std::size_t bend) {
  const auto& rows = fit.tube.program.rows;
  if (rows[bend].angle_deg > kBows.beginning_deg) return false;
  // `between`: the row between it and the other bend.
  const auto runs_into = [&](std::size_t other, std::size_t between) {
    return *rows[bend].bend_radius_mm > kBows.times_as_wide * *rows[other].bend_radius_mm &&
           rows[other].angle_deg > rows[bend].angle_deg &&
           rows[between].length_mm < kBows.between * fit.tube.pipe_radius_mm &&
           std::abs(rows[between].rotation_deg) < kBows.planes_deg;
  };
  return (bend > 0 && runs_into(bend - 1, bend)) ||
         (bend + 1 < fit.tube.program.bend_count() && runs_into(bend + 1, bend + 1));
}

bool IsBow(const SurfaceFit& fit, std::size_t bend, std::span<const PointBlock> blocks,
           double reach_mm, const FormDeviation& form, double least_angle_deg) {
  const hal::BendRow& row = fit.tube.program.rows[bend];
  if (form.across > kBows.eased_across && IsBeginning(fit, bend)) return true;
  if (row.angle_deg > kBows.slight_deg) return false;
  if (row.angle_deg < least_angle_deg) return true;
  const double least_mm = *row.bend_radius_mm - fit.sigma.rows[bend].bend_radius_mm.value_or(0.0);
  const double widest_mm = kBows.widest * fit.tube.pipe_radius_mm;
  // Straights that bow beside it make a bend look wide.
  const double evidence = KinkEvidence(fit, bend, widest_mm, blocks, reach_mm, form);
  if (std::isinf(evidence)) {
    return (row.angle_deg < kBows.wide_deg && least_mm > widest_mm) ||
           (row.angle_deg < kBows.eased_deg && form.across > kBows.eased_across);
  }
  return evidence < kBows.kink_odds;
}

}  // namespace

std::optional<std::size_t> FindBow(const SurfaceFit& fit, std::span<const PointBlock> blocks,
                                   double reach_mm, const FormDeviation& form,
                                   double least_angle_deg, double beyond_deg) {
  std::optional<std::size_t> slightest;
  const auto& rows = fit.tube.program.rows;
  for (std::size_t i = 0; i < fit.tube.program.bend_count(); ++i) {
    if (rows[i].angle_deg <= beyond_deg) continue;
    if (slightest && rows[i].angle_deg >= rows[*slightest].angle_deg) continue;
    if (IsBow(fit, i, blocks, reach_mm, form, least_angle_deg)) slightest = i;
  }
  return slightest;
}

}  // namespace bendloop::pipeline
