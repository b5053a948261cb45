// SPDX-License-Identifier: Apache-2.0
#include "pipeline/features/border_points.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <optional>
#include <queue>
#include <tuple>

#include "pipeline/features/crease.h"

namespace bendloop::pipeline {
namespace {

using Eigen::Vector3d;

struct OrderSettings {
  // [reach] Points are gathered in cubes of this edge, then moved onto the line through those
  // around.
  double cube = 1.0 / 3;
  int smoothings = 2;
  // [reach] Shorter lines are none.
  double least_length = 4;
  std::size_t least_points = 8;
  // Connected points that may be a part of one.
  std::size_t least_of_part = 5;
  // [reach] What is closed over, and told as a gap.
  double most_gap = 4;
  // [reach] Longer steps are gaps; points farther off the line are a branch.
  double step = 1.2, branch = 1.0;
  // [rad] An edge of the cloud: a gap between neighbours from here.
  double edge_gap = 2.5;
  // [reach] Neighbours along an edge of the cloud, and along a line between regions.
  double edge_reach = 1.6, line_reach = 1.3;
  // [reach] How far each side of a crease is looked at.
  double side = 2.5;
};
constexpr OrderSettings kOrder;

std::vector<Vector3d> Gathered(std::span<const Vector3d> points, double reach_mm) {
  std::vector<Vector3d> few = CellMeans(points, kOrder.cube * reach_mm);
  for (int pass = 0; pass < kOrder.smoothings; ++pass) {
    const PointIndex index(few, reach_mm);
    std::vector<Vector3d> moved = few;
    for (std::size_t i = 0; i < few.size(); ++i) {
      Vector3d mean = Vector3d::Zero();
      double count = 0;
      index.Visit(few[i], reach_mm, [&](std::size_t k) {
        mean += few[k];
        ++count;
      });
      if (count < 3) continue;
      mean /= count;
      Eigen::Matrix3d spread = Eigen::Matrix3d::Zero();
      index.Visit(few[i], reach_mm,
                  [&](std::size_t k) { spread += (few[k] - mean) * (few[k] - mean).transpose(); });
      Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen;
      eigen.computeDirect(spread);
      const Vector3d along = eigen.eigenvectors().col(2);
      moved[i] = mean + along.dot(few[i] - mean) * along;
    }
    few = CellMeans(moved, kOrder.cube * reach_mm);
  }
  return few;
}

// The longest way through the shortest tree that joins the points.
class Tree {
 public:
  Tree(const std::vector<Vector3d>& points, double reach_mm)
      : points_(points),
        reach_mm_(reach_mm),
        index_(points, reach_mm),
        joined_(points.size()),
        seen_(points.size(), false) {}

  bool Seen(std::size_t i) const { return seen_[i]; }

  // All points of the set that holds `seed`, in the order in which they were joined.
  std::vector<std::size_t> Grow(std::size_t seed) {
    struct Edge {
      double length_mm;
      std::size_t from, to;
      bool operator>(const Edge& other) const {
        return std::tie(length_mm, from, to) > std::tie(other.length_mm, other.from, other.to);
      }
    };
    std::priority_queue<Edge, std::vector<Edge>, std::greater<>> edges;
    std::vector<std::size_t> set;
    edges.push({0, seed, seed});
    while (!edges.empty()) {
      const Edge edge = edges.top();
      edges.pop();
      if (seen_[edge.to]) continue;
      seen_[edge.to] = true;
      set.push_back(edge.to);
      if (edge.from != edge.to) {
        joined_[edge.from].push_back(edge.to);
        joined_[edge.to].push_back(edge.from);
      }
      index_.Visit(points_[edge.to], reach_mm_, [&](std::size_t k) {
        if (!seen_[k]) edges.push({(points_[k] - points_[edge.to]).norm(), edge.to, k});
      });
    }
    return set;
  }

  std::vector<std::size_t> LongestWay(std::size_t seed) const {
    return WayToFarthest(WayToFarthest(seed).back());
  }

 private:
  std::vector<std::size_t> WayToFarthest(std::size_t from) const {
    std::map<std::size_t, std::pair<std::size_t, double>> before = {{from, {from, 0.0}}};
    std::vector<std::size_t> open = {from};
    std::size_t farthest = from;
    while (!open.empty()) {
      const std::size_t i = open.back();
      open.pop_back();
      const double so_far = before.at(i).second;
      if (so_far > before.at(farthest).second) farthest = i;
      for (const std::size_t k : joined_[i]) {
        if (before.try_emplace(k, i, so_far + (points_[k] - points_[i]).norm()).second) {
          open.push_back(k);
        }
      }
    }
    std::vector<std::size_t> way = {farthest};
    while (way.back() != from) way.push_back(before.at(way.back()).first);
    std::reverse(way.begin(), way.end());
    return way;
  }

