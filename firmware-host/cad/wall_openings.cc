// SPDX-License-Identifier: Apache-2.0
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>
#include <optional>
#include <set>
#include <string>
#include <utility>

#include "firmware-host/cad/bore_notes.h"
#include "firmware-host/cad/cad_tube.h"
#include "firmware-host/cad/developed.h"
#include "firmware-host/cad/free_surface.h"
#include "firmware-host/cad/wall_cut.h"

namespace bendloop::host {
namespace {

using Eigen::Vector3d;
constexpr double kDegreesPerRadian = 180 / std::numbers::pi;
// Cylinder faces of a hole, and of both ends of a slot together, go all around [deg].
constexpr double kAllAroundDeg = 330;
// Below this a drill counts as radial: what the coordinates of a file leave of one [deg].
constexpr double kLeastLeanDeg = 0.1;
// The part file holds no drill that leans more.
constexpr double kMostDrillLeanDeg = 60;
// Two faces that were drilled at once: how far their axes are from each other [mm, sine].
constexpr double kSameAxisMm = 1e-2, kSameDrillDirection = 1e-3;

// What a drill or a round end of a slot left: all cylinder faces about one axis.
struct DrilledAxis {
  Vector3d at, axis;
  double radius_mm = 0;
  double around_deg = 0;
};

// Nothing where one of the cut's faces stands into it or is neither plane nor cylinder: that was
// not drilled, or more than drilled.
std::optional<std::vector<DrilledAxis>> AxesOf(const CadBody& body, const WallCut& cut) {
  const std::set<int> faces(cut.faces.begin(), cut.faces.end());
  std::vector<DrilledAxis> axes;
  for (const SurfacePatch& patch : body.patches) {
    if (!faces.contains(patch.face) || IsPlane(patch)) continue;
    const bool stands_into = body.kind == BodyKind::kSolid && !patch.concave;
    if (patch.kind != PatchKind::kCylinder || stands_into) return std::nullopt;
    const double around = (patch.u1 - patch.u0) * kDegreesPerRadian;
    const auto same = std::find_if(axes.begin(), axes.end(), [&](const DrilledAxis& a) {
      return std::abs(a.radius_mm - patch.radius_mm) < kSameAxisMm &&
             a.axis.cross(patch.axis).norm() < kSameDrillDirection &&
             (patch.origin - a.at).cross(a.axis).norm() < kSameAxisMm;
    });
    if (same == axes.end()) {
      axes.push_back({patch.origin, patch.axis, patch.radius_mm, around});
    } else {
      same->around_deg += around;
    }
  }
  return axes;
}

// Whether the border on the outer surface, seen along the axis, lies as far from the line between
// both middles as the drill is wide, and nothing of the cut lies farther. What the drill left
// below, where it ended in the wall, lies nearer.
bool IsAsDrilled(const WallCut& cut, const Vector3d& axis, const Vector3d& from, const Vector3d& to,
                 double radius_mm) {
  const double within = 0.02 + 2e-3 * radius_mm;
  const auto flat = [&](const Vector3d& v) -> Vector3d { return v - v.dot(axis) * axis; };
  const Vector3d line = flat(to - from);
  const auto off = [&](const Vector3d& p) {
    const Vector3d d = flat(p - from);
    const double length2 = line.squaredNorm();
    const double part = length2 > 0 ? std::clamp(d.dot(line) / length2, 0.0, 1.0) : 0.0;
    return (d - part * line).norm() - radius_mm;
  };
  return std::all_of(cut.outer.begin(), cut.outer.end(),
                     [&](const Vector3d& p) { return std::abs(off(p)) < within; }) &&
         std::all_of(cut.border.begin(), cut.border.end(),
                     [&](const Vector3d& p) { return off(p) < within; });
}

double MeanAlong(const std::vector<Vector3d>& points, const Vector3d& at, const Vector3d& axis) {
  double sum = 0;
  for (const Vector3d& p : points) sum += (p - at).dot(axis);
  return sum / double(points.size());
}

// Where the line from `at` along `way` leaves the outer surface; nothing where it stays in the
// wall. It begins where the drill meets the inner one.
std::optional<Vector3d> LeavesAt(const Vector3d& at, const Vector3d& way, const CadTube& tube,
                                 const Developed& developed) {
  constexpr double kStepRadii = 0.02, kReachRadii = 3;
  const double radius = tube.pipe_radius_mm, step = kStepRadii * radius;
  const auto is_inside = [&](double on_mm) {
    return developed.Of(at + on_mm * way).across_mm < radius;
  };
  double low = 0;
  while (!is_inside(low) && low > -kReachRadii * radius) low -= step;
  double high = low;
  while (is_inside(high) && high < kReachRadii * radius) high += step;
  if (!is_inside(low) || is_inside(high)) return std::nullopt;
  low = std::max(low, high - step);
  constexpr int kHalvings = 40;
  for (int i = 0; i < kHalvings; ++i) (is_inside((low + high) / 2) ? low : high) = (low + high) / 2;
  return at + low * way;
}

// Of a slot: from the feed direction, right-handed about the outward normal, (-90, 90].
double AxisDeg(const Vector3d& length, const Place& place) {
  const double axis =
      std::atan2(length.dot(place.radial.cross(place.tangent)), length.dot(place.tangent)) *
      kDegreesPerRadian;
  constexpr double kRoundingDeg = 1e-4;  // half a turn is 90 to what a file's rounding leaves
  return axis > 90 + kRoundingDeg ? axis - 180 : axis <= -90 + kRoundingDeg ? axis + 180 : axis;
}

// The hole or slot that a cut is, if it is one.
std::optional<WallOpening> OpeningOf(const CadBody& body, const WallCut& cut, const CadTube& tube,
                                     const Developed& developed) {
  if (!cut.is_through) return std::nullopt;
  const auto axes = AxesOf(body, cut);
  if (!axes || axes->empty() || axes->size() > 2) return std::nullopt;
  const DrilledAxis &a = axes->front(), &b = axes->back();
  if (a.axis.cross(b.axis).norm() > kSameDrillDirection ||
      std::abs(a.radius_mm - b.radius_mm) > kSameAxisMm) {
    return std::nullopt;
  }
  const double around = a.around_deg + (axes->size() == 2 ? b.around_deg : 0);
  if (around < kAllAroundDeg || !IsAsDrilled(cut, a.axis, a.at, b.at, a.radius_mm)) {
    return std::nullopt;
  }
  const Vector3d gap = b.at - a.at, across = gap - gap.dot(a.axis) * a.axis;
  const Vector3d on_axis = a.at + across / 2;
  const double in = MeanAlong(cut.inner, on_axis, a.axis);
  const double out = MeanAlong(cut.outer, on_axis, a.axis);
  const Vector3d way = out > in ? a.axis : Vector3d(-a.axis);
  const auto at = LeavesAt(on_axis + in * a.axis, way, tube, developed);
  if (!at) return std::nullopt;
  const Place place = developed.Of(*at);
  WallOpening opening;
  opening.along_mm = place.along_mm;
  opening.around_deg = place.around_deg;
  opening.width_mm = 2 * a.radius_mm;
  const double outward = way.dot(place.radial);
  opening.lean_along_deg = std::atan2(way.dot(place.tangent), outward) * kDegreesPerRadian;
  opening.lean_around_deg =
      std::atan2(way.dot(place.tangent.cross(place.radial)), outward) * kDegreesPerRadian;
  if (std::max(std::abs(opening.lean_along_deg), std::abs(opening.lean_around_deg)) >
      kMostDrillLeanDeg) {
    return std::nullopt;
  }
  if (opening.lean_deg() < kLeastLeanDeg) opening.lean_along_deg = opening.lean_around_deg = 0;
  if (axes->size() == 2) {
    opening.length_mm = across.norm() + opening.width_mm;
    opening.axis_deg = AxisDeg(across, place);
  }
  opening.faces = cut.faces;
  return opening;
}

// What is no hole and no slot, in words: nothing that was cut is dropped without any.
std::string OddCutNote(const WallCut& cut) {
  char text[240];
  std::snprintf(text, sizeof text,
                "%s of %.1f mm along by %.1f mm around at %.1f mm of the developed length, %.0f "
                "degrees around, %s: the part file does not have it",
                cut.is_through ? "an opening" : "a recess", cut.along_mm, cut.around_mm,
                cut.middle.along_mm, RoundedTurnDeg(cut.middle.around_deg, 0),
                cut.is_through ? "is no plain hole or slot" : "does not go through the wall");
  return text;
}

// A dent is drawn as free surfaces; it is none that was cut.
bool HasFreeFaces(const CadBody& body, const WallCut& cut) {
  return std::any_of(body.patches.begin(), body.patches.end(), [&](const SurfacePatch& patch) {
    return patch.kind == PatchKind::kFree && patch.name != "cone" &&
           std::find(cut.faces.begin(), cut.faces.end(), patch.face) != cut.faces.end();
  });
}

}  // namespace

double WallOpening::lean_deg() const {
  const double along = std::tan(lean_along_deg / kDegreesPerRadian);
  const double around = std::tan(lean_around_deg / kDegreesPerRadian);
  return std::atan(std::hypot(along, around)) * kDegreesPerRadian;
}

Openings OpeningsOf(const CadBody& body, const CadTube& tube) {
  const Developed developed(tube.spine);
  Openings found;
  std::vector<WallCut> odd;
  for (const WallCut& cut : WallCutsOf(body, tube, developed)) {
    if (auto opening = OpeningOf(body, cut, tube, developed)) {
      found.openings.push_back(std::move(*opening));
    } else {
      odd.push_back(cut);
    }
  }
  std::sort(
      found.openings.begin(), found.openings.end(), [](const WallOpening& a, const WallOpening& b) {
        return std::make_pair(a.along_mm, a.around_deg) < std::make_pair(b.along_mm, b.around_deg);
      });
  std::set<int> known;
  for (const WallOpening& opening : found.openings) {
    known.insert(opening.faces.begin(), opening.faces.end());
  }
  found.notes = BoreNotes(body, tube, known);
  for (const WallCut& cut : odd) {
    const bool told = std::any_of(cut.faces.begin(), cut.faces.end(),
                                  [&](int face) { return known.contains(face); });
    if (told || (!cut.is_through && HasFreeFaces(body, cut))) continue;
    found.notes.push_back(OddCutNote(cut));
  }
  return found;
}

}  // namespace bendloop::host
