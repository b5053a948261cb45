// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cad/left_out.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>

#include "firmware-host/cad/developed.h"
#include "firmware-host/cad/form_face.h"
#include "firmware-host/cad/note_text.h"

namespace bendloop::host {
namespace {

using Eigen::Vector3d;

// What goes on begins within so many pipe radii of the end.
constexpr double kGoesOnRadii = 4;
// What is shorter than so many pipe radii is no tube of the list.
constexpr double kTubeRadii = 4;

// How `chain` goes on beyond the end of `view`; empty: it does not.
std::string GoesOnNote(const Spine& chain, const EndView& view, bool is_first, double radius_mm) {
  const Vector3d gap = chain.start - view.origin;
  if (gap.norm() > kGoesOnRadii * radius_mm) return "";
  // Of what the length counts to its end nothing is left out.
  if (view.Along((chain.start + chain.end) / 2) < MatchToleranceMm(radius_mm)) return "";
  const double degrees =
      std::atan2(view.outward.cross(chain.direction).norm(), view.outward.dot(chain.direction)) *
      180 / std::numbers::pi;
  if (degrees > 90) return "";
  // Nothing is not -0.
  const double beyond_mm = std::round(view.Along(chain.start) * 1000) / 1000 + 0.0;
  char text[240];
  std::snprintf(text, sizeof text,
                "%.3f mm of the same diameter begin %.3f mm beside and %.3f mm beyond its %s end, "
                "at %.3f degrees to it: not in the rows",
                chain.length_mm(), view.Across(chain.start), beyond_mm, is_first ? "first" : "last",
                degrees);
  return text;
}

}  // namespace

std::vector<std::string> LeftOutNotes(const CadTube& tube,
                                      const std::vector<const TubeChain*>& others) {
  const double radius = tube.pipe_radius_mm, tolerance = MatchToleranceMm(radius);
  const Developed developed(tube.spine);
  const EndView first{tube.spine.start, tube.spine.OutwardAt(true)};
  const EndView last{tube.spine.end, tube.spine.OutwardAt(false)};
  std::vector<std::string> notes;
  double beside_mm = 0;
  for (const TubeChain* chain : others) {
    if (chain->concave || chain->is_closed || std::abs(chain->radius_mm - radius) > tolerance) {
      continue;
    }
    bool is_told = false;
    for (const Spine& spine : {chain->spine, chain->spine.Reversed()}) {
      for (const EndView* view : {&first, &last}) {
        const std::string note = GoesOnNote(spine, *view, view == &first, radius);
        if (note.empty() || is_told) continue;
        notes.push_back(note);
        is_told = true;
      }
    }
    const double length = chain->spine.length_mm();
    if (is_told || !chain->spine.arcs.empty() || length >= kTubeRadii * radius) continue;
    const bool is_off = developed.Of(chain->spine.start).across_mm > radius + tolerance &&
                        developed.Of(chain->spine.end).across_mm > radius + tolerance;
    if (is_off) beside_mm += length;
  }
  if (beside_mm > 0) {
    notes.push_back(
        NoteText("%.3f mm of the same diameter lie beside it: not in the rows", beside_mm));
  }
  return notes;
}

}  // namespace bendloop::host
