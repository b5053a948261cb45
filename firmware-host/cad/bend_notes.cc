// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cad/bend_notes.h"

#include <numbers>

#include "firmware-host/text/table.h"

namespace bendloop::host {
namespace {

constexpr double kXyzMostDeg = 180 - 1e-6;
constexpr double kFileRoundingMm = 1e-6;
// Clamps are seldom shorter than so many pipe diameters.
constexpr double kClampDiameters = 1;
// Benders with a mandrel hardly go below a centreline radius of so many pipe diameters.
constexpr double kTightDiameters = 1;
// A bend wider than so many pipe radii is rather a straight that bows.
constexpr double kBowRadii = 100;

double BendDeg(const SpineArc& arc) { return arc.angle_rad * 180 / std::numbers::pi; }

// One line, however many they are.
std::string ShortStraights(const CadTube& tube) {
  const auto& arcs = tube.spine.arcs;
  const double least_mm = kClampDiameters * 2 * tube.pipe_radius_mm - kFileRoundingMm;
  std::string which;
  for (std::size_t i = 0; i + 1 < arcs.size(); ++i) {
    if ((arcs[i + 1].from - arcs[i].to).norm() >= least_mm) continue;
    which += (which.empty() ? "" : ", ") + std::to_string(i + 1) + " and " + std::to_string(i + 2);
  }
  return which.empty()
             ? ""
             : "less straight than a pipe diameter, for a clamp between, have bends " + which;
}

// One line, however many they are.
std::string TightBends(const CadTube& tube) {
  const double least_mm = kTightDiameters * 2 * tube.pipe_radius_mm - kFileRoundingMm;
  std::string which;
  for (std::size_t i = 0; i < tube.spine.arcs.size(); ++i) {
    const double radius_mm = tube.spine.arcs[i].bend_radius_mm;
    if (radius_mm >= least_mm) continue;
    which +=
        (which.empty() ? "" : ", ") + std::to_string(i + 1) + " (" + Fixed(radius_mm, 3) + " mm)";
  }
  return which.empty()
             ? ""
             : "tighter than a pipe diameter, as few benders make them, are bends " + which;
}

}  // namespace

std::vector<std::string> BendNotes(const CadTube& tube) {
  std::vector<std::string> notes;
  for (std::size_t i = 0; i < tube.spine.arcs.size(); ++i) {
    const SpineArc& arc = tube.spine.arcs[i];
    const std::string bend = "bend " + std::to_string(i + 1);
    if (BendDeg(arc) >= kXyzMostDeg) {
      notes.push_back(bend + " turns by " + Fixed(BendDeg(arc), 3) +
                      " degrees: XYZ cannot carry 180 and more, LRA and YBC can");
    }
    if (tube.pipe_radius_mm > 0 && arc.bend_radius_mm > kBowRadii * tube.pipe_radius_mm) {
      notes.push_back(bend + " is rather a bow: its radius is " + Fixed(arc.bend_radius_mm, 3) +
                      " mm, over " + Fixed(BendDeg(arc), 3) + " degrees");
    }
  }
  for (const std::string& note : {TightBends(tube), ShortStraights(tube)}) {
    if (!note.empty()) notes.push_back(note);
  }
  return notes;
}

}  // namespace bendloop::host
