// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "hal/result.h"
#include "pipeline/features/border_fit.h"
#include "pipeline/math/workers.h"

namespace bendloop::pipeline {

struct FeatureOptions {
  // Normals that turn faster within the reach are a border.
  double normal_turn_deg = 30;
  // Deeper below the convex hull is a feature; 0: what stands clear of the points' own noise.
  double concavity_mm = 0;
  // More points than this are thinned evenly before anything is looked for: bounds time and memory.
  std::size_t most_points = 120'000;
  // Part of the points that a region has at least.
  double least_part = 0.002;
};

struct FeatureRegion {
  std::size_t points = 0;  // of those looked at
  Eigen::Vector3d center_mm = Eigen::Vector3d::Zero();
  Eigen::Vector3d size_mm = Eigen::Vector3d::Zero();  // along its own axes, longest first
  double depth_mm = 0;                                // the most below the convex hull
  bool concave = false;
};

struct FeatureBorder {
  std::size_t region = 0;
  int beside = -1;  // region on the other side; -1: an edge of the cloud
  std::size_t points = 0, gaps = 0, branches = 0;
  BorderFit fit;
};

struct FeatureBorders {
  std::vector<FeatureRegion> regions;  // the largest first
  std::vector<FeatureBorder> borders;
  std::size_t points_used = 0;
  double reach_mm = 0;        // who is a neighbour
  double noise_sigma_mm = 0;  // of the points off the surface around them, bends included
  double concavity_mm = 0;    // deeper is a feature; infinite: the hull says nothing
  std::vector<std::string> warnings;
};

// Any cloud to its regions and their borders as curves. The same for any order of the points.
// kBadInput: fewer than 200 points, points that are no numbers or in fewer than 200 places, a cloud
// that spans no body.
// Source: Stamati & Fudos 2008, sections 2 and 3.
hal::Result<FeatureBorders> FindFeatureBorders(std::span<const Eigen::Vector3d> points_mm,
                                               const FeatureOptions& options = {},
                                               Workers* workers = nullptr);

}  // namespace bendloop::pipeline
