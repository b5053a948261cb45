// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

#include "hal/bend_program.h"
#include "pipeline/correction/material.h"
#include "tests/support/synthetic_tube.h"

namespace bendloop::support {

// A bender written down once more, apart from the product's own model: springback a + b x angle,
// stretch of the arc into both neighbours, a constant error of each axis (tool, slip, twist) and
// scatter from part to part.
class TestBender {
 public:
  double springback_deg = 0.5;
  double springback_part = 0.03;
  double elongation_part = 0.02;
  double sigma_length_mm = 0.05;
  double sigma_rotation_deg = 0.1;
  double sigma_angle_deg = 0.1;

  // Constant errors, up to the given sizes, for a tube of `rows` rows.
  void Detune(Rng& rng, std::size_t rows, double length_mm, double rotation_deg, double angle_deg) {
    errors_.clear();
    for (std::size_t i = 0; i < rows; ++i) {
      errors_.push_back({Uniform(rng, -length_mm, length_mm),
                         Uniform(rng, -rotation_deg, rotation_deg),
                         Uniform(rng, -angle_deg, angle_deg), std::nullopt});
    }
  }

  hal::BendProgram Bend(const hal::BendProgram& program, Rng& rng) const {
    hal::BendProgram tube = program;
    const std::size_t bends = program.bend_count();
    for (std::size_t i = 0; i <= bends; ++i) {
      const hal::BendRow error = i < errors_.size() ? errors_[i] : hal::BendRow{};
      hal::BendRow& row = tube.rows[i];
      row.length_mm += error.length_mm + Gauss(rng, sigma_length_mm);
      if (i == bends) break;
      row.angle_deg -= springback_deg + springback_part * row.angle_deg;
      row.angle_deg += error.angle_deg + Gauss(rng, sigma_angle_deg);
      if (i > 0) row.rotation_deg += error.rotation_deg + Gauss(rng, sigma_rotation_deg);
      row.rotation_deg = i > 0 ? hal::WrapRotationDeg(row.rotation_deg) : 0.0;
    }
    for (std::size_t i = 0; i < bends; ++i) {
      const double arc_mm =
          *tube.rows[i].bend_radius_mm * tube.rows[i].angle_deg * std::numbers::pi / 180;
      tube.rows[i].length_mm += 0.5 * elongation_part * arc_mm;
      tube.rows[i + 1].length_mm += 0.5 * elongation_part * arc_mm;
    }
    for (hal::BendRow& row : tube.rows) row.length_mm = std::max(0.0, row.length_mm);
    return tube;
  }

 private:
  std::vector<hal::BendRow> errors_;
};

// What a scanner with these sigma says of `tube`.
inline hal::BendProgram Noisy(hal::BendProgram tube, const hal::BendProgram& sigma, Rng& rng) {
  const std::size_t bends = tube.bend_count();
  for (std::size_t i = 0; i <= bends; ++i) {
    tube.rows[i].length_mm += Gauss(rng, sigma.rows[i].length_mm);
    if (i == bends) break;
    tube.rows[i].angle_deg += Gauss(rng, sigma.rows[i].angle_deg);
    if (i > 0) {
      tube.rows[i].rotation_deg =
          hal::WrapRotationDeg(tube.rows[i].rotation_deg + Gauss(rng, sigma.rows[i].rotation_deg));
    }
  }
  return tube;
}

}  // namespace bendloop::support
