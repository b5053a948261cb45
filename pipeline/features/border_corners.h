// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "pipeline/features/border_fit.h"

namespace bendloop::pipeline {

// Where an ordered border turns at once: indices of points, ascending. The directions of the points
// before and after a corner differ by as much the closer one looks; those of a bend, however tight,
// by half as much at half the length. What `noise_mm` (1 sigma of a point) may make of a straight
// border is none.
std::vector<std::size_t> FindCorners(const OrderedBorder& border, double noise_mm);

// 1 sigma of the points in one direction across the border, from second differences of neighbours:
// corners and bends hardly change it.
double BorderNoiseMm(const OrderedBorder& border);

}  // namespace bendloop::pipeline
