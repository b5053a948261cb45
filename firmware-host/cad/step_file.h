// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <string>

#include "hal/result.h"
#include "pipeline/features/rational_bezier.h"

namespace bendloop::host {

// What bendloop-cad writes of this JSON (`bendloop.cad-tube/1`, `bendloop.cad-curves/1`), at
// `step`: by way of a file beside the system's temporary ones, so that what stands there is whole
// or is not touched.
hal::Result<void> WriteStepFile(const std::string& json, const std::string& step);

// Curves as one rational cubic B-spline each, exactly what they are: knots of multiplicity 3 where
// pieces join, which have a common tangent there, or a corner.
hal::Result<void> WriteCurvesStep(std::span<const pipeline::RationalBezier* const> curves,
                                  const std::string& name, const std::string& step);

}  // namespace bendloop::host
