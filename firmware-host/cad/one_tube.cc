// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cad/one_tube.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>
#include <utility>

#include "firmware-host/cad/developed.h"
#include "firmware-host/cad/note_text.h"
#include "hal/bend_program.h"
#include "pipeline/tube/representations.h"

namespace bendloop::host {
namespace {

// Rows of one part differ by less than this [mm, degrees], however it is turned in its assembly.
constexpr double kSameRow = 1e-3;

bool SameNumber(double a, double b) { return std::abs(a - b) < kSameRow; }

bool SameRows(const hal::BendProgram& a, const hal::BendProgram& b) {
  return std::equal(a.rows.begin(), a.rows.end(), b.rows.begin(), b.rows.end(),
                    [](const hal::BendRow& r, const hal::BendRow& s) {
                      return SameNumber(r.length_mm, s.length_mm) &&
                             SameNumber(r.angle_deg, s.angle_deg) &&
                             SameNumber(hal::WrapRotationDeg(r.rotation_deg - s.rotation_deg), 0) &&
                             SameNumber(r.bend_radius_mm.value_or(0), s.bend_radius_mm.value_or(0));
                    });
}

bool SameOpenings(const std::vector<WallOpening>& a, const std::vector<WallOpening>& b) {
  return std::equal(
      a.begin(), a.end(), b.begin(), b.end(), [](const WallOpening& o, const WallOpening& p) {
        return SameNumber(o.along_mm, p.along_mm) && SameNumber(o.width_mm, p.width_mm) &&
               SameNumber(o.length_mm, p.length_mm) && SameNumber(o.lean_deg(), p.lean_deg());
      });
}

bool SameEnd(const TubeEnd& a, const TubeEnd& b) {
  return a.is_plane == b.is_plane && a.cover == b.cover &&
         SameNumber(a.oblique_deg, b.oblique_deg) && SameNumber(a.fitting_mm, b.fitting_mm);
}

// Whether the centre line of `inner` is that of `outer`, but for where it ends.
bool OneCentreLine(const CadTube& inner, const CadTube& outer) {
  const double tolerance = MatchToleranceMm(outer.pipe_radius_mm);
  const auto& a = inner.spine.arcs;
  const auto& b = outer.spine.arcs;
  const auto same = [&](const SpineArc& p, const SpineArc& q) {
    return (p.centre - q.centre).norm() < tolerance &&
           std::abs(p.bend_radius_mm - q.bend_radius_mm) < tolerance;
  };
  if (a.empty() || a.size() != b.size()) return false;
  return std::equal(a.begin(), a.end(), b.begin(), same) ||
         std::equal(a.rbegin(), a.rend(), b.begin(), same);
}

// Whether `inner` was taken into `outer`.
bool Take(const CadTube& inner, CadTube& outer) {
  if (inner.is_wire || outer.is_wire || inner.wall_mm || !OneCentreLine(inner, outer)) return false;
  if (!inner.problems.empty() || !outer.problems.empty()) return false;
  const double tolerance = MatchToleranceMm(outer.pipe_radius_mm);
  if (inner.pipe_radius_mm >= outer.pipe_radius_mm - tolerance) return false;
  if (!outer.wall_mm) {
    outer.wall_mm = outer.pipe_radius_mm - inner.pipe_radius_mm;
    outer.notes.push_back(
        NoteText("its bore is a body of its own, %.3f mm in diameter", 2 * inner.pipe_radius_mm));
    return true;
  }
  if (inner.pipe_radius_mm > outer.pipe_radius_mm - *outer.wall_mm + tolerance) return false;
  outer.notes.push_back(NoteText("a body of %.3f mm in diameter lies in its bore: left out",
                                 2 * inner.pipe_radius_mm));
  return true;
}

}  // namespace

bool IsSamePart(const CadTube& a, const CadTube& b) {
  if (!SameNumber(a.pipe_radius_mm, b.pipe_radius_mm) ||
      a.wall_mm.has_value() != b.wall_mm.has_value() ||
      !SameNumber(a.wall_mm.value_or(0), b.wall_mm.value_or(0))) {
    return false;
  }
  const auto rows = TubeFromSpine(a.spine, a.pipe_radius_mm).program;
  const auto others = TubeFromSpine(b.spine, b.pipe_radius_mm).program;
  return (SameRows(rows, others) && SameEnd(a.first, b.first) && SameEnd(a.last, b.last) &&
          SameOpenings(a.openings, b.openings)) ||
         (SameRows(rows, pipeline::ReverseProgram(others)) && SameEnd(a.first, b.last) &&
          SameEnd(a.last, b.first) && SameOpenings(a.openings, b.openings_reversed));
}

std::string CentreLineNote(const std::vector<CadTube>& tubes, const CadTube& tube) {
  const Developed developed(tube.spine);
  const auto goes_along = [&](const CadTube& line) {
    return std::all_of(line.spine.arcs.begin(), line.spine.arcs.end(), [&](const SpineArc& arc) {
      return developed.Of(arc.from).across_mm < tube.pipe_radius_mm &&
             developed.Of(arc.to).across_mm < tube.pipe_radius_mm;
    });
  };
  for (const CadTube& line : tubes) {
    if (tube.is_wire || !line.is_wire || !line.problems.empty() || !line.is_bent()) continue;
    const bool agrees = OneCentreLine(line, tube);
    if (!agrees && !goes_along(line)) continue;
    char text[160];
    std::snprintf(text, sizeof text,
                  "the file has its centre line, too, with %s bends: %.3f mm long beside %.3f mm "
                  "of the tube",
                  agrees ? "the same" : "other", line.spine.length_mm(), tube.spine.length_mm());
    return text;
  }
  return "";
}

void TakeInnerBodies(std::vector<CadTube>& tubes) {
  std::vector<bool> taken(tubes.size(), false);
  for (std::size_t i = 0; i < tubes.size(); ++i) {
    for (std::size_t j = 0; j < tubes.size() && !taken[i]; ++j) {
      if (i != j && !taken[j]) taken[i] = Take(tubes[i], tubes[j]);
    }
  }
  std::vector<CadTube> kept;
  for (std::size_t i = 0; i < tubes.size(); ++i) {
    if (!taken[i]) kept.push_back(std::move(tubes[i]));
  }
  tubes = std::move(kept);
}

}  // namespace bendloop::host
