// SPDX-License-Identifier: Apache-2.0
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <numbers>
#include <optional>
#include <string>
#include <utility>

#include "firmware-host/cad/cad_tube.h"
#include "firmware-host/cad/developed.h"

namespace bendloop::host {
namespace {

using Eigen::Vector3d;
// A hole's faces go all around it, a slot's end half around [deg].
constexpr double kHoleDeg = 330, kLeastSlotEndDeg = 150, kMostSlotEndDeg = 210;

// Cylinder faces of one axis that go through the wall in one place.
struct Bore {
  Vector3d axis, x, y, at;  // `at`: on the axis, in the middle of the wall
  double radius_mm = 0;
  double around_deg = 0;
  std::vector<int> faces;
};

std::vector<Vector3d> BorderOf(const CadBody& body, int face) {
  std::vector<Vector3d> points;
  for (const FaceEdge& edge : body.edges) {
    if (edge.face == face) points.insert(points.end(), edge.points.begin(), edge.points.end());
  }
  return points;
}

// Whether all of the border lies in the wall, and reaches through it.
bool GoesThroughWall(const std::vector<Vector3d>& border, const Developed& developed,
                     const CadTube& tube) {
  const double tolerance = 2 * MatchToleranceMm(tube.pipe_radius_mm);
  const double inner = tube.pipe_radius_mm - *tube.wall_mm;
  double low = std::numeric_limits<double>::infinity(), high = 0;
  for (const Vector3d& p : border) {
    const double across = developed.Of(p).across_mm;
    low = std::min(low, across);
    high = std::max(high, across);
  }
  return !border.empty() && std::abs(low - inner) < tolerance &&
         std::abs(high - tube.pipe_radius_mm) < tolerance;
}

// From where to where along the bore's axis.
std::pair<double, double> ReachOf(const std::vector<Vector3d>& border, const SurfacePatch& patch) {
  double low = std::numeric_limits<double>::infinity(), high = -low;
  for (const Vector3d& p : border) {
    low = std::min(low, (p - patch.origin).dot(patch.axis));
    high = std::max(high, (p - patch.origin).dot(patch.axis));
  }
  return {low, high};
}

bool IsBore(const CadBody& body, const SurfacePatch& patch, const CadTube& tube) {
  return patch.kind == PatchKind::kCylinder && patch.radius_mm < tube.pipe_radius_mm &&
         (body.kind != BodyKind::kSolid || patch.concave);
}

std::vector<Bore> BoresOf(const CadBody& body, const CadTube& tube, const Developed& developed) {
  std::vector<Bore> bores;
  for (const SurfacePatch& patch : body.patches) {
    if (!IsBore(body, patch, tube)) continue;
    const auto border = BorderOf(body, patch.face);
    if (!GoesThroughWall(border, developed, tube)) continue;
    const auto [low, high] = ReachOf(border, patch);
    const Vector3d at = patch.origin + (low + high) / 2 * patch.axis;
    const double around = (patch.u1 - patch.u0) * 180 / std::numbers::pi;
    const auto same = std::find_if(bores.begin(), bores.end(), [&](const Bore& b) {
      return std::abs(b.radius_mm - patch.radius_mm) < 1e-3 &&
             b.axis.cross(patch.axis).norm() < 1e-3 && (b.at - at).cross(b.axis).norm() < 1e-2 &&
             (b.at - at).norm() < *tube.wall_mm + 0.01;
    });
    if (same != bores.end()) {
      same->around_deg += around;
      same->faces.push_back(patch.face);
    } else {
      bores.push_back({patch.axis, patch.x, patch.y, at, patch.radius_mm, around, {patch.face}});
    }
  }
  return bores;
}

WallOpening OpeningAt(const Vector3d& at, double width_mm, const Developed& developed) {
  const Place place = developed.Of(at);
  WallOpening opening;
  opening.along_mm = place.along_mm;
  opening.around_deg = place.around_deg;
  opening.width_mm = width_mm;
  return opening;
}

// Two half bores beside each other with the same axis' direction.
std::optional<WallOpening> SlotOf(const Bore& a, const Bore& b, const CadTube& tube,
                                  const Developed& developed) {
  if (std::abs(a.radius_mm - b.radius_mm) > 1e-3 || a.axis.cross(b.axis).norm() > 1e-3) {
    return std::nullopt;
  }
  const Vector3d gap = b.at - a.at;
  const Vector3d across = gap - gap.dot(a.axis) * a.axis;
  // On the same side of the tube.
  if (developed.Of(a.at).radial.dot(developed.Of(b.at).radial) < 0.5) return std::nullopt;
  if (across.norm() < 1e-3 || across.norm() > 40 * tube.pipe_radius_mm) return std::nullopt;
  const Vector3d middle = (a.at + b.at) / 2;
  WallOpening slot = OpeningAt(middle, 2 * a.radius_mm, developed);
  slot.length_mm = across.norm() + 2 * a.radius_mm;
  const Place place = developed.Of(middle);
  const double axis =
      std::atan2(across.dot(place.radial.cross(place.tangent)), across.dot(place.tangent)) * 180 /
      std::numbers::pi;
  slot.axis_deg = axis > 90 ? axis - 180 : axis <= -90 ? axis + 180 : axis;
  slot.faces = a.faces;
  slot.faces.insert(slot.faces.end(), b.faces.begin(), b.faces.end());
  return slot;
}

// A bore's faces, whose axis they share.
struct OddBore {
  SurfacePatch like;
  double low = 0, high = 0;  // along its axis
  double around_deg = 0;
  bool in_form = false;  // of an end, beyond the plain tube
};

// What leans less than this from the tube's own direction is a bore of its end [cosine].
constexpr double kAlongCosine = 0.98;

// Whether the border lies beyond the plain tube, in the form at an end.
bool LiesInForm(const std::vector<Vector3d>& border, const Developed& developed,
                const CadTube& tube) {
  const double tolerance = MatchToleranceMm(tube.pipe_radius_mm);
  double low = std::numeric_limits<double>::infinity(), high = -low;
  for (const Vector3d& p : border) {
    const double along = developed.Of(p).along_mm;
    low = std::min(low, along);
    high = std::max(high, along);
  }
  const auto is_in = [tolerance](const TubeEnd& end, double farthest_mm) {
    return end.is_plane && end.fitting_mm > tolerance && farthest_mm < end.fitting_mm + tolerance;
  };
  return !border.empty() &&
         (is_in(tube.first, high) || is_in(tube.last, tube.spine.length_mm() - low));
}

// Whether the border begins at the tube's inner surface or ends at its outer one, and not beyond.
bool TouchesWall(const std::vector<Vector3d>& border, const Developed& developed,
                 const CadTube& tube) {
  const double tolerance = 2 * MatchToleranceMm(tube.pipe_radius_mm);
  double nearest = std::numeric_limits<double>::infinity(), farthest = 0;
  for (const Vector3d& p : border) {
    const double across = developed.Of(p).across_mm;
    nearest = std::min(nearest, across);
    farthest = std::max(farthest, across);
  }
  const double inner = tube.pipe_radius_mm - tube.wall_mm.value_or(tube.pipe_radius_mm);
  const bool begins_inside = tube.wall_mm && std::abs(nearest - inner) < tolerance;
  const bool ends_outside = std::abs(farthest - tube.pipe_radius_mm) < tolerance;
  return farthest <= tube.pipe_radius_mm + tolerance && (begins_inside || ends_outside);
}

// Bores across the tube that end at its outer or inner surface, or begin at one, or lie in the form
// at an end, but are none of `openings`.
std::vector<OddBore> OddBoresOf(const CadBody& body, const CadTube& tube,
                                const Developed& developed,
                                const std::vector<WallOpening>& openings) {
  std::vector<OddBore> bores;
  for (const SurfacePatch& patch : body.patches) {
    const bool known = std::any_of(openings.begin(), openings.end(), [&](const WallOpening& o) {
      return std::find(o.faces.begin(), o.faces.end(), patch.face) != o.faces.end();
    });
    if (known || !IsBore(body, patch, tube)) continue;
    const auto border = BorderOf(body, patch.face);
    const bool in_form = LiesInForm(border, developed, tube);
    if (!in_form && !TouchesWall(border, developed, tube)) continue;
    const auto [low, high] = ReachOf(border, patch);
    const Place at = developed.Of(patch.origin + (low + high) / 2 * patch.axis);
    if (std::abs(at.tangent.dot(patch.axis)) > kAlongCosine) continue;
    const double around = (patch.u1 - patch.u0) * 180 / std::numbers::pi;
    const auto same = std::find_if(bores.begin(), bores.end(), [&](const OddBore& b) {
      return std::abs(b.like.radius_mm - patch.radius_mm) < 1e-3 &&
             (b.like.origin - patch.origin).norm() < 1e-3 && b.like.axis.dot(patch.axis) > 1 - 1e-6;
    });
    if (same == bores.end()) {
      bores.push_back({patch, low, high, around, in_form});
    } else {
      same->around_deg += around;
      if (in_form && same->in_form) {
        same->low = std::min(same->low, low);
        same->high = std::max(same->high, high);
      }
    }
  }
  std::erase_if(bores, [](const OddBore& b) { return b.around_deg < kHoleDeg; });
  return bores;
}

// A bore in an end's form, whose mouths lie at no certain distance from the axis.
std::string FormBoreNote(const OddBore& bore, const CadTube& tube, const Developed& developed) {
  const Vector3d& axis = bore.like.axis;
  const Place at = developed.Of(bore.like.origin + (bore.low + bore.high) / 2 * axis);
  const Vector3d foot =
      bore.like.origin + (bore.low + bore.high) / 2 * axis - at.across_mm * at.radial;
  const double middle = (foot - bore.like.origin).dot(axis);
  const auto around = [&](double way) {
    const double deg = developed.Of(foot + way * tube.pipe_radius_mm * axis).around_deg;
    char text[20];
    std::snprintf(text, sizeof text, "%.0f", RoundedTurnDeg(deg, 0));
    return std::string(text);
  };
  const bool up = bore.high > middle, down = bore.low < middle;
  char text[240];
  std::snprintf(text, sizeof text,
                "a bore of %.3f mm goes across the form of the %s end at %.1f mm of the developed "
                "length, towards %s degrees around: the part file does not have it",
                2 * bore.like.radius_mm,
                at.along_mm < tube.spine.length_mm() / 2 ? "first" : "last", at.along_mm,
                (up && down ? around(1) + " and " + around(-1) : around(up ? 1 : -1)).c_str());
  return text;
}

}  // namespace

std::vector<std::string> BoreNotes(const CadBody& body, const CadTube& tube,
                                   const std::vector<WallOpening>& openings) {
  const Developed developed(tube.spine);
  std::vector<std::string> notes;
  for (const OddBore& bore : OddBoresOf(body, tube, developed, openings)) {
    if (bore.in_form) {
      notes.push_back(FormBoreNote(bore, tube, developed));
      continue;
    }
    // A bore through a bar has a mouth on either side; one into it, or into a wall, has one.
    const Place low = developed.Of(bore.like.origin + bore.low * bore.like.axis);
    const Place high = developed.Of(bore.like.origin + bore.high * bore.like.axis);
    const double widest = std::max(low.across_mm, high.across_mm);
    for (const Place* mouth : {&low, &high}) {
      if (mouth->across_mm < widest - tube.pipe_radius_mm / 4) continue;
      char text[200];
      std::snprintf(text, sizeof text,
                    "a bore of %.3f mm at %.1f mm of the developed length, %.0f degrees around, is "
                    "no plain hole through the wall: the part file does not have it",
                    2 * bore.like.radius_mm, mouth->along_mm, RoundedTurnDeg(mouth->around_deg, 0));
      notes.emplace_back(text);
    }
  }
  return notes;
}

std::vector<WallOpening> OpeningsOf(const CadBody& body, const CadTube& tube) {
  std::vector<WallOpening> openings;
  if (!tube.wall_mm) return openings;
  const Developed developed(tube.spine);
  std::vector<Bore> halves;
  for (const Bore& bore : BoresOf(body, tube, developed)) {
    if (bore.around_deg > kHoleDeg) {
      openings.push_back(OpeningAt(bore.at, 2 * bore.radius_mm, developed));
      openings.back().faces = bore.faces;
    } else if (bore.around_deg > kLeastSlotEndDeg && bore.around_deg < kMostSlotEndDeg) {
      halves.push_back(bore);
    }
  }
  while (halves.size() > 1) {
    const Bore a = halves.back();
    halves.pop_back();
    std::size_t best = halves.size();
    std::optional<WallOpening> slot;
    for (std::size_t i = 0; i < halves.size(); ++i) {
      auto with = SlotOf(a, halves[i], tube, developed);
      if (with && (!slot || with->length_mm < slot->length_mm)) {
        slot = with;
        best = i;
      }
    }
    if (!slot) continue;
    openings.push_back(*slot);
    halves.erase(halves.begin() + long(best));
  }
  std::sort(openings.begin(), openings.end(), [](const WallOpening& a, const WallOpening& b) {
    return std::make_pair(a.along_mm, a.around_deg) < std::make_pair(b.along_mm, b.around_deg);
  });
  return openings;
}

}  // namespace bendloop::host
