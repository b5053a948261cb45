// SPDX-License-Identifier: Apache-2.0
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>
#include <utility>

#include "firmware-host/cad/cad_tube.h"
#include "firmware-host/cad/developed.h"
#include "firmware-host/cad/free_surface.h"
#include "firmware-host/cad/note_text.h"

namespace bendloop::host {
namespace {

using Eigen::Vector3d;
using Points = std::vector<Vector3d>;

// A profile's circle lies about an end of the centre line, and across it.
struct Profile {
  Vector3d centre, normal;
  double radius_mm = 0;
};

std::optional<TubePiece> LineThrough(const Points& points) {
  const Vector3d d = points.back() - points.front();
  if (d.norm() < kExactSurfaceMm) return std::nullopt;
  TubePiece line;
  line.origin = points.front();
  line.axis = d.normalized();
  line.x = line.axis.unitOrthogonal();
  line.to = d.norm();
  for (const Vector3d& p : points) {
    if ((p - line.origin).cross(line.axis).norm() > kExactSurfaceMm) return std::nullopt;
  }
  return line;
}

// The circle through the first, the middle and the last point but one, on which the others lie.
std::optional<TubePiece> ArcThrough(const Points& points) {
  if (points.size() < 5) return std::nullopt;
  const Vector3d a = points.front(), b = points[points.size() / 2], c = points[points.size() - 2];
  const Vector3d u = b - a, v = c - a, n = u.cross(v);
  if (n.norm() < 1e-12 * u.norm() * v.norm() || n.norm() == 0) return std::nullopt;
  TubePiece arc;
  arc.is_arc = true;
  arc.origin =
      a + (u.squaredNorm() * v.cross(n) + v.squaredNorm() * n.cross(u)) / (2 * n.squaredNorm());
  arc.axis = n.normalized();
  arc.bend_radius_mm = (a - arc.origin).norm();
  arc.x = (a - arc.origin) / arc.bend_radius_mm;
  const Vector3d y = arc.axis.cross(arc.x);
  double before = 0;
  for (const Vector3d& p : points) {
    const Vector3d d = p - arc.origin;
    const double off = std::hypot(d.norm() - arc.bend_radius_mm, d.dot(arc.axis));
    if (off > kExactSurfaceMm) return std::nullopt;
    const double angle = std::atan2(d.dot(y), d.dot(arc.x));
    arc.to += std::remainder(angle - before, 2 * std::numbers::pi);
    before = angle;
  }
  if (arc.to < 0) return std::nullopt;  // it turns back
  return arc;
}

// The circle that is drawn about an end is the pipe; two are its outside and inside.
void TakeProfiles(const std::vector<Profile>& profiles, CadTube& tube) {
  std::vector<double> radii;
  for (const Profile& p : profiles) {
    const bool at_start = (p.centre - tube.spine.start).norm() < MatchToleranceMm(p.radius_mm) &&
                          p.normal.cross(tube.spine.direction).norm() < 1e-3;
    const bool at_end = (p.centre - tube.spine.end).norm() < MatchToleranceMm(p.radius_mm) &&
                        p.normal.cross(tube.spine.end_direction()).norm() < 1e-3;
    if (at_start || at_end) radii.push_back(p.radius_mm);
  }
  if (radii.empty()) return;
  const auto [low, high] = std::minmax_element(radii.begin(), radii.end());
  tube.pipe_radius_mm = *high;
  if (*high - *low > 1e-3) tube.wall_mm = *high - *low;
}

std::string KinkText(double angle_deg) {
  return NoteText("its lines meet in a corner of %.3f degrees without an arc", angle_deg);
}

// Lines that meet in corners are one tube's polygon, drawn without its bends.
void KeepOnePolygon(std::vector<CadTube>& tubes) {
  const auto is_side = [](const CadTube& t) { return !t.is_bent() && !t.problems.empty(); };
  if (tubes.size() < 2 || !std::all_of(tubes.begin(), tubes.end(), is_side)) return;
  const std::size_t sides = tubes.size();
  const auto longest = std::max_element(
      tubes.begin(), tubes.end(),
      [](const CadTube& a, const CadTube& b) { return a.spine.length_mm() < b.spine.length_mm(); });
  CadTube polygon = *longest;
  polygon.problems = {"its " + std::to_string(sides) +
                      " lines meet in corners without arcs: round them in CAD by the bend radius, "
                      "or give their corners to `bendloop convert` as XYZ, with --bend-radius"};
  tubes.assign(1, polygon);
}

// Lines and arcs beside other curves are no tube of their own.
CadTube FreeCurve(const Points& first, std::size_t free, std::size_t all) {
  CadTube tube;
  tube.is_wire = true;
  tube.spine.start = tube.spine.end = Vector3d::Zero();
  tube.spine.direction = Vector3d::UnitX();
  tube.problems.push_back(all == 1 ? "its curve is no line and no arc"
                                   : std::to_string(free) + " of its " + std::to_string(all) +
                                         " curves are no lines and no arcs, one of them about " +
                                         FilePlace(first[first.size() / 2]));
  return tube;
}

}  // namespace

std::vector<CadTube> TubesOfCurves(const CadBody& body) {
  std::vector<TubePiece> pieces;
  std::vector<Profile> profiles;
  std::size_t free = 0;
  const Points* first_free = nullptr;
  for (const Points& curve : body.curves) {
    if (curve.size() < 2) continue;
    auto piece = LineThrough(curve);
    if (!piece) piece = ArcThrough(curve);
    if (!piece) {
      if (++free == 1) first_free = &curve;
      continue;
    }
    if (piece->is_arc && piece->to > 2 * std::numbers::pi - 1e-6) {
      profiles.push_back({piece->origin, piece->axis, piece->bend_radius_mm});
      continue;
    }
    piece->around.set();
    pieces.push_back(std::move(*piece));
  }
  std::vector<CadTube> tubes;
  for (const TubeChain& chain : ChainsOf(pieces, /*may_infer_bends=*/false)) {
    if (chain.is_closed) continue;
    CadTube tube;
    tube.is_wire = true;
    tube.spine = chain.spine;
    TakeProfiles(profiles, tube);
    const double kink = std::max(chain.first.kink_deg, chain.last.kink_deg);
    if (kink > 0) tube.problems.push_back(KinkText(kink));
    tubes.push_back(std::move(tube));
  }
  KeepOnePolygon(tubes);
  if (first_free != nullptr) {
    tubes.assign(1, FreeCurve(*first_free, free, body.curves.size()));
  }
  return tubes;
}

}  // namespace bendloop::host
