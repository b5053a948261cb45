// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <span>

#include "hal/clock.h"
#include "hal/result.h"
#include "pipeline/reconstruction.h"
#include "pipeline/tube/measurement.h"

namespace bendloop::pipeline {

// What the points are taken to show.
enum class TubeModel {
  kAuto,      // a tube, unless the points contradict that clearly
  kTube,      // lines and arcs, one pipe radius (Bauer & Polthier 2009)
  kCanal,     // varying pipe radius (Lee & Kim 2004)
  kFreeform,  // a spine without lines and arcs: no rows
};

// Batch reconstruction under a model. kAuto leaves the tube only when
// - the pipe radius varies along the spine by more than noise and oval bends explain, and the
//   samples lie less than 0.7 times as far (rms) from the canal surface: canal;
// - a free-form spine explains the samples better with no more numbers than the lines and arcs
//   need; or the tube is arc upon arc and the better fit is worth the numbers; or it is much
//   better;
// and a warning says why.
hal::Result<Measurement> ReconstructModel(std::span<const Eigen::Vector3d> points, TubeModel model,
                                          const ReconstructionOptions& options,
                                          const hal::Clock& clock, Workers* workers = nullptr);

}  // namespace bendloop::pipeline
