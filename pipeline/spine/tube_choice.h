// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "hal/result.h"
#include "hal/tube.h"
#include "pipeline/spine/spine_polygon.h"

namespace bendloop::pipeline {

// Which of the pieces in view is the tube: with a nominal the one of its length, else the longest;
// then what is much rougher than another is no pipe but a clamp's edges, and two that are about as
// long are an error, as is none. `polygons`: longest first; `left_out_mm` grows by the lengths of
// other pieces that are worth a word.
hal::Result<SpinePolygon> ChooseTube(std::vector<SpinePolygon> polygons, double pipe_radius_mm,
                                     const std::optional<hal::BendProgram>& nominal,
                                     std::vector<double>& left_out_mm);

// One warning for all that was left out, however many steps it took to see that it is not this
// tube.
void SayLeftOut(const std::vector<double>& lengths_mm, std::vector<std::string>& warnings);

}  // namespace bendloop::pipeline
