// SPDX-License-Identifier: Apache-2.0
#include "drivers/simulated_scanner/tube_surface.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <numbers>

#include "tube_fixture.h"

namespace bendloop::drivers {
namespace {

using Eigen::Vector3d;

std::optional<Hit> FirstHit(const TubeSurface& surface, const Ray& ray) {
  std::optional<Hit> first;
  for (std::size_t part = 0; part < surface.part_count(); ++part) {
    const auto hit = surface.FirstHit(part, ray, 0, 1e4);
    if (hit && (!first || hit->along_mm < first->along_mm)) first = hit;
  }
  return first;
}

// Through an open end there is no skin to meet.
bool EntersAnEnd(const std::vector<hal::SpineSegment>& spine, double radius_mm, const Ray& ray) {
  for (const bool at_start : {true, false}) {
    const hal::SpineSegment& segment = at_start ? spine.front() : spine.back();
    const Vector3d end = segment.PointAt(at_start ? 0 : segment.length_mm);
    const Vector3d normal = segment.TangentAt(at_start ? 0 : segment.length_mm);
    const double along = (end - ray.origin_mm).dot(normal) / ray.direction.dot(normal);
    if (along > 0 && (ray.At(along) - end).norm() < radius_mm + 0.1) return true;
  }
  return false;
}

// A tube with two openings and oblique ends as a body: whether a point is within its metal.
struct CutBody {
  hal::Tube tube{10, {{{80, 0, 60, 30.0}, {80, 0, 0, std::nullopt}}}, {}};
  hal::TubeFeatures features;
  double wall_mm = 2;
  std::vector<hal::SpineSegment> spine = hal::SpineSegments(tube.program, tube.X_WT);

