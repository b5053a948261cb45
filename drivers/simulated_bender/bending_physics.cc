// SPDX-License-Identifier: Apache-2.0
#include "drivers/simulated_bender/bending_physics.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>
#include <string>

namespace bendloop::drivers {
namespace {

constexpr double kLowDeg = 20;
constexpr double kHighDeg = 120;

// SplitMix64 with Box-Muller: the standard library's distributions differ between vendors, and a
// recorded part must come out again on any machine.
class Scatter {
 public:
  Scatter(std::uint64_t seed, std::uint32_t serial)
      : state_(seed * 0x9E3779B97F4A7C15u + serial * 0xD1B54A32D192ED03u) {}

  double Normal(double sigma) {
    const double u = (static_cast<double>(Next() >> 11) + 0.5) * 0x1.0p-53;
    const double v = static_cast<double>(Next() >> 11) * 0x1.0p-53;
    return sigma * std::sqrt(-2 * std::log(u)) * std::cos(2 * std::numbers::pi * v);
  }

 private:
  std::uint64_t Next() {
    std::uint64_t z = state_ += 0x9E3779B97F4A7C15u;
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9u;
    z = (z ^ (z >> 27)) * 0x94D049BB133111EBu;
    return z ^ (z >> 31);
  }
  std::uint64_t state_;
};

}  // namespace

hal::Result<void> CheckBendingPhysics(const BendingPhysics& physics) {
  // Named as on the command lines that set them.
  struct Limit {
    const char* option;
    double value, low, high;
  };
  const Limit limits[] = {{"--springback-20", physics.springback_20_deg, -20, 20},
                          {"--springback-120", physics.springback_120_deg, -60, 60},
                          {"--elongation", physics.elongation_percent, -50, 50},
                          {"--twist", physics.twist_deg, -90, 90},
                          {"--spring-out", physics.radius_spring_out, -0.5, 0.5},
                          {"--scatter-angle", physics.sigma_angle_deg, 0, 10},
                          {"--scatter-rotation", physics.sigma_rotation_deg, 0, 10},
                          {"--scatter-length", physics.sigma_length_mm, 0, 50},
                          {"--bend-radius", physics.default_bend_radius_mm, 0, 1e5}};
  for (const Limit& limit : limits) {
    if (limit.value >= limit.low && limit.value <= limit.high) continue;
    char found[96];
    std::snprintf(found, sizeof found, ": found %.10g, expected %.10g to %.10g", limit.value,
                  limit.low, limit.high);
    return hal::Fail(hal::ErrorKind::kBadInput, std::string(limit.option) + found);
  }
  return {};
}

double SpringbackDeg(const BendingPhysics& physics, double angle_deg) {
  if (angle_deg == 0) return 0;
  const double slope =
      (physics.springback_120_deg - physics.springback_20_deg) / (kHighDeg - kLowDeg);
  return physics.springback_20_deg + slope * (angle_deg - kLowDeg);
}

hal::BendProgram BendTube(const hal::BendProgram& program, const BendingPhysics& physics,
                          std::uint32_t serial) {
  Scatter scatter(physics.seed, serial);
  hal::BendProgram tube = program;
  bool first_bend = true;
  for (std::size_t i = 0; i < tube.rows.size(); ++i) {
    hal::BendRow& row = tube.rows[i];
    const double length_error_mm = scatter.Normal(physics.sigma_length_mm);
    const double rotation_error_deg = scatter.Normal(physics.sigma_rotation_deg);
    const double angle_error_deg = scatter.Normal(physics.sigma_angle_deg);
    row.length_mm += length_error_mm;
    if (row.angle_deg == 0) {
      row.bend_radius_mm.reset();
      continue;
    }
    if (!first_bend) {
      row.rotation_deg =
          hal::WrapRotationDeg(row.rotation_deg + physics.twist_deg + rotation_error_deg);
    }
    first_bend = false;
    row.angle_deg =
        std::max(0.0, row.angle_deg - SpringbackDeg(physics, row.angle_deg) + angle_error_deg);
    const double tool_mm = row.bend_radius_mm.value_or(physics.default_bend_radius_mm);
    row.bend_radius_mm = tool_mm * (1 + physics.radius_spring_out);
    const double arc_mm = *row.bend_radius_mm * row.angle_deg * std::numbers::pi / 180;
    const double stretch_mm = arc_mm * physics.elongation_percent / 100;
    row.length_mm += stretch_mm / 2;
    if (i + 1 < tube.rows.size()) tube.rows[i + 1].length_mm += stretch_mm / 2;
  }
  for (hal::BendRow& row : tube.rows) row.length_mm = std::max(0.0, row.length_mm);
  return tube;
}

}  // namespace bendloop::drivers
