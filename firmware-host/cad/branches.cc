// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cad/branches.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <utility>

#include "firmware-host/cad/developed.h"

namespace bendloop::host {
namespace {

using Eigen::Vector3d;

// What leans less than this from the tube's own direction goes along with it [cosine].
constexpr double kAlongCosine = 0.98;
// A branch is at least so many of its own radii long; what is shorter is a socket or a boss.
constexpr double kBranchRadii = 2;
// What stands nearer to an end than so many pipe radii belongs to the end.
constexpr double kEndRadii = 0.25;
// A plate stands off the tube by more than that, and by more than this [mm].
constexpr double kLeastPlateMm = 1;

struct Branch {
  double along_mm = 0, around_deg = 0, radius_mm = 0, height_mm = 0;
};

// Where `foot`, an end of a chain whose other end is `top`, sits on the tube; false: nowhere.
bool StandsOn(const CadTube& tube, const Developed& developed, const Vector3d& foot,
              const Vector3d& top, const Vector3d& away, Branch& branch) {
  const double radius = tube.pipe_radius_mm, tolerance = MatchToleranceMm(radius);
  const Place at = developed.Of(foot), end = developed.Of(top);
  if (at.across_mm > radius + tolerance || end.across_mm < radius + 0.1 * branch.radius_mm)
    return false;
  if (std::abs(at.tangent.dot(away)) > kAlongCosine) return false;
  const double edge = kEndRadii * radius;
  if (at.along_mm < edge || at.along_mm > tube.spine.length_mm() - edge) return false;
  branch.along_mm = at.along_mm;
  branch.around_deg = end.around_deg;
  branch.height_mm = end.across_mm - radius;
  return true;
}

// With its bore, where a file does not say which side the material is on, and its steps.
void AddTo(std::vector<Branch>& branches, const Branch& branch, double pipe_radius_mm) {
  const auto same = std::find_if(branches.begin(), branches.end(), [&](const Branch& b) {
    return std::abs(b.along_mm - branch.along_mm) < pipe_radius_mm &&
           std::abs(b.around_deg - branch.around_deg) < 5;
  });
  if (same == branches.end()) {
    branches.push_back(branch);
  } else {
    same->radius_mm = std::max(same->radius_mm, branch.radius_mm);
    same->height_mm = std::max(same->height_mm, branch.height_mm);
  }
}

std::string Text(const Branch& branch) {
  char text[240];
  std::snprintf(
      text, sizeof text,
      "%s of %.3f mm in diameter %s at %.1f mm of the developed length, %.0f degrees "
      "around: the rows are those of the tube without it",
      branch.height_mm > kBranchRadii * branch.radius_mm ? "a branch" : "a socket or boss",
      2 * branch.radius_mm,
      branch.height_mm > kBranchRadii * branch.radius_mm ? "leaves it" : "stands on it",
      branch.along_mm, RoundedTurnDeg(branch.around_deg, 0));
  return text;
}

// From the centre line, or, before an end that is cut obliquely, from its axis: the cut reaches far
// along it.
double ReachMm(const CadTube& tube, const Place& at) {
  const auto is_cut = [](const TubeEnd& end) { return end.oblique_deg > 0 || end.in_bend; };
  const bool beyond = (at.along_mm <= 0 && is_cut(tube.first)) ||
                      (at.along_mm >= tube.spine.length_mm() && is_cut(tube.last));
  if (!beyond) return at.across_mm;
  return at.across_mm * (at.radial - at.radial.dot(at.tangent) * at.tangent).norm();
}

}  // namespace

std::vector<std::string> BranchNotes(const CadTube& tube,
                                     const std::vector<const TubeChain*>& others) {
  const Developed developed(tube.spine);
  std::vector<Branch> branches;
  for (const TubeChain* chain : others) {
    if (chain->concave || chain->is_closed) continue;
    const Spine& spine = chain->spine;
    // What comes back to the tube is farthest from it in its middle.
    const Vector3d middle =
        spine.arcs.empty() ? (spine.start + spine.end) / 2 : spine.arcs[spine.arcs.size() / 2].from;
    const auto top = [&](const Vector3d& other) {
      return developed.Of(other).across_mm > developed.Of(middle).across_mm ? other : middle;
    };
    Branch branch;
    branch.radius_mm = chain->radius_mm;
    if (StandsOn(tube, developed, spine.start, top(spine.end), spine.direction, branch)) {
      AddTo(branches, branch, tube.pipe_radius_mm);
    }
    if (StandsOn(tube, developed, spine.end, top(spine.start), spine.end_direction(), branch)) {
      AddTo(branches, branch, tube.pipe_radius_mm);
    }
  }
  std::sort(branches.begin(), branches.end(), [](const Branch& a, const Branch& b) {
    return std::make_pair(a.along_mm, a.around_deg) < std::make_pair(b.along_mm, b.around_deg);
  });
  std::vector<std::string> notes;
  for (const Branch& branch : branches) notes.push_back(Text(branch));
  return notes;
}

std::vector<std::string> PlateNotes(const CadBody& body, const CadTube& tube,
                                    const std::vector<const TubeChain*>& others,
                                    const std::set<int>& round) {
  const double radius = tube.pipe_radius_mm, length = tube.spine.length_mm();
  const Developed developed(tube.spine);
  std::vector<Developed> beside;
  for (const TubeChain* chain : others) beside.emplace_back(chain->spine);
  // The cap of a branch, and of another tube of the body.
  const auto is_others = [&](const Vector3d& p) {
    for (std::size_t i = 0; i < beside.size(); ++i) {
      if (beside[i].Of(p).across_mm < 1.05 * others[i]->radius_mm + 0.01) return true;
    }
    return false;
  };
  const double plain = radius + std::max(kLeastPlateMm, kEndRadii * radius);
  Place farthest;
  double farthest_mm = 0;
  for (const FaceEdge& edge : body.edges) {
    if (round.contains(edge.face)) continue;
    for (const Vector3d& p : edge.points) {
      const Place at = developed.Of(p);
      const bool at_end =
          (tube.first.fitting_mm > 0 && at.along_mm < tube.first.fitting_mm + kEndRadii * radius) ||
          (tube.last.fitting_mm > 0 &&
           at.along_mm > length - tube.last.fitting_mm - kEndRadii * radius);
      const double reach_mm = ReachMm(tube, at);
      if (at_end || reach_mm < std::max(plain, farthest_mm) || is_others(p)) continue;
      farthest = at;
      farthest_mm = reach_mm;
    }
  }
  if (farthest_mm == 0) return {};
  char text[200];
  std::snprintf(text, sizeof text,
                "other faces reach up to %.1f mm from its axis, at %.1f mm of the developed length "
                "(a plate, a bracket, a sleeve): left out",
                farthest_mm, farthest.along_mm);
  return {text};
}

}  // namespace bendloop::host
