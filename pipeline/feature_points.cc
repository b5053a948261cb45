// SPDX-License-Identifier: Apache-2.0
#include "pipeline/feature_points.h"

#include <Eigen/Core>
#include <algorithm>
#include <iterator>
#include <utility>

#include "pipeline/points/sample_grid.h"

namespace bendloop::pipeline {
namespace {

struct FeaturePointSettings {
  // Points of lines all over the tube. By trial: openings that only more of them show are missed,
  // but each costs time in scans that have none, too.
  std::size_t all_over = 200'000;
  // By so many, about, it is known which part of them lies near the tube.
  std::size_t asked = 20'000;
};
constexpr FeaturePointSettings kFeaturePoints;

// Points of the lines, thinned so that about `room` of them, or all, lie in these blocks: a table
// around the tube takes no room. `indices`: ascending.
DirectedPoints PointsOf(const KeptLines& lines, std::size_t room, const SampleGrid& grid,
                        std::span<const std::int32_t> indices) {
  if (lines.point_count() <= room) return lines.Points();
  const auto some = lines.ThinnedTo(kFeaturePoints.asked).Points();
  std::size_t inside = 0;
  for (const std::int32_t index : grid.BlocksOf(some.points_mm)) {
    if (std::binary_search(indices.begin(), indices.end(), index)) ++inside;
  }
  const auto count = static_cast<double>(some.points_mm.size());
  const double part = static_cast<double>(std::max<std::size_t>(1, inside)) / count;
  const double in_all = static_cast<double>(room) / part;
  if (static_cast<double>(lines.point_count()) <= in_all) return lines.Points();
  return lines.ThinnedTo(static_cast<std::size_t>(in_all)).Points();
}

}  // namespace

FeaturePoints::FeaturePoints(const SampleIntake& intake, std::span<const PointBlock> fitted,
                             std::vector<std::int32_t> near, std::span<const PlainEnd> sleeves,
                             const Registration& registration)
    : intake_(intake), near_(std::move(near)), sleeves_(sleeves), registration_(registration) {
  if (!AreLines()) {
    all_.blocks = fitted;
    in_view_ = intake.grid().kept_count();
    return;
  }
  std::erase_if(near_, [&](std::int32_t index) { return intake.IsPlanar(index); });
  const DirectedPoints points =
      PointsOf(intake.lines(), kFeaturePoints.all_over, intake.grid(), near_);
  in_view_ = points.points_mm.size();
  all_ = Bring(points, near_);
}

bool FeaturePoints::AreLines() const {
  const SampleGrid& grid = intake_.grid();
  return grid.kept_count() < grid.point_count() && intake_.lines().point_count() > 0;
}

SeenPoints FeaturePoints::About(std::span<const Ball> balls, std::size_t room) const {
  if (!AreLines() || intake_.lines().point_count() == in_view_) {
    SeenPoints same;
    same.blocks = all_.blocks;
    return same;
  }
  std::vector<std::int32_t> indices;
  for (const Ball& ball : balls) {
    const auto about = intake_.grid().BlocksNear({&ball.middle_mm, 1}, ball.radius_mm);
    std::vector<std::int32_t> together;
    std::set_union(indices.begin(), indices.end(), about.begin(), about.end(),
                   std::back_inserter(together));
    indices = std::move(together);
  }
  std::erase_if(indices, [&](std::int32_t index) {
    return !std::binary_search(near_.begin(), near_.end(), index);
  });
  const KeptLines near = intake_.lines().Near(balls);
  return Bring(PointsOf(near, room, intake_.grid(), indices), indices);
}

SeenPoints FeaturePoints::Bring(const DirectedPoints& points,
                                std::span<const std::int32_t> indices) const {
  SeenPoints seen;
  std::vector<PointBlock>& blocks = seen.lines.emplace(points, intake_.grid(), indices).blocks;
  for (const PlainEnd& sleeve : sleeves_) {
    LeaveOut(sleeve, intake_.pipe_radius_mm(), blocks, seen.parted);
  }
  if (!registration_.passes.empty()) MoveOntoTube(registration_, blocks, seen.moved);
  seen.blocks = blocks;
  return seen;
}

}  // namespace bendloop::pipeline
