// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <span>
#include <vector>

namespace bendloop::pipeline {

// Neighbours of a point along the curve; -1: none (an end).
using CurveNeighbours = std::array<int, 2>;

// Connects points of a curve: each to its nearest neighbour and to the nearest on the other side
// (the half-neighbour, more than a right angle away from the first). Edges longer than
// `max_edge_mm` are gaps and left open. Where more than two edges meet, the shortest two stay.
// Source: Dey & Kumar 1999, NN-Crust (cited by Bauer & Polthier 2009, section 1.3).
std::vector<CurveNeighbours> NnCrust(std::span<const Eigen::Vector3d> points, double max_edge_mm);

}  // namespace bendloop::pipeline
