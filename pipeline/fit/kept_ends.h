// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include "hal/tube.h"

namespace bendloop::pipeline {

// Where a tube ends [mm, world].
struct EndPlaces {
  Eigen::Vector3d first_mm, last_mm;
};

EndPlaces EndsOf(const hal::Tube& tube);

// Makes the end straights as long as it takes to reach these places, where they lie on their lines
// but for a pipe radius. What a fit moves is the corners, and the ends with them: that of a bend
// that hardly turns may slide along its straights by more than samples are looked for beyond an
// end.
void ReachTo(const EndPlaces& ends, hal::Tube& tube);
// The same, and no longer: where there are no samples nothing holds a bend.
void EndAt(const EndPlaces& ends, hal::Tube& tube);

}  // namespace bendloop::pipeline
