// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cad/nearest_tube.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>
#include <string>
#include <utility>

#include "firmware-host/cad/developed.h"
#include "firmware-host/cad/near_end.h"
#include "hal/clock.h"
#include "pipeline/tube_model.h"

namespace bendloop::host {
namespace {

using Eigen::Vector3d;
// Samples of a cylinder or torus: so many each way.
constexpr int kAlong = 120, kAroundSamples = 36;
// Of a patch's samples, so many are asked whether its others lie behind them.
constexpr std::size_t kAsked = 200;
// Where a hose bends on and on, arcs nearest to it may overlap by so many pipe radii: they meet.
constexpr double kMostOverlapRadii = 0.1;
constexpr double kTightestRadii = 1.01;
// Surface so many pipe radii off the lines and arcs is none of theirs; a smaller share of it (a
// bead, a chamfer) is not told.
constexpr double kFarRadii = 0.5;
constexpr double kToldShare = 0.02;
// A larger one is a leg that the rows leave out, or run past.
constexpr double kMostShare = 0.05;

// A tube's outer surface is convex across: seen from a sample, its neighbours lie behind it.
bool IsOuter(const SurfacePatch& patch) {
  const auto& samples = patch.samples;
  const std::size_t step = std::max<std::size_t>(1, samples.size() / kAsked);
  double behind = 0;
  for (std::size_t i = 0; i < samples.size(); i += step) {
    for (std::size_t j = 0; j < samples.size(); j += step) {
      const Vector3d d = samples[j].point - samples[i].point;
      const double distance = d.norm();
      if (distance > 1e-9) behind -= d.dot(samples[i].normal) / std::pow(distance, 3);
    }
  }
  return behind > 0;
}

void AddGrid(const SurfacePatch& patch, std::vector<Vector3d>& points) {
  const bool torus = patch.kind == PatchKind::kTorus;
  const int nu = torus ? kAlong : kAroundSamples, nv = torus ? kAroundSamples : kAlong;
  for (int i = 0; i < nu; ++i) {
    const double u = patch.u0 + (patch.u1 - patch.u0) * (i + 0.5) / nu;
    const Vector3d radial = std::cos(u) * patch.x + std::sin(u) * patch.y;
    for (int j = 0; j < nv; ++j) {
      const double v = patch.v0 + (patch.v1 - patch.v0) * (j + 0.5) / nv;
      points.push_back(
          torus ? Vector3d(patch.origin +
                           (patch.bend_radius_mm + patch.radius_mm * std::cos(v)) * radial +
                           patch.radius_mm * std::sin(v) * patch.axis)
                : Vector3d(patch.origin + patch.radius_mm * radial + v * patch.axis));
    }
  }
}

std::vector<Vector3d> OuterPoints(const CadBody& body, double pipe_radius_mm) {
  std::vector<Vector3d> points;
  const double tolerance = MatchToleranceMm(pipe_radius_mm);
  for (const SurfacePatch& patch : body.patches) {
    if (patch.kind == PatchKind::kFree) {
      if (!IsOuter(patch)) continue;
      for (const OrientedPoint& s : patch.samples) points.push_back(s.point);
    } else if (!patch.concave &&
               (pipe_radius_mm == 0 || std::abs(patch.radius_mm - pipe_radius_mm) < tolerance)) {
      AddGrid(patch, points);
    }
  }
  return points;
}

// Of a pipe of that radius about a body's curves, without the circles that are its profiles.
std::vector<Vector3d> PipePoints(const CadBody& body, double pipe_radius_mm) {
  std::vector<Vector3d> points;
  for (const auto& curve : body.curves) {
    if ((curve.front() - curve.back()).norm() < 1e-6) continue;
    for (std::size_t i = 0; i < curve.size(); ++i) {
      const Vector3d along = curve[std::min(i + 1, curve.size() - 1)] - curve[i == 0 ? 0 : i - 1];
      if (!(along.norm() > 0)) continue;
      const Vector3d x = along.unitOrthogonal(), y = along.normalized().cross(x);
      for (int k = 0; k < kAroundSamples; ++k) {
        const double angle = 2 * std::numbers::pi * (k + (i % 2) * 0.5) / kAroundSamples;
        points.push_back(curve[i] + pipe_radius_mm * (std::cos(angle) * x + std::sin(angle) * y));
      }
    }
  }
  return points;
}

// Bends that are tighter than the pipe, which no part file takes, about the same corners as tight
// as it.
void WidenArcs(std::vector<hal::BendRow>& rows, double least_mm) {
  for (std::size_t i = 0; i + 1 < rows.size(); ++i) {
    const double wider_mm = least_mm - rows[i].bend_radius_mm.value_or(least_mm);
    if (wider_mm <= 0) continue;
    const double shorter_mm = wider_mm * std::tan(rows[i].angle_deg * std::numbers::pi / 360);
    *rows[i].bend_radius_mm = least_mm;
    rows[i].length_mm -= shorter_mm;
    rows[i + 1].length_mm -= shorter_mm;
  }
}

// Arcs that overlap by less than `most_mm` meet; at an end, where a part has a straight, the arc
// ends so much earlier. The developed length stays.
void SeparateArcs(std::vector<hal::BendRow>& rows, double most_mm) {
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const bool last = i + 1 == rows.size();
    const double least = i == 0 || last ? most_mm : 0;
    const double need = least - rows[i].length_mm;
    if (rows.size() < 2 || need <= 0 || rows[i].length_mm < -most_mm) continue;
    hal::BendRow& bend = rows[last ? i - 1 : i];
    rows[i].length_mm = least;
    if (bend.bend_radius_mm) bend.angle_deg -= need / *bend.bend_radius_mm * 180 / std::numbers::pi;
  }
}

// A scan's samples stop anywhere, on average half their distance before the end; a curve's lie on
// its very end. Moves the last straight's end there.
void EndAtSamples(const std::vector<Vector3d>& points, double radius_mm, Spine& spine) {
  const Vector3d outward = spine.end_direction();
  double farthest = -INFINITY;
  for (const Vector3d& p : points) {
    const Vector3d d = p - spine.end;
    const double along = d.dot(outward), across = (d - along * outward).norm();
    if (std::abs(along) < radius_mm && std::abs(across - radius_mm) < radius_mm / 2) {
      farthest = std::max(farthest, along);
    }
  }
  const Vector3d begin = spine.arcs.empty() ? spine.start : spine.arcs.back().to;
  if (farthest + (spine.end - begin).dot(outward) > 0) spine.end += farthest * outward;
}

// Lines and arcs, and how near to them all of the surface lies: what a scan's measurement sets
// aside as none of the tube is the part's own here.
struct NearTube {
  CadTube tube;
  double far_share = 1;  // of the surface
  double rms_mm = 0;     // of the rest
};

void Judge(const std::vector<Vector3d>& points, NearTube& near) {
  const double radius_mm = near.tube.pipe_radius_mm;
  const Developed developed(near.tube.spine);
  double sum = 0;
  std::size_t count = 0;
  for (const Vector3d& p : points) {
    const double off_mm = developed.Of(p).across_mm - radius_mm;
    if (std::abs(off_mm) > kFarRadii * radius_mm) continue;
    sum += off_mm * off_mm;
    ++count;
  }
  near.rms_mm = std::sqrt(sum / static_cast<double>(std::max<std::size_t>(1, count)));
  near.far_share = 1 - static_cast<double>(count) / static_cast<double>(points.size());
}

std::string HowNear(const NearTube& near) {
  char text[240];
  std::snprintf(
      text, sizeof text,
      "the part is no lines and arcs; these are the nearest, and %s lies %.3f mm off them (rms)",
      near.tube.is_wire ? "a pipe along its curve" : "its surface", near.rms_mm);
  std::string said = text;
  if (near.far_share > kToldShare) {
    std::snprintf(text, sizeof text, ", but for %.0f %% of it, which lies more than %.2f mm off",
                  100 * near.far_share, kFarRadii * near.tube.pipe_radius_mm);
    said += text;
  }
  return said;
}

// By one of the pipeline's models.
hal::Result<NearTube> NearBy(pipeline::TubeModel model, const std::vector<Vector3d>& points,
                             const CadBody& body, const CadTube& like) {
  pipeline::ReconstructionOptions options;
  if (like.pipe_radius_mm > 0) options.pipe_radius_mm = like.pipe_radius_mm;
  const hal::SteadyClock clock;
  auto measured = pipeline::ReconstructModel(points, model, options, clock);
  if (!measured) return hal::Fail(measured.error());
  NearTube near;
  near.tube = like;
  near.tube.problems.clear();
  near.tube.openings.clear();
  near.tube.openings_reversed.clear();
  near.tube.placed_notes.clear();
  near.tube.placed_notes_reversed.clear();
  near.tube.pipe_radius_mm = measured->tube.pipe_radius_mm;
  WidenArcs(measured->tube.program.rows, kTightestRadii * near.tube.pipe_radius_mm);
  SeparateArcs(measured->tube.program.rows, kMostOverlapRadii * near.tube.pipe_radius_mm);
  near.tube.spine = SpineOf(measured->tube);
  // Those of `like` may be where it is broken.
  for (TubeEnd* end : {&near.tube.last, &near.tube.first}) {
    EndAtSamples(points, near.tube.pipe_radius_mm, near.tube.spine);
    if (!like.is_wire) EndAtBorder(body, near.tube.pipe_radius_mm, near.tube.spine, *end);
    near.tube.spine = near.tube.spine.Reversed();
  }
  Judge(points, near);
  return near;
}

}  // namespace

