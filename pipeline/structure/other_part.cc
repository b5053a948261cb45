// SPDX-License-Identifier: Apache-2.0
#include "pipeline/structure/other_part.h"

#include <cmath>
#include <optional>
#include <string>

#include "pipeline/inspection/direction.h"
#include "pipeline/math/text.h"
#include "pipeline/tube/representations.h"

namespace bendloop::pipeline {
namespace {

struct OtherPartSettings {
  // [of the nominal radius] and [sigma] From which on a bend is of another die. Springback makes a
  // bend wider by what it opens it: of slighter ones [degrees] by as much as that.
  double radius = 0.15, radius_sigmas = 5.0;
  double slight_deg = 20.0;
};
constexpr OtherPartSettings kOtherPart;

// Of the bends that are certainly of another radius the one furthest off, by the measured tube's
// row. `nominal`: from the same end.
std::optional<std::size_t> OtherRadius(const hal::BendProgram& nominal, const Measurement& of) {
  std::optional<std::size_t> worst;
  double worst_part = kOtherPart.radius;
  for (std::size_t i = 0; i < nominal.bend_count(); ++i) {
    const hal::BendRow &wanted = nominal.rows[i], &found = of.tube.program.rows[i];
    const auto& sigma_mm = of.sigma.rows[i].bend_radius_mm;
    if (!wanted.bend_radius_mm || !found.bend_radius_mm || !sigma_mm) continue;
    if (found.angle_deg < kOtherPart.slight_deg) continue;
    const double off_mm = std::abs(*found.bend_radius_mm - *wanted.bend_radius_mm);
    const double part = off_mm / *wanted.bend_radius_mm;
    if (part < worst_part || off_mm < kOtherPart.radius_sigmas * *sigma_mm) continue;
    worst = i;
    worst_part = part;
  }
  return worst;
}

void SayOtherDie(const OtherDie& other, Measurement& measurement) {
  measurement.warnings.push_back("the bend radius is the nominal's, " + Fixed(other.nominal_mm, 1) +
                                 " mm: the samples do not tell it from sharp bends of " +
                                 Fixed(other.sharp_mm, 1) + " +- " +
                                 Fixed(other.sharp_sigma_mm, 1) + " mm; see which die is mounted");
}

}  // namespace

void SayOtherPart(const hal::BendProgram& nominal, const std::optional<OtherDie>& other_die,
                  Measurement& measurement) {
  if (other_die) SayOtherDie(*other_die, measurement);
  const DirectionMatch match =
      MatchDirection(nominal, measurement.tube.program, measurement.sigma, {});
  if (match.state == DirectionState::kWrongBends) return;
  if (match.state == DirectionState::kMirrored || match.state == DirectionState::kNoMatch) {
    measurement.warnings.push_back(match.message);
    return;
  }
  const hal::BendProgram wanted = match.reversed ? ReverseProgram(nominal) : nominal;
  const auto bend = OtherRadius(wanted, measurement);
  if (!bend) return;
  measurement.warnings.push_back(
      "bend " + std::to_string(*bend + 1) + " has a radius of " +
      Fixed(measurement.tube.program.rows[*bend].bend_radius_mm.value_or(0.0), 2) + " +- " +
      Fixed(measurement.sigma.rows[*bend].bend_radius_mm.value_or(0.0), 2) +
      " mm, the nominal's is " + Fixed(wanted.rows[*bend].bend_radius_mm.value_or(0.0), 2) +
      " mm: another die is mounted, or it is another part");
}

}  // namespace bendloop::pipeline
