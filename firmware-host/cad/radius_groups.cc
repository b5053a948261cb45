// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cad/radius_groups.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

namespace bendloop::host {
namespace {

using Eigen::Vector3d;

struct PieceEnd {
  std::size_t group = 0;
  double radius_mm = 0;
  bool concave = false;
  Vector3d point, outward;
  bool is_met = false;  // by another of its group
};

bool Meet(const PieceEnd& a, const PieceEnd& b) {
  return a.concave == b.concave && (a.point - b.point).norm() < MatchToleranceMm(a.radius_mm) &&
         PointAtEachOther(a.outward, b.outward);
}

std::vector<PieceEnd> EndsOf(const std::vector<std::vector<int>>& groups,
                             const std::vector<TubePiece>& pieces) {
  std::vector<PieceEnd> ends;
  for (std::size_t g = 0; g < groups.size(); ++g) {
    for (const int i : groups[g]) {
      const TubePiece& piece = pieces[std::size_t(i)];
      for (const bool at_to : {false, true}) {
        const double at = at_to ? piece.to : piece.from;
        const Vector3d t = piece.TangentAt(at);
        ends.push_back({g, piece.radius_mm, piece.concave, piece.PointAt(at),
                        at_to ? t : Vector3d(-t), false});
      }
    }
  }
  return ends;
}

// Calls see(a, b) for ends of nearly one radius that meet. `ends` are in the order of radii.
void EachMeeting(std::vector<PieceEnd>& ends, const auto& see) {
  for (std::size_t i = 0; i < ends.size(); ++i) {
    const double most_mm = ends[i].radius_mm + MatchToleranceMm(ends[i].radius_mm);
    for (std::size_t j = i + 1; j < ends.size() && ends[j].radius_mm <= most_mm; ++j) {
      if (Meet(ends[i], ends[j])) see(ends[i], ends[j]);
    }
  }
}

// Of each group the first one that it leads on to by an end that none of its own meets.
std::vector<std::size_t> LedOnTo(const std::vector<std::vector<int>>& groups,
                                 const std::vector<TubePiece>& pieces) {
  std::vector<PieceEnd> ends = EndsOf(groups, pieces);
  std::stable_sort(ends.begin(), ends.end(),
                   [](const PieceEnd& a, const PieceEnd& b) { return a.radius_mm < b.radius_mm; });
  EachMeeting(ends, [](PieceEnd& a, PieceEnd& b) {
    if (a.group == b.group) a.is_met = b.is_met = true;
  });
  std::vector<std::size_t> of(groups.size());
  std::iota(of.begin(), of.end(), 0);
  EachMeeting(ends, [&](const PieceEnd& a, const PieceEnd& b) {
    if (a.is_met || b.is_met || of[a.group] == of[b.group]) return;
    const auto [low, high] = std::minmax({of[a.group], of[b.group]});
    std::replace(of.begin(), of.end(), std::size_t(high), std::size_t(low));
  });
  return of;
}

// Elbows of another diameter than all straights stay a group of their own (tube_layers.h).
std::vector<std::vector<int>> WithScattered(std::vector<std::vector<int>> groups,
                                            const std::vector<TubePiece>& pieces) {
  const std::vector<std::size_t> of = LedOnTo(groups, pieces);
  std::vector<int> with_straights(groups.size(), 0);
  for (std::size_t g = 0; g < groups.size(); ++g) {
    with_straights[of[g]] += std::any_of(groups[g].begin(), groups[g].end(),
                                         [&](int i) { return !pieces[std::size_t(i)].is_arc; });
  }
  for (std::size_t g = groups.size(); g-- > 0;) {
    if (of[g] == g || with_straights[of[g]] < 2) continue;
    auto& whole = groups[of[g]];
    whole.insert(whole.end(), groups[g].begin(), groups[g].end());
    groups[g].clear();
  }
  std::erase_if(groups, [](const std::vector<int>& group) { return group.empty(); });
  return groups;
}

}  // namespace

std::vector<std::vector<int>> RadiusGroups(const std::vector<TubePiece>& pieces) {
  std::vector<int> order;
  for (std::size_t i = 0; i < pieces.size(); ++i) {
    if (pieces[i].around_deg() >= kFewestAroundDeg) order.push_back(int(i));
  }
  const auto piece = [&](int i) -> const TubePiece& { return pieces[std::size_t(i)]; };
  std::stable_sort(order.begin(), order.end(), [&](int a, int b) {
    return std::make_pair(piece(a).concave, piece(a).radius_mm) <
           std::make_pair(piece(b).concave, piece(b).radius_mm);
  });
  std::vector<std::vector<int>> groups;
  for (std::size_t i = 0; i < order.size();) {
    std::vector<int> of{order[i]};
    const TubePiece& first = piece(order[i]);
    for (++i; i < order.size() && piece(order[i]).concave == first.concave &&
              piece(order[i]).radius_mm - first.radius_mm < MatchToleranceMm(first.radius_mm) / 4;
         ++i) {
      of.push_back(order[i]);
    }
    groups.push_back(std::move(of));
  }
  return WithScattered(std::move(groups), pieces);
}

}  // namespace bendloop::host
