// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cad/developed.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <numbers>

#include "hal/bend_program.h"
#include "hal/tube_features.h"

namespace bendloop::host {
namespace {

using Eigen::Vector3d;

void Take(const Vector3d& p, const Vector3d& foot, const Vector3d& tangent, const Vector3d& normal,
          double along_mm, Place& best) {
  const double across = (p - foot).norm();
  if (across >= best.across_mm) return;
  const Vector3d radial = across > 0 ? Vector3d((p - foot) / across) : normal;
  best = {along_mm, across, radial, tangent,
          hal::WrapRotationDeg(hal::AroundDeg(normal, tangent, radial))};
}

void Straight(const Vector3d& p, const Vector3d& at, const Vector3d& along, double length,
              const Vector3d& normal, double before, Place& best) {
  const double s = std::clamp((p - at).dot(along), 0.0, length);
  Take(p, at + s * along, along, normal, before + s, best);
}

// Of a straight, which may be askew to the bend before it.
Vector3d WayBetween(const Vector3d& from, const Vector3d& to, const Vector3d& tangent) {
  constexpr double kLeastMm = 1e-3;  // of a shorter one the bend knows better
  return (to - from).norm() > kLeastMm ? Vector3d((to - from).normalized()) : tangent;
}

void Bend(const Vector3d& p, const SpineArc& arc, double before, Place& best) {
  const Vector3d x = (arc.from - arc.centre).normalized(), d = p - arc.centre;
  const double angle = std::atan2(d.dot(arc.tangent_in), d.dot(x));
  const double turned = angle < -1e-9 ? angle + 2 * std::numbers::pi : std::max(angle, 0.0);
  if (turned > arc.angle_rad) return;
  const Vector3d foot =
      arc.centre + arc.bend_radius_mm * (std::cos(turned) * x + std::sin(turned) * arc.tangent_in);
  const Vector3d tangent = std::cos(turned) * arc.tangent_in - std::sin(turned) * x;
  Take(p, foot, tangent, arc.normal, before + arc.bend_radius_mm * turned, best);
}

}  // namespace

double RoundedTurnDeg(double deg, int decimals) {
  const double per_deg = std::pow(10.0, decimals);
  const double rounded = std::round(deg * per_deg) / per_deg + 0.0;
  return rounded <= -180 ? rounded + 360 : rounded;
}

std::string FilePlace(const Vector3d& p, int decimals) {
  // Nothing is -0.
  const double half = std::pow(10.0, -decimals) / 2;
  const auto told = [&](double v) { return std::abs(v) < half ? 0.0 : v; };
  char text[200];
  std::snprintf(text, sizeof text, "x %.*f, y %.*f, z %.*f mm", decimals, told(p.x()), decimals,
                told(p.y()), decimals, told(p.z()));
  return text;
}

int BendAt(const Spine& spine, double along_mm) {
  double before = 0;
  Vector3d at = spine.start;
  for (std::size_t i = 0; i < spine.arcs.size(); ++i) {
    const SpineArc& arc = spine.arcs[i];
    before += (arc.from - at).norm();
    if (along_mm <= before) return 0;
    before += arc.bend_radius_mm * arc.angle_rad;
    if (along_mm < before) return int(i) + 1;
    at = arc.to;
  }
  return 0;
}

Place Developed::Of(const Vector3d& p) const {
  Place best;
  best.across_mm = std::numeric_limits<double>::infinity();
  Vector3d at = spine_.start, along = spine_.direction;
  Vector3d normal = spine_.arcs.empty() ? along.unitOrthogonal() : spine_.arcs.front().normal;
  double before = 0;
  for (const SpineArc& arc : spine_.arcs) {
    Straight(p, at, WayBetween(at, arc.from, along), (arc.from - at).norm(), normal, before, best);
    before += (arc.from - at).norm();
    Bend(p, arc, before, best);
    before += arc.bend_radius_mm * arc.angle_rad;
    at = arc.to;
    along = arc.tangent_out;
    normal = arc.normal;
  }
  Straight(p, at, WayBetween(at, spine_.end, along), (spine_.end - at).norm(), normal, before,
           best);
  return best;
}

}  // namespace bendloop::host
