// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <span>

#include "hal/tube.h"
#include "pipeline/fit/tube_parameters.h"

namespace bendloop::pipeline {

// A straight's best-fit line.
struct SpineLine {
  Eigen::Vector3d point_mm, direction;
};

// Where `line` is nearest to another one, from its point along it: their corner.
double CornerAlongMm(const SpineLine& line, const SpineLine& other);

// Length, rotation and angle as the trade means them: from best-fit lines, one after another, with
// their corners (of lines that pass each other halfway) and planes, and arcs of the bend radii that
// `numbers` has, as numbers of `parameters`. Where the tube lies: its straights as near to the
// lines as can be. `reference`: of the parameters; the first length is from its start.
Eigen::VectorXd TradeNumbers(const TubeParameters& parameters, const hal::Tube& reference,
                             std::span<const SpineLine> lines, const Eigen::VectorXd& numbers);

// The tube of these numbers, each taken as it stands.
hal::Tube TradeTube(const TubeParameters& parameters, const hal::Tube& reference,
                    const Eigen::VectorXd& numbers);

// How far the ends of the tube's straights lie beside the lines, at most [mm].
double FarthestEndMm(const hal::Tube& tube, std::span<const SpineLine> lines);

}  // namespace bendloop::pipeline
