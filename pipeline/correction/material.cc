// SPDX-License-Identifier: Apache-2.0
#include "pipeline/correction/material.h"

#include <algorithm>
#include <cmath>

#include "hal/angles.h"
#include "pipeline/math/text.h"
#include "pipeline/tube/row_names.h"

namespace bendloop::pipeline {
namespace {

// Stretch that the finished bends on both sides of straight `row` add to it.
double StretchAround(const std::vector<hal::BendRow>& finished, std::size_t row,
                     const Material& material) {
  double stretch_mm = 0;
  const auto add = [&](const hal::BendRow& bend) {
    stretch_mm += material.StretchOfStraightMm(bend.bend_radius_mm.value_or(0.0), bend.angle_deg);
  };
  if (row > 0) add(finished[row - 1]);
  if (row + 1 < finished.size()) add(finished[row]);
  return stretch_mm;
}

}  // namespace

double Material::SpringbackDeg(double commanded_deg) const {
  if (commanded_deg <= 0) return 0;
  return springback_at_20_deg +
         (springback_at_120_deg - springback_at_20_deg) * (commanded_deg - 20.0) / 100.0;
}

double Material::AngleAfterDeg(double commanded_deg) const {
  return commanded_deg - SpringbackDeg(commanded_deg);
}

double Material::AngleToCommandDeg(double wanted_deg) const {
  // Springback is not defined for no bend at all.
  if (wanted_deg <= 0) return wanted_deg;
  return 20.0 + (wanted_deg - 20.0 + springback_at_20_deg) / AngleSlope();
}

double Material::StretchOfStraightMm(double bend_radius_mm, double angle_after_deg) const {
  return 0.5 * 0.01 * elongation_percent * bend_radius_mm * angle_after_deg *
         hal::kRadiansPerDegree;
}

hal::Result<void> Check(const Material& material) {
  const auto bad = [](const std::string& message) {
    return hal::Fail(hal::ErrorKind::kBadInput, "material: " + message);
  };
  for (const double springback_deg :
       {material.springback_at_20_deg, material.springback_at_120_deg}) {
    if (!(std::abs(springback_deg) <= 45.0)) {
      return bad("springback of " + Fixed(springback_deg, 2) +
                 " degrees; expected -45 to 45 (degrees, not percent)");
    }
  }
  const double slope = material.AngleSlope();
  if (!(slope >= 0.5 && slope <= 1.5)) {
    return bad("springback of " + Fixed(material.springback_at_20_deg, 2) +
               " degrees at 20 degrees and " + Fixed(material.springback_at_120_deg, 2) +
               " at 120; expected less than 50 degrees between them");
  }
  if (!(material.elongation_percent >= -5.0 && material.elongation_percent <= 25.0)) {
    return bad("elongation of " + Fixed(material.elongation_percent, 2) +
               " %; expected -5 to 25 % of the arcs' length");
  }
  return {};
}

hal::BendProgram PredictBent(const hal::BendProgram& commanded, const Material& material) {
  hal::BendProgram bent = commanded;
  const std::size_t bends = bent.bend_count();
  for (std::size_t i = 0; i < bends; ++i) {
    bent.rows[i].angle_deg = material.AngleAfterDeg(commanded.rows[i].angle_deg);
  }
  for (std::size_t i = 0; i <= bends && !bent.rows.empty(); ++i) {
    bent.rows[i].length_mm += StretchAround(bent.rows, i, material);
  }
  return bent;
}

hal::Result<hal::BendProgram> InitialProgram(const hal::BendProgram& nominal,
                                             const Material& material) {
  if (const auto ok = Check(material); !ok) return hal::Fail(ok.error());
  hal::BendProgram program = nominal;
  const std::size_t bends = nominal.bend_count();
  for (std::size_t i = 0; i < nominal.rows.size(); ++i) {
    hal::BendRow& row = program.rows[i];
    row.length_mm = std::max(0.0, row.length_mm - StretchAround(nominal.rows, i, material));
    if (i == bends || row.angle_deg == 0) continue;
    row.angle_deg = material.AngleToCommandDeg(row.angle_deg);
    if (!(row.angle_deg > 0)) {
      return hal::Fail(hal::ErrorKind::kBadInput,
                       AngleName(i) + ": " + Fixed(nominal.rows[i].angle_deg, 2) +
                           " degrees would need a command of " + Fixed(row.angle_deg, 2) +
                           " degrees with this springback; expected more than 0, correct the "
                           "springback at 20 degrees");
    }
  }
  return program;
}

}  // namespace bendloop::pipeline
