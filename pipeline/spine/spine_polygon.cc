// SPDX-License-Identifier: Apache-2.0
#include "pipeline/spine/spine_polygon.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "pipeline/math/quantiles.h"
#include "pipeline/spine/nn_crust.h"
#include "pipeline/spine/node_pairs.h"

namespace bendloop::pipeline {
namespace {

// What nodes, edges and gaps make a spine. Lengths in pipe radii; by trial where nothing else is
// said.
struct PolygonSettings {
  // Nodes closer than this say the same.
  double spacing = 0.3;
  // A longer edge is a gap.
  double longest_edge = 1.5;
  // A longer gap is not bridged: a clamp hides up to 3, and the ends beside it are weak.
  double longest_gap = 8.0;
  // A shorter piece is clutter.
  double least_length = 2.0;
  // Cosine between an edge and the tangents of its nodes: it runs along them, within 37 degrees.
  double least_edge_cosine = 0.8;
  // The same of a gap, in which the tube may bend: 78 degrees at either end.
  double least_gap_cosine = 0.2;
  // A gap counts so many times longer for a turn of 90 degrees at either end.
  double turn_weight = 4.0;
  // Nodes that may be left out at an end for a joint: the last may be disturbed.
  std::size_t left_out = 1;
  // Distance of nodes from their samples (median) below which all pieces are as smooth.
  double smooth = 0.005;
  // So many times rougher is much rougher.
  double much_rougher = 3.0;
};
constexpr PolygonSettings kPolygon;

// When two nodes agree: a bend as tight as this leads from one to the other, but for their noise.
// Lengths in pipe radii; by trial.
struct AgreementSettings {
  double near = 0.8;            // nodes that are asked about each other
  double tightest = 1.5;        // bend radius
  double off_noise = 0.15;      // of a node's place, across
  double turn_noise_rad = 0.2;  // of its tangent
};
constexpr AgreementSettings kAgreement;

// Nodes of which most others beside them say that the spine does not pass there: fitted across two
// things, as where another part of the tube is near, or to too few samples.
std::vector<SpineNode> WithoutOddOnes(std::span<const SpineNode> nodes, double radius_mm) {
  std::vector<int> votes(nodes.size(), 0);  // more for it than against it
  VisitNearPairs(
      nodes, kAgreement.near * radius_mm, [&](std::size_t i, std::size_t j, double distance) {
        const SpineNode& a = nodes[i];
        const SpineNode& b = nodes[j];
        const Eigen::Vector3d between = b.position_mm - a.position_mm;
        const double turn = std::acos(std::min(1.0, std::abs(a.tangent.dot(b.tangent))));
        const double bent =
            distance / (kAgreement.tightest * radius_mm);  // over this distance [rad]
        const double off =
            std::max(a.tangent.cross(between).norm(), b.tangent.cross(between).norm());
        const bool agree = turn < bent + kAgreement.turn_noise_rad &&
                           off < 0.5 * bent * distance + kAgreement.off_noise * radius_mm;
        votes[i] += agree ? 1 : -1;
        votes[j] += agree ? 1 : -1;
      });
  std::vector<SpineNode> kept;
  for (std::size_t i = 0; i < nodes.size(); ++i) {
    if (votes[i] >= 0) kept.push_back(nodes[i]);
  }
  return kept;
}

// Nodes with many samples first; the weaker ones within the spacing go.
std::vector<SpineNode> Thin(std::span<const SpineNode> nodes, double spacing_mm) {
  std::vector<std::size_t> order(nodes.size());
  for (std::size_t i = 0; i < order.size(); ++i) order[i] = i;
  std::stable_sort(order.begin(), order.end(), [&nodes](std::size_t a, std::size_t b) {
    return nodes[a].samples > nodes[b].samples;
  });
  std::vector<SpineNode> kept;
  // Quadratic in the nodes near each other only: sorted along x for the search.
  std::vector<std::pair<double, std::size_t>> by_x;  // of kept
  for (const std::size_t i : order) {
    const Eigen::Vector3d& p = nodes[i].position_mm;
    auto place =
        std::lower_bound(by_x.begin(), by_x.end(), std::pair(p.x() - spacing_mm, std::size_t{0}));
    bool crowded = false;
    for (; place != by_x.end() && place->first <= p.x() + spacing_mm && !crowded; ++place) {
      crowded = (kept[place->second].position_mm - p).norm() < spacing_mm;
    }
    if (crowded) continue;
    const std::pair entry(p.x(), kept.size());
    by_x.insert(std::lower_bound(by_x.begin(), by_x.end(), entry), entry);
    kept.push_back(nodes[i]);
  }
  return kept;
}

// Follows the connections; cuts edges that do not run along the tangents.
std::vector<SpinePolygon> Follow(std::span<const SpineNode> nodes, double max_edge_mm) {
  std::vector<Eigen::Vector3d> points;
  points.reserve(nodes.size());
  for (const SpineNode& node : nodes) points.push_back(node.position_mm);
  std::vector<CurveNeighbours> neighbours = NnCrust(points, max_edge_mm);
  for (std::size_t i = 0; i < nodes.size(); ++i) {
    for (int& j : neighbours[i]) {
      if (j < 0) continue;
      const SpineNode& other = nodes[static_cast<std::size_t>(j)];
      const Eigen::Vector3d edge = (other.position_mm - nodes[i].position_mm).normalized();
      if (std::abs(edge.dot(nodes[i].tangent)) > kPolygon.least_edge_cosine &&
          std::abs(edge.dot(other.tangent)) > kPolygon.least_edge_cosine) {
        continue;
      }
      for (int& back : neighbours[static_cast<std::size_t>(j)]) {
        if (back == static_cast<int>(i)) back = -1;
      }
      j = -1;
    }
  }
  std::vector<bool> done(nodes.size(), false);
  std::vector<SpinePolygon> pieces;
  const auto walk = [&](std::size_t start) {
    SpinePolygon piece;
    int previous = -1;
    int at = static_cast<int>(start);
    while (at >= 0 && !done[static_cast<std::size_t>(at)]) {
      done[static_cast<std::size_t>(at)] = true;
      piece.push_back(nodes[static_cast<std::size_t>(at)]);
      const auto& n = neighbours[static_cast<std::size_t>(at)];
      const int next = n[0] != previous ? n[0] : n[1];
      previous = at;
      at = next;
    }
    pieces.push_back(std::move(piece));
  };
  for (std::size_t i = 0; i < nodes.size(); ++i) {
    if (!done[i] && (neighbours[i][0] < 0 || neighbours[i][1] < 0)) walk(i);
  }
  for (std::size_t i = 0; i < nodes.size(); ++i) {
    if (!done[i]) walk(i);  // a closed curve: opened where it is met first
  }
  return pieces;
}

// Natural logarithm of the nodes' median distance from their samples, in pipe radii; what is smooth
// is all alike.
double LogRoughness(const SpinePolygon& piece, double radius_mm) {
  std::vector<double> rms_mm;
  rms_mm.reserve(piece.size());
  for (const SpineNode& node : piece) rms_mm.push_back(node.rms_mm);
  return std::log(std::max(Median(std::move(rms_mm)) / radius_mm, kPolygon.smooth));
}

void PointTangentsForward(SpinePolygon& polygon) {
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const Eigen::Vector3d chord = polygon[std::min(i + 1, polygon.size() - 1)].position_mm -
                                  polygon[i == 0 ? 0 : i - 1].position_mm;
    if (polygon[i].tangent.dot(chord) < 0) polygon[i].tangent = -polygon[i].tangent;
  }
}

// One end of a piece, or the node before it: the last may be disturbed by what ended the piece.
struct PieceEnd {
  std::size_t piece = 0;
  bool front = false;
  std::size_t left_out = 0;  // nodes

