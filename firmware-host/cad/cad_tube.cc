// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cad/cad_tube.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <utility>

#include "firmware-host/cad/end_to_end.h"
#include "firmware-host/cad/one_tube.h"

namespace bendloop::host {
namespace {

// Ends as far from the origin as each other, to this [mm]: the one with the smaller x, y, z.
constexpr double kAsFarMm = 1e-3;

bool StartsAtItsEnd(const Spine& spine) {
  const double start = spine.start.norm(), end = spine.end.norm();
  if (std::abs(start - end) > kAsFarMm) return end < start;
  for (int k = 0; k < 3; ++k) {
    if (std::abs(spine.start(k) - spine.end(k)) > kAsFarMm) return spine.end(k) < spine.start(k);
  }
  return false;
}

// What is around is counted from another bend when it is seen from the other end.
void FindOpenings(const CadBody& body, CadTube& tube) {
  CadTube back = tube;
  back.spine = tube.spine.Reversed();
  std::swap(back.first, back.last);
  const auto take = [](Openings found, std::vector<WallOpening>& openings,
                       std::vector<std::string>& notes) {
    openings = std::move(found.openings);
    notes.insert(notes.end(), found.notes.begin(), found.notes.end());
  };
  take(OpeningsOf(body, tube), tube.openings, tube.placed_notes);
  take(OpeningsOf(body, back), tube.openings_reversed, tube.placed_notes_reversed);
}

hal::EndCut CutOfEnd(const CadTube& tube, bool is_first) {
  const TubeEnd& end = is_first ? tube.first : tube.last;
  if (!end.is_plane || end.oblique_deg == 0) return {};
  return {end.oblique_deg, AroundEndDeg(tube, is_first, end.longest)};
}

}  // namespace

// Zero is the normal of the bend beside the straight, as hal::AroundZero has it.
double AroundEndDeg(const CadTube& tube, bool is_first, const Eigen::Vector3d& across) {
  const Spine& spine = tube.spine;
  const Eigen::Vector3d zero = spine.arcs.empty()
                                   ? Eigen::Vector3d(spine.direction.unitOrthogonal())
                               : is_first ? spine.arcs.front().normal
                                          : spine.arcs.back().normal;
  return hal::AroundDeg(zero, is_first ? spine.direction : spine.end_direction(), across);
}

hal::EndCut FirstCut(const CadTube& tube) { return CutOfEnd(tube, true); }

hal::EndCut LastCut(const CadTube& tube) { return CutOfEnd(tube, false); }

void BeginNearOrigin(CadTube& tube) {
  if (!StartsAtItsEnd(tube.spine)) return;
  tube.spine = tube.spine.Reversed();
  std::swap(tube.first, tube.last);
  std::swap(tube.placed_notes, tube.placed_notes_reversed);
}

std::vector<CadTube> TubesOf(CadShape& shape) {
  std::vector<CadTube> tubes;
  for (std::size_t i = 0; i < shape.bodies.size(); ++i) {
    CadBody& body = shape.bodies[i];
    auto found = body.kind == BodyKind::kWire ? TubesOfCurves(body) : TubesOfSurfaces(body);
    for (CadTube& tube : found) {
      body.has_tube |= !tube.is_ring;
      tube.body = i;
      tube.name = body.name;
      tube.occurrence = body.occurrence;
      if (body.joined > 1) {
        tube.notes.push_back("the file has it as " + std::to_string(body.joined) +
                             " bodies, end to end");
      }
      if (body.repeated > 0) {
        tube.notes.push_back("the file has it in the same place again, so many times: " +
                             std::to_string(body.repeated));
      }
      BeginNearOrigin(tube);
      if (tube.problems.empty() && !tube.is_wire) FindOpenings(body, tube);
      tubes.push_back(std::move(tube));
    }
  }
  const auto is_ring = [](const CadTube& tube) { return tube.is_ring; };
  // Beside a tube they are seals and beads.
  if (!std::all_of(tubes.begin(), tubes.end(), is_ring)) std::erase_if(tubes, is_ring);
  TakeInnerBodies(tubes);
  NoteEndToEnd(tubes);
  return tubes;
}

}  // namespace bendloop::host