hal::Result<CadTube> NearestTube(const CadBody& body, const CadTube& like) {
  const std::vector<Vector3d> points =
      like.is_wire ? PipePoints(body, like.pipe_radius_mm) : OuterPoints(body, like.pipe_radius_mm);
  auto nearest = NearBy(pipeline::TubeModel::kTube, points, body, like);
  // A part that bends on and on leads the search for lines and arcs astray; its free spine does
  // not.
  if (!nearest || nearest->far_share > kToldShare) {
    auto other = NearBy(pipeline::TubeModel::kCanal, points, body, like);
    if (other && (!nearest || other->far_share < nearest->far_share)) nearest = std::move(other);
  }
  if (!nearest) {
    return hal::Fail(hal::ErrorKind::kBadInput,
                     "no lines and arcs are near to it: " + nearest.error().message);
  }
  if (nearest->far_share > kMostShare) {
    char text[160];
    std::snprintf(
        text, sizeof text,
        "no lines and arcs are near to it: the best leave %.0f %% of its surface more than "
        "%.2f mm away",
        100 * nearest->far_share, kFarRadii * nearest->tube.pipe_radius_mm);
    return hal::Fail(hal::ErrorKind::kBadInput, text);
  }
  nearest->tube.notes.assign(1, HowNear(*nearest));
  return std::move(nearest->tube);
}

}  // namespace bendloop::host
