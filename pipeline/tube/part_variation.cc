// SPDX-License-Identifier: Apache-2.0
#include "pipeline/tube/part_variation.h"

#include <cmath>
#include <numbers>

namespace bendloop::pipeline {
namespace {

double ArcMm(const hal::BendRow& row) {
  return row.bend_radius_mm.value_or(0.0) * row.angle_deg * std::numbers::pi / 180.0;
}

}  // namespace

hal::BendRow ExpectedVariation(const hal::BendProgram& nominal, std::size_t row,
                               const PartVariation& part) {
  const hal::BendRow& n = nominal.rows[row];
  const double arcs_mm = (row > 0 ? ArcMm(nominal.rows[row - 1]) : 0.0) + ArcMm(n);
  hal::BendRow expected;
  expected.length_mm = std::hypot(part.length_mm, part.stretch_part * arcs_mm);
  expected.rotation_deg = part.rotation_deg;
  expected.angle_deg = std::hypot(part.angle_deg, part.springback_part * n.angle_deg);
  if (n.bend_radius_mm) {
    expected.bend_radius_mm = part.radius_part * *n.bend_radius_mm;
  }
  return expected;
}

}  // namespace bendloop::pipeline
