// SPDX-License-Identifier: Apache-2.0
#include "pipeline/spine/closed_tube.h"

#include <algorithm>
#include <vector>

#include "pipeline/points/point_index.h"

namespace bendloop::pipeline {
namespace {

// What closes a curve. Lengths in pipe radii; by trial where nothing else is said.
struct LoopSettings {
  // As far as nodes are joined without a word (spine_polygon.cc), and the cosine of that edge.
  double longest_edge = 1.5, least_edge_cosine = 0.8;
  // A shorter loop is a knot of nodes: no machine bends a ring of less than a pipe radius inside.
  double least_length = 12.0;
  // Samples further from the spine are not the tube's.
  double reach = 1.5;
  // [times the next longest stretch without samples] From there on it is where the tube ends.
  double much_longer = 2.5;
};
constexpr LoopSettings kLoop;

// Where the samples are along the loop [mm], in order.
std::vector<double> PlacesAlong(std::span<const Eigen::Vector3d> samples, double reach_mm,
                                const SpinePolygon& polygon, const std::vector<double>& along_mm) {
  std::vector<Eigen::Vector3d> nodes;
  for (const SpineNode& node : polygon) nodes.push_back(node.position_mm);
  const PointIndex index(nodes, reach_mm);
  std::vector<double> places;
  for (const Eigen::Vector3d& p : samples) {
    double nearest_mm = reach_mm;
    std::size_t nearest = nodes.size();
    index.Visit(p, reach_mm, [&](std::size_t i) {
      const double d_mm = (p - nodes[i]).norm();
      if (!(d_mm < nearest_mm)) return;
      nearest_mm = d_mm;
      nearest = i;
    });
    if (nearest == nodes.size()) continue;
    places.push_back(along_mm[nearest] + (p - nodes[nearest]).dot(polygon[nearest].tangent));
  }
  std::sort(places.begin(), places.end());
  return places;
}

}  // namespace

bool IsLoop(const SpinePolygon& polygon, double pipe_radius_mm) {
  if (polygon.size() < 3) return false;
  const Eigen::Vector3d edge_mm = polygon.front().position_mm - polygon.back().position_mm;
  const double length_mm = edge_mm.norm();
  const double least_mm = kLoop.least_edge_cosine * length_mm;
  return LengthOf(polygon) > kLoop.least_length * pipe_radius_mm &&
         length_mm < kLoop.longest_edge * pipe_radius_mm &&
         edge_mm.dot(polygon.front().tangent) > least_mm &&
         edge_mm.dot(polygon.back().tangent) > least_mm;
}

bool OpenAtGap(std::span<const Eigen::Vector3d> samples, double pipe_radius_mm,
               SpinePolygon& polygon) {
  std::vector<double> along_mm = {0.0};
  for (std::size_t i = 1; i < polygon.size(); ++i) {
    along_mm.push_back(along_mm.back() +
                       (polygon[i].position_mm - polygon[i - 1].position_mm).norm());
  }
  const double around_mm =
      along_mm.back() + (polygon.front().position_mm - polygon.back().position_mm).norm();
  const std::vector<double> places =
      PlacesAlong(samples, kLoop.reach * pipe_radius_mm, polygon, along_mm);
  if (places.size() < 2) return false;
  // From the last sample once round to the first; longer stretches push shorter ones down.
  double longest_mm = places.front() + around_mm - places.back(), next_mm = 0;
  double middle_mm = places.back() + 0.5 * longest_mm;
  for (std::size_t i = 1; i < places.size(); ++i) {
    const double empty_mm = places[i] - places[i - 1];
    if (empty_mm > longest_mm) {
      next_mm = longest_mm;
      longest_mm = empty_mm;
      middle_mm = 0.5 * (places[i] + places[i - 1]);
    } else {
      next_mm = std::max(next_mm, empty_mm);
    }
  }
  if (!(longest_mm > kLoop.much_longer * next_mm)) return false;
  if (middle_mm < 0) middle_mm += around_mm;
  const auto first = std::lower_bound(along_mm.begin(), along_mm.end(), middle_mm);
  std::rotate(
      polygon.begin(),
      polygon.begin() + (first - along_mm.begin()) % static_cast<std::ptrdiff_t>(polygon.size()),
      polygon.end());
  return true;
}

}  // namespace bendloop::pipeline
