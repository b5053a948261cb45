// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cad/cad_tube.h"

#include <algorithm>
#include <utility>

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
  tube.openings = OpeningsOf(body, tube);
  CadTube back = tube;
  back.spine = tube.spine.Reversed();
  tube.openings_reversed = OpeningsOf(body, back);
}

}  // namespace

void BeginNearOrigin(CadTube& tube) {
  if (!StartsAtItsEnd(tube.spine)) return;
  tube.spine = tube.spine.Reversed();
  std::swap(tube.first, tube.last);
}

std::vector<CadTube> TubesOf(CadShape& shape) {
  std::vector<CadTube> tubes;
  for (std::size_t i = 0; i < shape.bodies.size(); ++i) {
    CadBody& body = shape.bodies[i];
    auto found = body.kind == BodyKind::kWire ? TubesOfCurves(body) : TubesOfSurfaces(body);
    for (CadTube& tube : found) {
      tube.body = i;
      tube.name = body.name;
      BeginNearOrigin(tube);
      if (tube.problems.empty() && !tube.is_wire) FindOpenings(body, tube);
      tubes.push_back(std::move(tube));
    }
  }
  return tubes;
}

}  // namespace bendloop::host
