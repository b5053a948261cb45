// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "pipeline/fit/line_blocks.h"
#include "pipeline/fit/registration.h"
#include "pipeline/fit/surface_points.h"
#include "pipeline/points/kept_lines.h"
#include "pipeline/spine/sample_intake.h"
#include "pipeline/structure/end_sleeves.h"

namespace bendloop::pipeline {

// Blocks that look at what they hold, or at what another object holds.
struct SeenPoints {
  std::span<const PointBlock> blocks;
  std::optional<LineBlocks> lines;
  std::vector<PartedBlock> parted;
  std::vector<Eigen::Vector3d> moved;
};

// What features are looked for in: the points that were fitted, or, where these were thinned, the
// scan's lines. All over the tube as many of them as show where there is something; about that
// place all that were kept, as far as there is room.
class FeaturePoints {
 public:
  // `fitted`: blocks near the tube, of all points that the intake's grid holds; `near`: their
  // indices there; `sleeves` were taken off them, and passes moved by `registration`. All of these
  // outlive it.
  FeaturePoints(const SampleIntake& intake, std::span<const PointBlock> fitted,
                std::vector<std::int32_t> near, std::span<const PlainEnd> sleeves,
                const Registration& registration);
  FeaturePoints(const FeaturePoints&) = delete;
  FeaturePoints& operator=(const FeaturePoints&) = delete;

  std::span<const PointBlock> all() const { return all_.blocks; }
  std::size_t in_view() const { return in_view_; }  // far from the tube, too
  // Those about places, about so many at most.
  SeenPoints About(std::span<const Ball> balls, std::size_t room) const;

 private:
  bool AreLines() const;
  SeenPoints Bring(const DirectedPoints& points, std::span<const std::int32_t> indices) const;

  const SampleIntake& intake_;
  std::vector<std::int32_t> near_;  // ascending
  std::span<const PlainEnd> sleeves_;
  const Registration& registration_;
  SeenPoints all_;
  std::size_t in_view_ = 0;
};

}  // namespace bendloop::pipeline
