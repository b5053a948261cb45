// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

namespace bendloop::pipeline {

// Fewest segments whose vertices are points of the chain and which pass within `epsilon_mm` of
// every point; of all such, the one with the least sum of squared distances. Returns the indices
// of the vertices, first and last point included.
// Source: Bauer & Polthier 2009, section 4.5 (after Daescu 2003): breadth-first search on the graph
// of valid shortcuts.
std::vector<std::size_t> Simplify(std::span<const Eigen::Vector3d> chain, double epsilon_mm);

}  // namespace bendloop::pipeline
