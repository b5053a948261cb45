// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>

#include "hal/bend_program.h"
#include "pipeline/tube/joint_uncertainty.h"

namespace bendloop::pipeline {

struct SurfaceFit;

// Strong correlations, |coefficient| >= 0.9: who knows one of the two values knows the other to
// less than half of its sigma, and the best combination of both is known more than four times
// better than the worst. At most kMostCorrelations, the strongest. `measured` and `sigma`: as they
// are reported; what they hold beyond the fit (ends) is independent of it.
inline constexpr std::size_t kMostCorrelations = 64;
JointUncertainty FindCorrelations(const SurfaceFit& fit, const hal::BendProgram& measured,
                                  const hal::BendProgram& sigma);

// The same for the tube from its other end.
JointUncertainty Reversed(JointUncertainty joint, std::size_t bends);

}  // namespace bendloop::pipeline
