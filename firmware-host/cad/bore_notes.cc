// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cad/bore_notes.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <map>
#include <numbers>
#include <utility>

#include "firmware-host/cad/developed.h"

namespace bendloop::host {
namespace {

using Eigen::Vector3d;
// A bore's faces go all around it [deg].
constexpr double kHoleDeg = 330;

std::vector<Vector3d> BorderOf(const CadBody& body, int face) {
  std::vector<Vector3d> points;
  for (const FaceEdge& edge : body.edges) {
    if (edge.face == face) points.insert(points.end(), edge.points.begin(), edge.points.end());
  }
  return points;
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

// A bore's faces, whose axis they share.
struct OddBore {
  SurfacePatch like;
  double low = 0, high = 0;  // along its axis
  double around_deg = 0;
  bool in_form = false;  // of an end, beyond the plain tube
  std::vector<int> faces;
};

// What leans less than this from the tube's own direction is a bore of its end [cosine].
constexpr double kAlongTubeCosine = 0.98;

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
// at an end, but are none of `known`.
std::vector<OddBore> OddBoresOf(const CadBody& body, const CadTube& tube,
                                const Developed& developed, const std::set<int>& known) {
  std::vector<OddBore> bores;
  for (const SurfacePatch& patch : body.patches) {
    if (known.contains(patch.face) || !IsBore(body, patch, tube)) continue;
    const auto border = BorderOf(body, patch.face);
    const bool in_form = LiesInForm(border, developed, tube);
    if (!in_form && !TouchesWall(border, developed, tube)) continue;
    const auto [low, high] = ReachOf(border, patch);
    const Place at = developed.Of(patch.origin + (low + high) / 2 * patch.axis);
    if (std::abs(at.tangent.dot(patch.axis)) > kAlongTubeCosine) continue;
    const double around = (patch.u1 - patch.u0) * 180 / std::numbers::pi;
    const auto same = std::find_if(bores.begin(), bores.end(), [&](const OddBore& b) {
      return std::abs(b.like.radius_mm - patch.radius_mm) < 1e-3 &&
             (b.like.origin - patch.origin).norm() < 1e-3 && b.like.axis.dot(patch.axis) > 1 - 1e-6;
    });
    if (same == bores.end()) {
      bores.push_back({patch, low, high, around, in_form, {patch.face}});
    } else {
      same->around_deg += around;
      same->faces.push_back(patch.face);
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

// Bores beside the tube in the form or flange of an end and along it, as for bolts: how many of
// each diameter.
std::vector<std::string> FlangeNotes(const CadBody& body, const CadTube& tube,
                                     const Developed& developed, std::set<int>& known) {
  std::vector<OddBore> bores;
  for (const SurfacePatch& patch : body.patches) {
    if (known.contains(patch.face) || !IsBore(body, patch, tube)) continue;
    const auto border = BorderOf(body, patch.face);
    if (!LiesInForm(border, developed, tube)) continue;
    const auto [low, high] = ReachOf(border, patch);
    const Place at = developed.Of(patch.origin + (low + high) / 2 * patch.axis);
    if (std::abs(at.tangent.dot(patch.axis)) <= kAlongTubeCosine ||
        at.across_mm < tube.pipe_radius_mm + patch.radius_mm) {
      continue;
    }
    const double around = (patch.u1 - patch.u0) * 180 / std::numbers::pi;
    const auto same = std::find_if(bores.begin(), bores.end(), [&](const OddBore& b) {
      return std::abs(b.like.radius_mm - patch.radius_mm) < 1e-3 &&
             (b.like.origin - patch.origin).cross(patch.axis).norm() < 1e-2;
    });
    if (same == bores.end()) {
      bores.push_back({patch, low, high, around, true, {patch.face}});
    } else {
      same->around_deg += around;
      same->faces.push_back(patch.face);
    }
  }
  std::map<std::pair<bool, long>, int> counts;  // by the end, and the diameter in um
  for (const OddBore& bore : bores) {
    if (bore.around_deg < kHoleDeg) continue;
    const Place at = developed.Of(bore.like.origin + (bore.low + bore.high) / 2 * bore.like.axis);
    const bool is_last = at.along_mm > tube.spine.length_mm() / 2;
    ++counts[{is_last, std::lround(2000 * bore.like.radius_mm)}];
    known.insert(bore.faces.begin(), bore.faces.end());
  }
  std::vector<std::string> notes;
  for (const auto& [what, count] : counts) {
    char text[200];
    std::snprintf(text, sizeof text,
                  "%d %s of %.3f mm along the tube in the flange at the %s end: the part file does "
                  "not have %s",
                  count, count == 1 ? "bore" : "bores", double(what.second) / 1000,
                  what.first ? "last" : "first", count == 1 ? "it" : "them");
    notes.emplace_back(text);
  }
  return notes;
}

}  // namespace

std::vector<std::string> BoreNotes(const CadBody& body, const CadTube& tube, std::set<int>& known) {
  const Developed developed(tube.spine);
  std::vector<std::string> notes;
  for (const OddBore& bore : OddBoresOf(body, tube, developed, known)) {
    known.insert(bore.faces.begin(), bore.faces.end());
    if (bore.in_form) {
      notes.push_back(FormBoreNote(bore, tube, developed));
      continue;
    }
    // A bore through a bar has a mouth on either side; one into it, or into a wall, has one.
    const Place low = developed.Of(bore.like.origin + bore.low * bore.like.axis);
    const Place high = developed.Of(bore.like.origin + bore.high * bore.like.axis);
    const double widest = std::max(low.across_mm, high.across_mm);
    const bool one_side = low.radial.dot(high.radial) > 0;
    const Place* outer = low.across_mm > high.across_mm ? &low : &high;
    for (const Place* mouth : {&low, &high}) {
      if (mouth->across_mm < widest - tube.pipe_radius_mm / 4) continue;
      if (one_side && mouth != outer) continue;
      char text[200];
      std::snprintf(text, sizeof text,
                    "a bore of %.3f mm at %.1f mm of the developed length, %.0f degrees around, is "
                    "no plain hole through the wall: the part file does not have it",
                    2 * bore.like.radius_mm, mouth->along_mm, RoundedTurnDeg(mouth->around_deg, 0));
      notes.emplace_back(text);
    }
  }
  for (std::string& note : FlangeNotes(body, tube, developed, known)) {
    notes.push_back(std::move(note));
  }
  return notes;
}

}  // namespace bendloop::host
