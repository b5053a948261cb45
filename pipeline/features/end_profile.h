// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

#include "pipeline/fit/end_forms.h"
#include "pipeline/fit/surface_points.h"
#include "pipeline/tube/measurement.h"

namespace bendloop::pipeline {

// The radius all round an end, place by place, where a bead, a flare or a fitting makes it wider
// than the pipe, and where that begins: where the line through its flank meets the plain tube. Sets
// the profile of `form`, whose length beyond the plain end is known; leaves it empty where nothing
// is wider. `end_sigma_mm`: 1 sigma of the end of all.
void MeasureEndProfile(const PlainEnd& end, double pipe_radius_mm, double noise_mm,
                       double end_sigma_mm, std::span<const PointBlock> near, EndForm& form);

}  // namespace bendloop::pipeline
