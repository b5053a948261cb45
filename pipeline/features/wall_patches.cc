// SPDX-License-Identifier: Apache-2.0
#include "pipeline/features/wall_patches.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <optional>

#include "pipeline/features/beside_border.h"
#include "pipeline/fit/surface_points.h"

namespace bendloop::pipeline {
namespace {

struct PatchSettings {
  int each_way = 10;
  int parts = 4;  // of a patch, each way, of which each is inside the border or outside
  // [of its width, and of r_P] So far around the border, at least.
  double beside = 0.6, least_beside = 0.25;
  // Cosine to the plane's normal of those that are looked at: others are seen from the side.
  double least_cosine = 0.3;
  // [of r_P] How near to the surface a point of it is found; and no further than this before or
  // behind what it belongs to: there the tube has ended.
  double exact = 0.02, beyond = 0.1;
  int steps = 30;  // towards it
};
constexpr PatchSettings kPatches;

// A rectangle along and round the tube: across the outward direction x [mm], and turns [rad].
struct Rectangle {
  double x_mm, turn;  // where it begins
  double wide_mm, turned;

  // Its part (i, k) of `n` each way.
  Rectangle Part(int i, int k, int n) const {
    return {x_mm + wide_mm * i / n, turn + turned * k / n, wide_mm / n, turned / n};
  }
  Eigen::Vector2d Middle(double r_mm) const {
    return {x_mm + 0.5 * wide_mm, r_mm * std::sin(turn + 0.5 * turned)};
  }
};

double TurnOf(double y_mm, double r_mm) {
  return std::asin(std::clamp(y_mm / r_mm, -kLimb, kLimb));
}

Rectangle RectangleAbout(const OpeningBorder& border, double r_mm) {
  const double beside_mm =
      std::max(kPatches.beside * border.width_mm, kPatches.least_beside * r_mm);
  const double half_line_mm = 0.5 * (border.length_mm - border.width_mm);
  const Eigen::Vector2d half_mm =
      (half_line_mm * border.Axis().cwiseAbs()).array() + 0.5 * border.width_mm + beside_mm;
  const double from = TurnOf(border.middle_mm.y() - half_mm.y(), r_mm);
  const double to = TurnOf(border.middle_mm.y() + half_mm.y(), r_mm);
  return {border.middle_mm.x() - half_mm.x(), from, 2.0 * half_mm.x(), to - from};
}

// The wall where it lies over places of the plane of a frame.
class WallOver {
 public:
  WallOver(const LookedAtTube& tube, const hal::SurfaceFrame& frame, double reach_mm)
      : tube_(tube), frame_(frame), about_(tube.SegmentsAbout(frame, reach_mm)) {}

  // None where no wall is, or only that which is seen from the side.
  std::optional<WallPatch> At(const Eigen::Vector2d& place_mm) const {
    const double r_mm = tube_.pipe_radius_mm;
    Eigen::Vector3d point = frame_.spine_mm + place_mm.x() * frame_.tangent +
                            place_mm.y() * frame_.sideways() + 2.0 * r_mm * frame_.outward;
    NearSegment near;
    for (int step = 0; step < kPatches.steps; ++step) {
      near = NearestSegment(point, tube_.frames, about_);
      point -= (near.distance_mm - r_mm) * frame_.outward;
    }
    if (!(std::abs(near.distance_mm - r_mm) < kPatches.exact * r_mm)) return std::nullopt;
    const std::array<std::int32_t, 1> own = {near.segment};
    const SpineFoot foot = NearestFoot(point, tube_.segments, tube_.frames, own);
    const hal::SpineSegment& segment = tube_.segments[static_cast<std::size_t>(near.segment)];
    const Eigen::Vector3d out = point - segment.PointAt(foot.along_mm);
    const double beyond_mm = std::abs(out.dot(segment.TangentAt(foot.along_mm)));
    WallPatch patch{point, out.normalized()};
    if (patch.normal.dot(frame_.outward) < kPatches.least_cosine) return std::nullopt;
    if (beyond_mm > kPatches.beyond * r_mm) return std::nullopt;
    return patch;
  }

 private:
  const LookedAtTube& tube_;
  hal::SurfaceFrame frame_;
  std::vector<std::int32_t> about_;
};

}  // namespace

std::vector<WallPatch> PatchesAbout(const LookedAtTube& tube, const hal::SurfaceFrame& frame,
                                    const OpeningBorder& border,
                                    std::span<const Eigen::Vector2d> samples, double reach_mm) {
  constexpr int kN = kPatches.each_way;
  const double r_mm = tube.pipe_radius_mm;
  const Rectangle all = RectangleAbout(border, r_mm);
  const WallOver wall(tube, frame, reach_mm);
  std::array<double, kN * kN> counts{};
  for (const Eigen::Vector2d& sample : samples) {
    if (std::abs(sample.y()) > kLimb * r_mm || border.DistanceMm(sample) < 0) continue;
    const double i = std::floor((sample.x() - all.x_mm) / all.wide_mm * kN);
    const double k = std::floor((TurnOf(sample.y(), r_mm) - all.turn) / all.turned * kN);
    if (i < 0 || i >= kN || k < 0 || k >= kN) continue;
    counts[static_cast<std::size_t>(i * kN + k)] += 1;
  }
  std::vector<WallPatch> patches;
  for (int i = 0; i < kN; ++i) {
    for (int k = 0; k < kN; ++k) {
      const Rectangle rectangle = all.Part(i, k, kN);
      auto patch = wall.At(rectangle.Middle(r_mm));
      if (!patch) continue;
      for (int part = 0; part < kPatches.parts * kPatches.parts; ++part) {
        const Rectangle piece =
            rectangle.Part(part / kPatches.parts, part % kPatches.parts, kPatches.parts);
        const Eigen::Vector2d place = piece.Middle(r_mm);
        if (place.norm() > reach_mm) continue;
        const double high_mm = r_mm * piece.turned * std::cos(piece.turn + 0.5 * piece.turned);
        const double mm2 = piece.wide_mm * high_mm / patch->normal.dot(frame.outward);
        (border.DistanceMm(place) < 0 ? patch->inside_mm2 : patch->outside_mm2) += mm2;
      }
      if (patch->outside_mm2 > 0) patch->samples = counts[static_cast<std::size_t>(i * kN + k)];
      if (patch->outside_mm2 + patch->inside_mm2 > 0) patches.push_back(*patch);
    }
  }
  return patches;
}

}  // namespace bendloop::pipeline
