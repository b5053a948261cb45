// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <span>
#include <vector>

#include "pipeline/features/border_fit.h"
#include "pipeline/features/regions.h"

namespace bendloop::pipeline {

// One line between a region and what is beside it.
struct FoundBorder {
  OrderedBorder border;
  int region = 0;
  // Of the other side; Regions::kNone at an edge of the cloud.
  int beside = Regions::kNone;
  // Steps much longer than the rest, and arms that leave the line and were left out.
  std::size_t gaps = 0, branches = 0;
};

// Borders of all regions, each between two once, in the order of the regions. Where two smooth
// surfaces meet, points are moved onto the crease that both sides' paraboloids have in common.
std::vector<FoundBorder> FindBorders(std::span<const Eigen::Vector3d> points_mm,
                                     const PointIndex& index,
                                     std::span<const PointCharacteristics> characteristics,
                                     const Regions& regions, const RegionOptions& options);

// Points scattered along lines, in their order: one border for each connected set, along its
// longest way. Neighbours are within `reach_mm`.
std::vector<FoundBorder> OrderPoints(std::span<const Eigen::Vector3d> points_mm, double reach_mm);

}  // namespace bendloop::pipeline
