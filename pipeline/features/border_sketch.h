// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "pipeline/features/border_fit.h"

namespace bendloop::pipeline {

// A first curve for a fit, from means and slopes of many points: joints in the middle of the points
// around each break, corners where the lines of both sides meet, handles a third of the length.
RationalBezier SketchBorder(const OrderedBorder& border, const std::vector<std::size_t>& breaks);

// Pieces of each stretch between corners (or ends) to begin with, by how much the border turns.
std::size_t FirstPieces(const OrderedBorder& border);

}  // namespace bendloop::pipeline
