// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

#include "hal/pose.h"
#include "hal/tube.h"

namespace bendloop::pipeline {

// A rigid motion that brings measured points onto nominal ones. Frame N is the nominal's own tube
// frame: its first straight along +x from the origin, its first bend in the xy plane.
struct Alignment {
  hal::Pose X_NW;
  double rms_mm = 0;  // weighted, of the corresponding points
  double max_mm = 0;
};

// Least squares over pairs of points with weights >= 0 (Umeyama 1991, without scale).
Alignment BestFit(std::span<const Eigen::Vector3d> measured_W,
                  std::span<const Eigen::Vector3d> nominal_N, std::span<const double> weights);

// Best fit of two tubes with the same number of rows, in the same order: corresponding points along
// every straight and arc, weighted by the length that they stand for. The end straights correspond
// from their tangent points outwards, so that a tube cut too long is not pushed off its place.
Alignment AlignTubes(const hal::BendProgram& nominal, const hal::Tube& measured);

// Start, both tangent points of every bend, end: 2 n + 2 points for n bends.
std::vector<Eigen::Vector3d> Knots(const hal::BendProgram& program, const hal::Pose& X_WT);

}  // namespace bendloop::pipeline