  const SpineNode& Node(const SpinePolygon& polygon) const {
    return front ? polygon[left_out] : polygon[polygon.size() - 1 - left_out];
  }
};

// How far two ends are from being joined by one smooth piece: the gap, lengthened by the turn it
// would take, and more where one of them is much rougher than the other, as a clamp's edge is;
// infinite when it cannot be.
double JoinCost(const SpineNode& a, bool a_front, const SpineNode& b, bool b_front,
                double roughness, double radius_mm) {
  const Eigen::Vector3d gap = b.position_mm - a.position_mm;
  const double length = gap.norm();
  if (length > kPolygon.longest_gap * radius_mm) return std::numeric_limits<double>::infinity();
  const double cos_a = (a_front ? -1.0 : 1.0) * gap.dot(a.tangent) / length;
  const double cos_b = (b_front ? 1.0 : -1.0) * gap.dot(b.tangent) / length;
  if (!(cos_a >= kPolygon.least_gap_cosine && cos_b >= kPolygon.least_gap_cosine)) {
    return std::numeric_limits<double>::infinity();
  }
  return length *
         (1.0 + kPolygon.turn_weight * (1.0 - cos_a) + kPolygon.turn_weight * (1.0 - cos_b)) *
         (1.0 + roughness);
}

void JoinGaps(std::vector<SpinePolygon>& pieces, double radius_mm) {
  std::vector<double> roughness;
  for (const SpinePolygon& piece : pieces) roughness.push_back(LogRoughness(piece, radius_mm));
  const auto ends_of = [&pieces](std::size_t i) {
    std::vector<PieceEnd> ends;
    for (const bool front : {false, true}) {
      for (std::size_t left_out = 0;
           left_out < std::min(kPolygon.left_out + 1, pieces[i].size() - 1); ++left_out) {
        ends.push_back({i, front, left_out});
      }
    }
    return ends;
  };
  for (;;) {
    double best = std::numeric_limits<double>::infinity();
    PieceEnd best_a, best_b;
    for (std::size_t i = 0; i < pieces.size(); ++i) {
      for (std::size_t j = i + 1; j < pieces.size(); ++j) {
        const double differ = std::abs(roughness[i] - roughness[j]);
        for (const PieceEnd& a : ends_of(i)) {
          for (const PieceEnd& b : ends_of(j)) {
            const double cost =
                JoinCost(a.Node(pieces[i]), a.front, b.Node(pieces[j]), b.front, differ, radius_mm);
            if (cost < best) {
              best = cost;
              best_a = a;
              best_b = b;
            }
          }
        }
      }
    }
    if (!std::isfinite(best)) return;
    SpinePolygon& first = pieces[best_a.piece];
    SpinePolygon& second = pieces[best_b.piece];
    // The one that most nodes are of says how rough both are.
    if (second.size() > first.size()) roughness[best_a.piece] = roughness[best_b.piece];
    if (best_a.front) Reverse(first);
    if (!best_b.front) Reverse(second);
    first.erase(first.end() - static_cast<std::ptrdiff_t>(best_a.left_out), first.end());
    first.insert(first.end(), second.begin() + static_cast<std::ptrdiff_t>(best_b.left_out),
                 second.end());
    pieces.erase(pieces.begin() + static_cast<std::ptrdiff_t>(best_b.piece));
    roughness.erase(roughness.begin() + static_cast<std::ptrdiff_t>(best_b.piece));
  }
}

}  // namespace