  const std::vector<Vector3d>& points_;
  double reach_mm_;
  PointIndex index_;
  std::vector<std::vector<std::size_t>> joined_;
  std::vector<bool> seen_;
};

double LengthMm(const std::vector<Vector3d>& points) {
  double length_mm = 0;
  for (std::size_t i = 1; i < points.size(); ++i) length_mm += (points[i] - points[i - 1]).norm();
  return length_mm;
}

// Sets of points off the way; each is an arm of the line.
std::size_t CountBranches(const std::vector<Vector3d>& points, const std::vector<std::size_t>& set,
                          const std::vector<Vector3d>& way, double reach_mm) {
  const PointIndex on_way(way, reach_mm);
  std::vector<Vector3d> off;
  for (const std::size_t i : set) {
    bool near = false;
    on_way.Visit(points[i], kOrder.branch * reach_mm, [&](std::size_t) { near = true; });
    if (!near) off.push_back(points[i]);
  }
  Tree tree(off, reach_mm);
  std::size_t branches = 0;
  for (std::size_t i = 0; i < off.size(); ++i) {
    if (!tree.Seen(i) && tree.Grow(i).size() >= 3) ++branches;
  }
  return branches;
}

// Two open lines whose ends are near become one, whichever ends these are.
bool JoinNearest(std::vector<FoundBorder>& lines, double most_mm) {
  double best_mm = most_mm;
  std::size_t a = 0, b = 0;
  bool turn_a = false, turn_b = false;
  for (std::size_t i = 0; i < lines.size(); ++i) {
    for (std::size_t k = i + 1; k < lines.size(); ++k) {
      for (int ends = 0; ends < 4; ++ends) {
        const auto& p = lines[i].border.points_mm;
        const auto& q = lines[k].border.points_mm;
        const double mm =
            ((ends & 1 ? p.front() : p.back()) - (ends & 2 ? q.back() : q.front())).norm();
        if (mm >= best_mm) continue;
        best_mm = mm;
        a = i;
        b = k;
        turn_a = ends & 1;
        turn_b = ends & 2;
      }
    }
  }
  if (a == b) return false;
  auto& p = lines[a].border.points_mm;
  auto& q = lines[b].border.points_mm;
  if (turn_a) std::reverse(p.begin(), p.end());
  if (turn_b) std::reverse(q.begin(), q.end());
  p.insert(p.end(), q.begin(), q.end());
  lines[a].gaps += lines[b].gaps + 1;
  lines[a].branches += lines[b].branches;
  lines.erase(lines.begin() + static_cast<std::ptrdiff_t>(b));
  return true;
}

void CloseIfNear(FoundBorder& line, double reach_mm) {
  const auto& points = line.border.points_mm;
  const double open_mm = (points.front() - points.back()).norm();
  if (open_mm > kOrder.most_gap * reach_mm || LengthMm(points) < 4 * open_mm) return;
  line.border.closed = true;
  if (open_mm > kOrder.step * reach_mm) ++line.gaps;
}

}  // namespace

std::vector<FoundBorder> OrderPoints(std::span<const Vector3d> points_mm, double reach_mm) {
  const std::vector<Vector3d> points = Gathered(points_mm, reach_mm);
  std::vector<FoundBorder> lines;
  Tree tree(points, reach_mm);
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (tree.Seen(i)) continue;
    const std::vector<std::size_t> set = tree.Grow(i);
    if (set.size() < kOrder.least_of_part) continue;
    FoundBorder line;
    for (const std::size_t k : tree.LongestWay(i)) line.border.points_mm.push_back(points[k]);
    line.branches = CountBranches(points, set, line.border.points_mm, reach_mm);
    lines.push_back(std::move(line));
  }
  // Loops first: their ends are no ends.
  std::vector<FoundBorder> done, open;
  for (FoundBorder& line : lines) {
    const double apart_mm = (line.border.points_mm.front() - line.border.points_mm.back()).norm();
    const bool is_loop = apart_mm < kOrder.step * reach_mm;
    if (is_loop) CloseIfNear(line, reach_mm);
    (line.border.closed ? done : open).push_back(std::move(line));
  }
  while (JoinNearest(open, kOrder.most_gap * reach_mm)) {
  }
  for (FoundBorder& line : open) {
    CloseIfNear(line, reach_mm);
    done.push_back(std::move(line));
  }
  std::erase_if(done, [&](const FoundBorder& line) {
    return line.border.points_mm.size() < kOrder.least_points ||
           LengthMm(line.border.points_mm) < kOrder.least_length * reach_mm;
  });
  return done;
}

std::vector<FoundBorder> FindBorders(std::span<const Vector3d> points_mm, const PointIndex& index,
                                     std::span<const PointCharacteristics> characteristics,
                                     const Regions& regions, const RegionOptions& options) {
  std::map<std::pair<int, int>, std::vector<Vector3d>> between;
  for (std::size_t i = 0; i < points_mm.size(); ++i) {
    const int region = regions.of_point[i];
    if (region == Regions::kNone) continue;
    if (characteristics[i].gap > kOrder.edge_gap) {
      between[{region, Regions::kNone}].push_back(points_mm[i]);
    }
    index.Visit(points_mm[i], options.reach_mm, [&](std::size_t k) {
      if (regions.of_point[k] <= region) return;
      between[{region, regions.of_point[k]}].push_back(0.5 * (points_mm[i] + points_mm[k]));
    });
  }
  // The smooth points of a region around a place.
  const auto side = [&](const Vector3d& at, int region) {
    std::vector<Vector3d> points;
    index.Visit(at, kOrder.side * options.reach_mm, [&](std::size_t k) {
      if (regions.of_point[k] != region) return;
      if (characteristics[k].normal_turn < options.normal_turn) points.push_back(points_mm[k]);
    });
    return points;
  };
  std::vector<FoundBorder> borders;
  for (const auto& [pair, points] : between) {
    // Points of an edge stand singly, those between two regions are many.
    const double reach_mm =
        (pair.second == Regions::kNone ? kOrder.edge_reach : kOrder.line_reach) * options.reach_mm;
    for (FoundBorder& found : OrderPoints(points, reach_mm)) {
      found.region = pair.first;
      found.beside = pair.second;
      for (Vector3d& place : found.border.points_mm) {
        if (pair.second == Regions::kNone) break;
        const auto crease =
            CreasePlace(place, side(place, pair.first), side(place, pair.second), options.reach_mm);
        if (crease) place = *crease;
      }
      borders.push_back(std::move(found));
    }
  }
  return borders;
}

}  // namespace bendloop::pipeline
