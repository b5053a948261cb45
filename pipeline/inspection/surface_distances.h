// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "hal/bend_program.h"
#include "hal/pose.h"
#include "pipeline/tube/measurement.h"
#include "pipeline/tube/tolerance.h"

namespace bendloop::pipeline {

// Signed distances (outside positive) of the scanned samples from the nominal's surface after
// alignment. The tube's ends are open: beyond them the pipe goes on for a pipe radius, further out
// a sample's distance grows.
struct SurfaceDistances {
  std::vector<double> distance_mm;  // one for each of Measurement::surface
  double max_abs_mm = 0;
  double p99_abs_mm = 0;  // judged: one sample in a hundred may be a flier
  double p95_abs_mm = 0;
  double rms_mm = 0;
  std::optional<double> tolerance_mm;
  ToleranceState state = ToleranceState::kNotJudged;
};

// `end_excess_mm`: how much longer than the nominal the measured end straights are at most; end
// lengths are judged as lengths and not again here. `noise_mm` widens the undecided band.
SurfaceDistances DistancesFromSurface(std::span<const SurfaceSample> samples_W,
                                      const hal::BendProgram& nominal, double pipe_radius_mm,
                                      const hal::Pose& X_NW, double end_excess_mm, double noise_mm,
                                      std::optional<double> tolerance_mm, double decision_sigmas);

}  // namespace bendloop::pipeline