  CutBody() {
    features.first_end = {25, 70};
    features.last_end = {0, 0};
    features.openings = {{40, 20, 9, 9, 0, 10, -15}, {90, -60, 14, 6, 30}};
  }
  bool IsDrilled(const hal::WallOpening& opening, const Vector3d& point_mm) const {
    const hal::SurfaceFrame frame = hal::FrameAt(spine, opening.along_mm, opening.around_deg);
    const auto slope = [](double deg) { return std::tan(deg * std::numbers::pi / 180); };
    const Vector3d drill = (frame.outward + slope(opening.lean_along_deg) * frame.tangent -
                            slope(opening.lean_around_deg) * frame.sideways())
                               .normalized();
    const double axis = opening.axis_deg * std::numbers::pi / 180;
    Vector3d along = std::cos(axis) * frame.tangent + std::sin(axis) * frame.sideways();
    along = (along - along.dot(drill) * drill).normalized();
    const Vector3d from_spine_mm = point_mm - frame.spine_mm;
    if (from_spine_mm.dot(frame.outward) < 0) return false;
    Vector3d off_mm = from_spine_mm - tube.pipe_radius_mm * frame.outward;
    off_mm -= off_mm.dot(drill) * drill;
    const double half_mm = 0.5 * (opening.length_mm - opening.width_mm);
    off_mm -= std::clamp(off_mm.dot(along), -half_mm, half_mm) * along;
    return off_mm.norm() < 0.5 * opening.width_mm;
  }
  bool IsMetal(const Vector3d& point_mm) const {
    // The first end leaves more than the spine, whose straight goes on there.
    std::vector<hal::SpineSegment> longer = spine;
    longer.front().start_mm -= 10 * longer.front().tangent;
    longer.front().length_mm += 10;
    const double from_spine_mm = NearestFoot(longer, point_mm).distance_mm;
    if (from_spine_mm > tube.pipe_radius_mm || from_spine_mm < tube.pipe_radius_mm - wall_mm) {
      return false;
    }
    const hal::SurfaceFrame first = hal::FrameAt(spine, 0, features.first_end.around_deg);
    const Vector3d from_mm = point_mm - first.spine_mm;
    const double slope = std::tan(features.first_end.obliquity_deg * std::numbers::pi / 180);
    if (-from_mm.dot(first.tangent) > slope * from_mm.dot(first.outward)) return false;
    for (const hal::WallOpening& opening : features.openings) {
      if (IsDrilled(opening, point_mm)) return false;
    }
    return true;
  }
};

TEST(TubeSurface, RaysMeetTheWallWhereItIsCut) {
  const CutBody body;
  const TubeSurface surface(body.tube, body.features, body.wall_mm);
  std::mt19937_64 engine(5);
  std::uniform_real_distribution<double> unit(-1, 1);
  const double length_mm = hal::SpineLength(body.tube.program);
  int below = 0;
  for (int i = 0; i < 1200; ++i) {
    // Half of them at what is cut.
    constexpr double kCutsMm[] = {0, 40, 90, 191.4};
    const double along_mm = i % 2 == 0 ? kCutsMm[i / 2 % 4] : length_mm * 0.5 * (1 + unit(engine));
    const hal::SurfaceFrame frame = hal::FrameAt(body.spine, along_mm, 180 * unit(engine));
    Ray ray;
    ray.direction = Vector3d(unit(engine), unit(engine), unit(engine)).normalized();
    const Vector3d target_mm = frame.spine_mm + 10 * frame.outward +
                               4 * Vector3d(unit(engine), unit(engine), unit(engine));
    ray.origin_mm = target_mm - 100 * ray.direction;
    if (body.IsMetal(ray.origin_mm)) continue;
    const auto hit = FirstHit(surface, ray);
    const double to_mm = hit ? hit->along_mm - 1e-3 : 200;
    bool is_free = true;
    for (double at_mm = 0; at_mm < to_mm; at_mm += 0.02) is_free &= !body.IsMetal(ray.At(at_mm));
    EXPECT_TRUE(is_free) << "ray " << i;
    if (!hit) continue;
    EXPECT_TRUE(body.IsMetal(ray.At(hit->along_mm + 1e-5))) << "ray " << i;
    EXPECT_NEAR(hit->normal.norm(), 1, 1e-9);
    EXPECT_LT(hit->normal.dot(ray.direction), 0) << "ray " << i;
    below += NearestFoot(body.spine, ray.At(hit->along_mm)).distance_mm < 9.999 ? 1 : 0;
  }
  EXPECT_GT(below, 60);
}

TEST(TubeSurface, RaysMeetTheTrueSurfaceFirstAndAlways) {
  for (std::uint64_t seed = 0; seed < 40; ++seed) {
    std::mt19937_64 engine(seed);
    const hal::Tube tube = RandomTube(engine, static_cast<int>(seed % 6));
    const TubeSurface surface(tube);
    const auto& spine = surface.segments();
    const double length_mm = hal::SpineLength(tube.program);
    std::uniform_real_distribution<double> unit(-1, 1);
    int hits = 0;
    for (int i = 0; i < 100; ++i) {
      // Aim at a place near the spine from well outside.
      const double along = length_mm * (0.5 + 0.5 * unit(engine));
      std::size_t at = 0;
      while (at + 1 < spine.size() && along >= spine[at + 1].from_start_mm) ++at;
      const Vector3d target =
          spine[at].PointAt(along - spine[at].from_start_mm) +
          1.2 * tube.pipe_radius_mm * Vector3d(unit(engine), unit(engine), unit(engine));
      Ray ray;
      ray.direction = Vector3d(unit(engine), unit(engine), unit(engine)).normalized();
      ray.origin_mm = target - 3000 * ray.direction;
      if (EntersAnEnd(spine, tube.pipe_radius_mm, ray)) continue;
      const auto hit = FirstHit(surface, ray);
      if (hit) {
        ++hits;
        const Foot foot = NearestFoot(spine, ray.At(hit->along_mm));
        EXPECT_NEAR(foot.distance_mm, tube.pipe_radius_mm, 1e-9) << "seed " << seed << " ray " << i;
        EXPECT_NEAR(hit->normal.norm(), 1, 1e-9);
        EXPECT_LT(
            (foot.point_mm + tube.pipe_radius_mm * hit->normal - ray.At(hit->along_mm)).norm(),
            1e-8);
        EXPECT_LT(hit->normal.dot(ray.direction), 1e-6);
      }
      // No place before it (or on the whole ray) is inside the tube.
      const double end = hit ? hit->along_mm - 1e-3 : 6000;
      for (double x = 2000; x < std::min(end, 4000.0); x += 1.1) {
        ASSERT_GT(NearestFoot(spine, ray.At(x)).distance_mm, tube.pipe_radius_mm - 1e-9)
            << "seed " << seed << " ray " << i << " at " << x << " of " << end;
      }
    }
    EXPECT_GT(hits, 30);
  }
}

TEST(TubeSurface, StaysExactOnBigBends) {
  const hal::Tube tube{5, {{{1, 0, 300, 560.0}, {1, 0, 0, std::nullopt}}}, {}};
  const TubeSurface surface(tube);
  std::mt19937_64 engine(1);
  std::uniform_real_distribution<double> unit(-1, 1);
  for (int i = 0; i < 2000; ++i) {
    const Vector3d target(1 + 570 * unit(engine), 560 + 570 * unit(engine), 5 * unit(engine));
    Ray ray;
    ray.direction = Vector3d(unit(engine), unit(engine), unit(engine)).normalized();
    ray.origin_mm = target - 2000 * ray.direction;
    if (const auto hit = FirstHit(surface, ray)) {
      EXPECT_NEAR(NearestFoot(surface.segments(), ray.At(hit->along_mm)).distance_mm, 5, 1e-9);
    }
  }
}

TEST(TubeSurface, RespectsItsRange) {
  const TubeSurface surface(hal::Tube{4, {{{100, 0, 0, std::nullopt}}}, {}});
  const Ray ray{{50, 0, 20}, {0, 0, -1}};
  EXPECT_NEAR(surface.FirstHit(0, ray, 0, 100)->along_mm, 16, 1e-12);
  EXPECT_NEAR(surface.FirstHit(0, ray, 17, 100)->along_mm, 24, 1e-12);
  EXPECT_FALSE(surface.FirstHit(0, ray, 0, 15));
  EXPECT_FALSE(surface.FirstHit(0, ray, 25, 100));
  EXPECT_FALSE(surface.FirstHit(0, {{-0.1, 0, 20}, {0, 0, -1}}, 0, 100));
  EXPECT_FALSE(surface.FirstHit(0, {{-10, 0, 0}, {1, 0, 0}}, 0, 100));  // into the open end
}

// Whatever side the rays come from: a dent of 0.15 pipe radii, deepest where x is 50 and z up.
TEST(TubeSurface, DentsAreAsDeepFromAllSides) {
  hal::TubeFeatures features;
  features.dents = {{50, 0, 1.2, 3}};
  const TubeSurface surface({8, {{{100, 0, 0, std::nullopt}}}, {}}, features);
  const Vector3d up = hal::FrameAt(surface.segments(), 50, 0).outward;
  const Vector3d aside = up.cross(Vector3d::UnitX());
  for (double turn = -1.2; turn <= 1.2; turn += 0.1) {
    for (double from = -3; from <= 3; from += 0.5) {
      const Vector3d direction = std::cos(turn) * up + std::sin(turn) * aside;
      const Ray ray{{50 + from, 0, 0}, -direction};
      const Ray outside{ray.origin_mm + 100 * direction + from * up, ray.direction};
      const auto hit = FirstHit(surface, outside);
      if (!hit) continue;  // over the dent
      const Vector3d point = outside.At(hit->along_mm);
      const double around = 8 * std::atan2(point.dot(aside), point.dot(up));
      const double depth = 1.2 * std::exp(-0.5 * (from * from + around * around) / 9);
      EXPECT_NEAR(std::hypot(point.y(), point.z()), 8 - depth, 1e-5) << turn << " " << from;
    }
  }
}

}  // namespace
}  // namespace bendloop::drivers
