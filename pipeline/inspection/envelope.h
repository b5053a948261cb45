// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "hal/tube.h"
#include "pipeline/tube/alignment.h"
#include "pipeline/tube/tolerance.h"

namespace bendloop::pipeline {

// A tube end or tangent point after alignment, in frame N.
struct EnvelopePoint {
  std::string name;  // "start", "bend 2 entry", "bend 2 exit", "end"
  Eigen::Vector3d nominal_mm = Eigen::Vector3d::Zero();
  Eigen::Vector3d measured_mm = Eigen::Vector3d::Zero();
  double distance_mm = 0;  // of the measured point from the nominal axis (end straights extended)
  double sigma_mm = 0;     // from the rows' sigma, their correlations left out
  ToleranceState state = ToleranceState::kNotJudged;
};

// The tangent-point envelope: 2 n + 2 points for n bends. `measured` has the nominal's rows, in the
// nominal's order; `alignment` is AlignTubes of both.
std::vector<EnvelopePoint> Envelope(const hal::BendProgram& nominal, const hal::Tube& measured,
                                    const hal::BendProgram& sigma, const Alignment& alignment,
                                    std::optional<double> tolerance_mm, double decision_sigmas);

}  // namespace bendloop::pipeline
