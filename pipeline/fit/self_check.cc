// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/self_check.h"

#include <array>
#include <cmath>

#include "pipeline/math/text.h"
#include "pipeline/tube/row_names.h"

namespace bendloop::pipeline {
namespace {

struct HalvesSettings {
  // Points of a half at most: enough that noise alone hardly moves the values, and soon fitted. By
  // trial.
  std::size_t points = 5000;
  // Of Levenberg-Marquardt: the solution is near. By trial.
  int steps = 6;
};
constexpr HalvesSettings kHalves;

}  // namespace

HalvesDiffer CompareHalves(const SurfaceFit& fit, std::span<const PointBlock> blocks,
                           SurfaceFitOptions options) {
  options.flattened = !fit.flattening.empty();
  options.easing = fit.easing;
  options.max_steps = kHalves.steps;
  const std::array<OwnedBlocks, 2> points = HalvesOf(blocks, kHalves.points);
  std::array<SurfaceFit, 2> halves;
  ParallelFor(options.workers, halves.size(), [&](std::size_t i) {
    halves[i] = FitSurface(fit.tube, Gathered(points[i], 1), options);
  });
  const auto& [a, b] = halves;
  HalvesDiffer worst;
  const std::size_t bends = fit.tube.program.bend_count();
  for (std::size_t i = 0; i < bends; ++i) {
    const hal::BendRow &row_a = a.tube.program.rows[i], &row_b = b.tube.program.rows[i];
    const hal::BendRow &sigma_a = a.sigma.rows[i], &sigma_b = b.sigma.rows[i];
    const auto compare = [&](double difference, double of_a, double of_b, const std::string& name,
                             const char* unit) {
      const double sigma = std::hypot(of_a, of_b);
      if (!(sigma > 0) || std::abs(difference) <= worst.sigmas * sigma) return;
      worst = {std::abs(difference) / sigma, name + " by " + Fixed(std::abs(difference), 3) + unit};
    };
    if (i > 0) {
      compare(row_a.length_mm - row_b.length_mm, sigma_a.length_mm, sigma_b.length_mm,
              LengthName(i, bends), " mm");
      compare(hal::WrapRotationDeg(row_a.rotation_deg - row_b.rotation_deg), sigma_a.rotation_deg,
              sigma_b.rotation_deg, RotationName(i), " degrees");
    }
    compare(row_a.angle_deg - row_b.angle_deg, sigma_a.angle_deg, sigma_b.angle_deg, AngleName(i),
            " degrees");
  }
  return worst;
}

}  // namespace bendloop::pipeline