bool IsMuchRougher(const SpinePolygon& polygon, const SpinePolygon& than, double pipe_radius_mm) {
  return LogRoughness(polygon, pipe_radius_mm) >
         LogRoughness(than, pipe_radius_mm) + std::log(kPolygon.much_rougher);
}

void Reverse(SpinePolygon& polygon) {
  std::reverse(polygon.begin(), polygon.end());
  for (SpineNode& node : polygon) node.tangent = -node.tangent;
}

double LengthOf(const SpinePolygon& polygon) {
  double length = 0;
  for (std::size_t i = 1; i < polygon.size(); ++i) {
    length += (polygon[i].position_mm - polygon[i - 1].position_mm).norm();
  }
  return length;
}

std::vector<SpinePolygon> SpinePolygons(std::span<const SpineNode> nodes, double pipe_radius_mm) {
  const std::vector<SpineNode> thinned =
      Thin(WithoutOddOnes(nodes, pipe_radius_mm), kPolygon.spacing * pipe_radius_mm);
  std::vector<SpinePolygon> pieces = Follow(thinned, kPolygon.longest_edge * pipe_radius_mm);
  return JoinedOverGaps(std::move(pieces), pipe_radius_mm);
}

std::vector<SpinePolygon> JoinedOverGaps(std::vector<SpinePolygon> pieces, double pipe_radius_mm) {
  // A piece of one node has no direction of its own to be joined by.
  std::erase_if(pieces, [](const SpinePolygon& piece) { return piece.size() < 2; });
  for (SpinePolygon& piece : pieces) PointTangentsForward(piece);
  JoinGaps(pieces, pipe_radius_mm);
  std::erase_if(pieces, [pipe_radius_mm](const SpinePolygon& piece) {
    return LengthOf(piece) < kPolygon.least_length * pipe_radius_mm;
  });
  std::stable_sort(pieces.begin(), pieces.end(),
                   [](const auto& a, const auto& b) { return LengthOf(a) > LengthOf(b); });
  return pieces;
}

}  // namespace bendloop::pipeline
