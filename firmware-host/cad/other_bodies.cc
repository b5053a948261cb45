// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cad/other_bodies.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <optional>

#include "firmware-host/cad/form_face.h"
#include "firmware-host/console/printable.h"

namespace bendloop::host {
namespace {

// What lies farther beyond an end than so many pipe radii is not on it.
constexpr double kOnEndRadii = 4;
// What reaches farther beyond it and has a tube's surface is a tube, and no sleeve.
constexpr double kFarthestRadii = 20;
// Axes that lean less than this are one direction [rad].
constexpr double kOneAxisRad = 1e-3;

// A body about an end's axis.
struct OnEnd {
  std::string name;
  bool is_first = false;
  Reach reach;  // along the axis, outwards from the end
};

struct TubeEndView {
  EndView view;
  double straight_mm = 0;  // the straight that ends there
};

TubeEndView EndViewOf(const Spine& spine, bool is_first) {
  const Eigen::Vector3d& inner = spine.arcs.empty() ? (is_first ? spine.end : spine.start)
                                 : is_first         ? spine.arcs.front().from
                                                    : spine.arcs.back().to;
  const Eigen::Vector3d& end = is_first ? spine.start : spine.end;
  return {{end, spine.OutwardAt(is_first)}, (end - inner).norm()};
}

bool IsAboutEnd(const CadBody& body, const EndView& view, double tolerance_mm) {
  return std::any_of(body.patches.begin(), body.patches.end(), [&](const SurfacePatch& patch) {
    return patch.kind != PatchKind::kFree && patch.axis.cross(view.outward).norm() < kOneAxisRad &&
           view.Across(patch.origin) < tolerance_mm;
  });
}

Reach ReachOfBody(const CadBody& body, const EndView& view) {
  Reach reach;
  for (const FaceEdge& edge : body.edges) reach.Add(ReachOf(edge, view));
  for (const SurfacePatch& patch : body.patches) {
    for (const OrientedPoint& s : patch.samples) {
      if (s.in_face) reach.Add(view.Along(s.point), view.Across(s.point));
    }
  }
  return reach;
}

// Of tubes straight ones alone may sit on an end, and what has a free form: nuts do.
bool MayBeSleeve(const std::vector<CadTube>& tubes, std::size_t body) {
  bool may_be = false;
  for (const CadTube& tube : tubes) {
    if (tube.body != body) continue;
    if (tube.is_bent()) return false;
    may_be |= tube.problems.empty() || tube.is_free_form();
  }
  return may_be;
}

std::optional<OnEnd> OnEndOf(const CadBody& body, const CadTube& tube) {
  const double radius = tube.pipe_radius_mm;
  std::optional<OnEnd> best;
  for (const bool is_first : {true, false}) {
    const auto [view, straight_mm] = EndViewOf(tube.spine, is_first);
    if (!IsAboutEnd(body, view, 4 * MatchToleranceMm(radius))) continue;
    const Reach reach = ReachOfBody(body, view);
    // A hose that is a free form begins there, too, and goes on.
    const bool is_near = reach.lowest < kOnEndRadii * radius && reach.highest > -straight_mm &&
                         (!body.has_tube || reach.highest < kFarthestRadii * radius);
    const auto off = [](const Reach& r) { return std::abs(r.lowest + r.highest); };
    if (!is_near || (best && off(best->reach) <= off(reach))) continue;
    best = {body.name, is_first, reach};
  }
  return best;
}

// A solid and the quilt of its thread are one part.
void AddOnEnd(std::vector<OnEnd>& on_ends, const OnEnd& on) {
  const auto same = std::find_if(on_ends.begin(), on_ends.end(), [&](const OnEnd& o) {
    return o.name == on.name && o.is_first == on.is_first && o.reach.lowest <= on.reach.highest &&
           on.reach.lowest <= o.reach.highest;
  });
  if (same == on_ends.end()) {
    on_ends.push_back(on);
  } else {
    same->reach.Add(on.reach);
  }
}

std::string OnEndText(const OnEnd& on, bool is_first) {
  const auto place = [](double along_mm) {
    char text[60];
    std::snprintf(text, sizeof text, "%.1f mm %s it", std::abs(along_mm),
                  along_mm > 0 ? "beyond" : "before");
    return std::string(text);
  };
  char wide[60];
  std::snprintf(wide, sizeof wide, "%.1f mm in diameter", 2 * on.reach.widest);
  return (on.name.empty() ? "another body" : "'" + Printable(on.name) + "'") + " sits on the " +
         (is_first ? "first" : "last") + " end, from " + place(on.reach.lowest) + " to " +
         place(on.reach.highest) + ", up to " + wide + ": left out";
}

}  // namespace

OtherBodyNotes NotesOfOtherBodies(const CadShape& shape, const std::vector<CadTube>& tubes,
                                  const CadTube& tube) {
  std::vector<OnEnd> on_ends;
  std::size_t others = 0;
  for (std::size_t i = 0; i < shape.bodies.size(); ++i) {
    const CadBody& body = shape.bodies[i];
    if (i == tube.body || body.kind == BodyKind::kWire) continue;
    if (body.has_tube && !MayBeSleeve(tubes, i)) continue;
    const auto on = OnEndOf(body, tube);
    if (on) AddOnEnd(on_ends, *on);
    if (!on && !body.has_tube) ++others;
  }
  std::stable_sort(on_ends.begin(), on_ends.end(),
                   [](const OnEnd& a, const OnEnd& b) { return a.is_first > b.is_first; });
  OtherBodyNotes notes;
  for (const OnEnd& on : on_ends) {
    notes.placed.push_back(OnEndText(on, on.is_first));
    notes.placed_reversed.push_back(OnEndText(on, !on.is_first));
  }
  if (others > 0) {
    notes.notes.push_back(std::to_string(others) +
                          (others == 1 ? " other body, left out" : " other bodies, left out"));
  }
  return notes;
}

}  // namespace bendloop::host
