// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include "firmware-host/cad/tube_piece.h"

namespace bendloop::host {

// How far the tube goes on beyond its straight `piece`, along `outward` from `origin`: faces that
// join its edge at `at_mm` and theirs in turn, as of a chamfer, a flare, a swage or a cap, while
// they keep near to the axis. `at_mm` where nothing goes on.
double FormEndMm(const CadBody& body, const TubePiece& piece, const Eigen::Vector3d& origin,
                 const Eigen::Vector3d& outward, double at_mm);

}  // namespace bendloop::host
