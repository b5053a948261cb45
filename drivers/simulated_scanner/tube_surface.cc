// SPDX-License-Identifier: Apache-2.0
#include "drivers/simulated_scanner/tube_surface.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "hal/angles.h"

namespace bendloop::drivers {
namespace {

using Eigen::Vector3d;

// Neighbouring segments overlap by this, so that no ray slips between them.
constexpr double kSeamMm = 1e-9;
// Pressed skin is met to this.
constexpr double kPressedMm = 1e-6;

// x^4 + p x^2 + q x + s.
struct DepressedQuartic {
  double p, q, s;
  double Value(double x) const { return ((x * x + p) * x + q) * x + s; }
  double Slope(double x) const { return (4 * x * x + 2 * p) * x + q; }
  double Curvature(double x) const { return 12 * x * x + 2 * p; }
};

// The root of a function that is monotone on [low, high] and changes sign there: Newton steps, and
// a bisection whenever one leaves the bracket.
template <class Value, class Slope>
double MonotoneRoot(Value value, Slope slope, double low, double high, bool rising) {
  double x = 0.5 * (low + high);
  for (int step = 0; step < 100; ++step) {
    const double y = value(x);
    if (y == 0) return x;
    ((y < 0) == rising ? low : high) = x;
    double next = x - y / slope(x);
    if (!(next > low && next < high)) next = 0.5 * (low + high);
    if (std::abs(next - x) <= 1e-14 * (std::abs(low) + std::abs(high)) || next == x) return next;
    x = next;
  }
  return x;
}

// Calls `found` with each root in (-limit, limit), rising, until it returns true. Double roots may
// be left out: a ray that only touches sees nothing.
template <class Found>
void ForEachRoot(const DepressedQuartic& f, double limit, Found found) {
  const auto value = [&](double x) { return f.Value(x); };
  const auto slope = [&](double x) { return f.Slope(x); };
  const auto curvature = [&](double x) { return f.Curvature(x); };
  // Where the slope is monotone, then where the function is.
  std::array<double, 4> bends = {-limit, limit, limit, limit};
  std::size_t bend_count = 2;
  if (f.p < 0) {
    const double inflexion = std::sqrt(-f.p / 6);
    if (inflexion < limit) {
      bends = {-limit, -inflexion, inflexion, limit};
      bend_count = 4;
    }
  }
  std::array<double, 5> turns{};
  std::size_t turn_count = 0;
  turns[turn_count++] = -limit;
  for (std::size_t i = 0; i + 1 < bend_count; ++i) {
    const double at_low = f.Slope(bends[i]);
    const double at_high = f.Slope(bends[i + 1]);
    if ((at_low < 0) != (at_high < 0)) {
      turns[turn_count++] = MonotoneRoot(slope, curvature, bends[i], bends[i + 1], at_low < 0);
    }
  }
  turns[turn_count++] = limit;
  double at_low = f.Value(turns[0]);
  for (std::size_t i = 0; i + 1 < turn_count; ++i) {
    const double at_high = f.Value(turns[i + 1]);
    if ((at_low < 0) != (at_high < 0) &&
        found(MonotoneRoot(value, slope, turns[i], turns[i + 1], at_low < 0))) {
      return;
    }
    at_low = at_high;
  }
}

}  // namespace

TubeSurface::TubeSurface(const hal::Tube& tube, const hal::TubeFeatures& features, double wall_mm)
    : pipe_radius_mm_(tube.pipe_radius_mm),
      wall_mm_(std::min(wall_mm, tube.pipe_radius_mm)),
      segments_(hal::SpineSegments(tube.program, tube.X_WT)) {
  for (const hal::SpineSegment& segment : segments_) {
    if (!(segment.length_mm > 0)) continue;
    Part part;
    part.segment = segment;
    part.bounds.center_mm = segment.PointAt(segment.length_mm / 2);
    if (segment.is_arc()) {
      part.center_mm = segment.center_mm();
      part.to_start = -segment.normal.cross(segment.tangent);
      const double quarter = std::min(segment.angle_rad() / 4, std::numbers::pi / 2);
      part.bounds.radius_mm = 2 * segment.bend_radius_mm * std::sin(quarter) + pipe_radius_mm_;
    } else {
      part.bounds.radius_mm = std::hypot(segment.length_mm / 2, pipe_radius_mm_);
    }
    part.bounds.radius_mm += 1e-6;
    parts_.push_back(part);
  }
  CutEnds(features);
  for (const hal::WallOpening& opening : features.openings) {
    const hal::SurfaceFrame frame = hal::FrameAt(segments_, opening.along_mm, opening.around_deg);
    const double axis = opening.axis_deg * hal::kRadiansPerDegree;
    const Vector3d drill =
        (frame.outward + std::tan(opening.lean_along_deg * hal::kRadiansPerDegree) * frame.tangent -
         std::tan(opening.lean_around_deg * hal::kRadiansPerDegree) * frame.sideways())
            .normalized();
    Vector3d along = std::cos(axis) * frame.tangent + std::sin(axis) * frame.sideways();
    along = (along - along.dot(drill) * drill).normalized();
    openings_.push_back({frame, frame.spine_mm + pipe_radius_mm_ * frame.outward, along,
                         drill.cross(along), 0.5 * (opening.length_mm - opening.width_mm),
                         0.5 * opening.width_mm});
  }
  for (const hal::PressedDent& dent : features.dents) {
    dents_.push_back(
        {hal::FrameAt(segments_, dent.along_mm, dent.around_deg), dent.depth_mm, dent.width_mm});
  }
}

// Lengthens the end straights by what a cut leaves beyond their ends, and cuts them.
void TubeSurface::CutEnds(const hal::TubeFeatures& features) {
  for (const bool at_start : {true, false}) {
    const hal::EndCut& cut = at_start ? features.first_end : features.last_end;
    const hal::EndEdge& edge = at_start ? features.first_edge : features.last_edge;
    const double slope = std::tan(cut.obliquity_deg * hal::kRadiansPerDegree);
    const bool is_plain = slope == 0 && edge == hal::EndEdge();
    if ((is_plain && !(wall_mm_ > 0)) || parts_.empty()) continue;
    Part& part = at_start ? parts_.front() : parts_.back();
    if (part.segment.is_arc()) continue;
    const double at_mm =
        at_start ? 0.0 : segments_.back().from_start_mm + segments_.back().length_mm;
    const hal::SurfaceFrame frame = hal::FrameAt(segments_, at_mm, cut.around_deg);
    const hal::SurfaceFrame wave = hal::FrameAt(segments_, at_mm, edge.wave_around_deg);
    const Vector3d outward = at_start ? Vector3d(-frame.tangent) : frame.tangent;
    part.cuts.push_back({frame.spine_mm, outward, slope * frame.outward, wave.outward,
                         wave.tangent.cross(wave.outward), edge});
    has_edges_ |= edge.bevel_mm > 0 || edge.burr_length_mm > 0;
    const double beyond_mm = pipe_radius_mm_ * slope + std::abs(edge.wave_mm);
    if (at_start) part.segment.start_mm += beyond_mm * outward;
    part.segment.length_mm += beyond_mm;
    part.bounds.radius_mm += beyond_mm + edge.burr_mm;
  }
}

double TubeSurface::Cut::BeyondMm(const Vector3d& at_mm) const {
  const Vector3d from_mm = at_mm - point_mm;
  double beyond_mm = from_mm.dot(outward) - from_mm.dot(slope);
  if (edge.waves > 0) {
    const double turn = std::atan2(from_mm.dot(quarter), from_mm.dot(zero));
    beyond_mm -= edge.wave_mm * std::cos(edge.waves * turn);
  }
  return beyond_mm;
}

double TubeSurface::Cut::InMm(const Vector3d& at_mm) const {
  const double before_mm = -BeyondMm(at_mm);
  double in_mm = 0;
  // The face of a cut lies at the border, by rounding a little beyond it.
  if (edge.bevel_mm > 0 && before_mm < edge.bevel_mm)
    in_mm += edge.bevel_depth_mm * (1 - before_mm / edge.bevel_mm);
  if (edge.burr_length_mm > 0 && before_mm < edge.burr_length_mm) {
    in_mm -= edge.burr_mm * (1 - before_mm / edge.burr_length_mm);
  }
  return in_mm;
}

bool TubeSurface::IsAway(const Part& part, const Vector3d& point_mm) const {
  for (const Cut& cut : part.cuts) {
    if (cut.BeyondMm(point_mm) > 0) return true;
  }
  for (const Opening& opening : openings_) {
    const Vector3d from_mm = point_mm - opening.frame.spine_mm;
    // Of this wall, and not of what else lies behind it.
    const double above_mm = from_mm.dot(opening.frame.outward);
    if (above_mm < 0 || above_mm > 1.5 * pipe_radius_mm_) continue;
    const Vector3d from_middle_mm = point_mm - opening.middle_mm;
    const double along_mm = from_middle_mm.dot(opening.along);
    const double off_mm = std::max(0.0, std::abs(along_mm) - opening.half_line_mm);
    if (std::hypot(off_mm, from_middle_mm.dot(opening.across)) < opening.half_width_mm) return true;
  }
  return false;
}

double TubeSurface::PressedMm(const Part& part, const Vector3d& point_mm) const {
  double depth_mm = 0;
  if (has_edges_) {
    for (const Cut& cut : part.cuts) depth_mm += cut.InMm(point_mm);
  }
  for (const Dent& dent : dents_) {
    // On the unrolled surface, so that a place knows nothing of how deep it is pressed in.
    const Vector3d from_mm = point_mm - dent.frame.spine_mm;
    const double along_mm = from_mm.dot(dent.frame.tangent);
    const double out_mm = from_mm.dot(dent.frame.outward);
    const double across_mm = from_mm.dot(dent.frame.sideways());
    if (std::hypot(out_mm, across_mm) > 2 * pipe_radius_mm_) continue;  // of another leg
    const double around_mm = pipe_radius_mm_ * std::atan2(across_mm, out_mm);
    const double off =
        (along_mm * along_mm + around_mm * around_mm) / (dent.width_mm * dent.width_mm);
    if (off < 40.0) depth_mm += dent.depth_mm * std::exp(-0.5 * off);
  }
  return depth_mm;
}

double TubeSurface::FromSpineMm(const Part& part, const Vector3d& point_mm) const {
  if (!part.segment.is_arc()) {
    return (point_mm - part.segment.start_mm).cross(part.segment.tangent).norm();
  }
  const Vector3d from_center_mm = point_mm - part.center_mm;
  const double out_of_plane_mm = from_center_mm.dot(part.segment.normal);
  const double ring_mm = (from_center_mm - out_of_plane_mm * part.segment.normal).norm();
  return std::hypot(ring_mm - part.segment.bend_radius_mm, out_of_plane_mm);
}

// Where the ray that met the round skin meets the pressed one.
std::optional<Hit> TubeSurface::Pressed(const Part& part, const Ray& ray, const Hit& round) const {
  if (dents_.empty() && !has_edges_) return round;
  constexpr double kGrazing = 0.05;  // cosine; beyond it nothing returns
  constexpr int kSteps = 30;         // each leaves a fraction of what the step before left
  const double cosine = -ray.direction.dot(round.normal);
  // The way out of a dent bends with the skin by less than this part of its depth.
  constexpr double kBends = 1.05;
  if (cosine < 0 && -cosine * round.along_mm <= kBends * PressedMm(part, ray.origin_mm) + kSeamMm) {
    return std::nullopt;  // the ray began above the pressed skin
  }
  if (cosine < kGrazing) return round;
  Hit hit = round;
  for (int i = 0; i < kSteps; ++i) {
    const Vector3d point_mm = ray.At(hit.along_mm);
    const double above_mm =
        PressedMm(part, point_mm) - (pipe_radius_mm_ - FromSpineMm(part, point_mm));
    hit.along_mm += above_mm / cosine;
    if (std::abs(above_mm) < kPressedMm) return hit;
  }
  return std::nullopt;  // it passes over the dent
}

std::optional<Hit> TubeSurface::FirstHit(std::size_t index, const Ray& ray, double from_mm,
                                         double to_mm) const {
  const Part& part = parts_[index];
  const auto round = HitRound(part, {pipe_radius_mm_, false}, ray, from_mm, to_mm);
  const std::optional<Hit> skin = round ? Pressed(part, ray, *round) : round;
  if (!(wall_mm_ > 0)) return skin;
  const std::optional<Hit> wall = HitWall(part, ray, from_mm, skin ? skin->along_mm : to_mm);
  return wall ? wall : skin;
}

std::optional<Hit> TubeSurface::HitRound(const Part& part, const Round& round, const Ray& ray,
                                         double from_mm, double to_mm) const {
  return part.segment.is_arc() ? HitArc(part, round, ray, from_mm, to_mm)
                               : HitLine(part, round, ray, from_mm, to_mm);
}

std::optional<Hit> TubeSurface::HitLine(const Part& part, const Round& round, const Ray& ray,
                                        double from_mm, double to_mm) const {
  const double r = round.radius_mm;
  const Vector3d& axis = part.segment.tangent;
  const Vector3d from_start = ray.origin_mm - part.segment.start_mm;
  const double origin_along = from_start.dot(axis);
  const double direction_along = ray.direction.dot(axis);
  const Vector3d across = from_start - origin_along * axis;
  const Vector3d direction_across = ray.direction - direction_along * axis;
  // |across + x direction_across|^2 = r^2
  const double a = direction_across.squaredNorm();
  if (a < 1e-18) return std::nullopt;  // along the axis
  const double middle = -across.dot(direction_across) / a;
  const double inside = r * r - (across + middle * direction_across).squaredNorm();
  if (inside <= 0) return std::nullopt;
  const double half = std::sqrt(inside / a);
  for (const double x : {middle - half, middle + half}) {
    const double along = origin_along + x * direction_along;
    if (x < from_mm || x > to_mm || along < -kSeamMm || along > part.segment.length_mm + kSeamMm) {
      continue;
    }
    if ((round.is_bore && x < middle) || IsAway(part, ray.At(x))) continue;
    return Hit{x, (across + x * direction_across) / r};
  }
  return std::nullopt;
}

std::optional<Hit> TubeSurface::HitArc(const Part& part, const Round& round, const Ray& ray,
                                       double from_mm, double to_mm) const {
  const double R = part.segment.bend_radius_mm;
  const double r = round.radius_mm;
  // In the torus' frame (axis z, start on x), the ray counted from its point next to the center:
  // then the quartic has no cubic term and its numbers stay small.
  const Vector3d& x_axis = part.to_start;
  const Vector3d& y_axis = part.segment.tangent;
  const Vector3d& z_axis = part.segment.normal;
  const Vector3d to_center = part.center_mm - ray.origin_mm;
  const double middle = to_center.dot(ray.direction);
  const Vector3d nearest = middle * ray.direction - to_center;
  const double limit_squared = (R + r) * (R + r) - nearest.squaredNorm();
  if (limit_squared <= 0) return std::nullopt;
  const double limit = std::sqrt(limit_squared) * (1 + 1e-9);
  const Vector3d o(nearest.dot(x_axis), nearest.dot(y_axis), nearest.dot(z_axis));
  const Vector3d d(ray.direction.dot(x_axis), ray.direction.dot(y_axis), ray.direction.dot(z_axis));
  // (|p|^2 + R^2 - r^2)^2 = 4 R^2 (px^2 + py^2) with p = o + x d, o perpendicular to d.
  const double k = o.squaredNorm() + R * R - r * r;
  const double R2 = R * R;
  const DepressedQuartic f{2 * k - 4 * R2 * (d.x() * d.x() + d.y() * d.y()),
                           -8 * R2 * (o.x() * d.x() + o.y() * d.y()),
                           k * k - 4 * R2 * (o.x() * o.x() + o.y() * o.y())};
  std::optional<Hit> hit;
  const double seam_rad = kSeamMm / R;
  const double angle_rad = part.segment.angle_rad();
  ForEachRoot(f, limit, [&](double x) {
    if (middle + x < from_mm) return false;
    if (middle + x > to_mm) return true;
    const Vector3d p = o + x * d;
    double phi = std::atan2(p.y(), p.x());
    if (phi < -seam_rad) phi += 2 * std::numbers::pi;
    if (phi > angle_rad + seam_rad) return false;
    if (IsAway(part, ray.At(middle + x))) return false;
    const double ring = std::hypot(p.x(), p.y());
    const Vector3d normal = (p - Vector3d(p.x(), p.y(), 0) * (R / ring)) / r;
    if (round.is_bore && d.dot(normal) <= 0) return false;
    hit = Hit{middle + x, normal.x() * x_axis + normal.y() * y_axis + normal.z() * z_axis};
    return true;
  });
  return hit;
}

}  // namespace bendloop::drivers
