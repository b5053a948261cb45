// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <span>

#include "pipeline/features/opening_border.h"

namespace bendloop::pipeline {

// How much less sure than beside as many scattered samples a border is, along its axis (its ends)
// and across (its sides): at least 1.
struct Clumping {
  double along = 1, across = 1;
};

// Samples that stand nearer to each other along a laser line than the lines do tell the same again.
// And rays of laser lines stand in columns, and lines lie unevenly: where a border lies between two
// of them all samples of a side tell the same.
Clumping ClumpingBeside(const OpeningBorder& border, std::span<const Eigen::Vector2d> samples);

}  // namespace bendloop::pipeline
