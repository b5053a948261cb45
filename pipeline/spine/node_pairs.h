// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cstddef>
#include <span>
#include <utility>
#include <vector>

#include "pipeline/spine/spine_node.h"

namespace bendloop::pipeline {

// Calls visit(i, j, distance_mm) for every two nodes at most `far_mm` apart, once, in an order that
// depends on their places alone but for equal ones.
template <class Visit>
void VisitNearPairs(std::span<const SpineNode> nodes, double far_mm, Visit visit) {
  std::vector<std::size_t> by_x(nodes.size());
  for (std::size_t i = 0; i < by_x.size(); ++i) by_x[i] = i;
  std::sort(by_x.begin(), by_x.end(), [&nodes](std::size_t a, std::size_t b) {
    return std::pair(nodes[a].position_mm.x(), a) < std::pair(nodes[b].position_mm.x(), b);
  });
  for (std::size_t i = 0; i < by_x.size(); ++i) {
    for (std::size_t j = i + 1; j < by_x.size(); ++j) {
      const Eigen::Vector3d between = nodes[by_x[j]].position_mm - nodes[by_x[i]].position_mm;
      if (between.x() > far_mm) break;
      const double distance_mm = between.norm();
      if (distance_mm <= far_mm) visit(by_x[i], by_x[j], distance_mm);
    }
  }
}

}  // namespace bendloop::pipeline
