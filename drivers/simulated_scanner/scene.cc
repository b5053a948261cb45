// SPDX-License-Identifier: Apache-2.0
#include "drivers/simulated_scanner/scene.h"

#include <cmath>
#include <limits>
#include <utility>

namespace bendloop::drivers {
namespace {

using Eigen::Vector3d;

// Does the line through the ray come near enough to the sphere, between the two lengths?
bool Passes(const Sphere& sphere, const Ray& ray, double from_mm, double to_mm) {
  const Vector3d to_center = sphere.center_mm - ray.origin_mm;
  const double along = to_center.dot(ray.direction);
  return along > from_mm - sphere.radius_mm && along < to_mm + sphere.radius_mm &&
         to_center.squaredNorm() - along * along < sphere.radius_mm * sphere.radius_mm;
}

std::optional<Hit> HitTable(const TablePlane& table, const Ray& ray, double from_mm, double to_mm) {
  const double down = -ray.direction.dot(table.up);
  if (down <= 0) return std::nullopt;
  const double along = (ray.origin_mm - table.point_mm).dot(table.up) / down;
  if (along < from_mm || along > to_mm) return std::nullopt;
  return Hit{along, table.up};
}

// The slab method of Kay and Kajiya.
std::optional<Hit> HitBox(const Box& box, const Ray& ray, double from_mm, double to_mm) {
  const Vector3d origin = box.X_WB.Inverse() * ray.origin_mm;
  const Vector3d direction = box.X_WB.orientation.conjugate() * ray.direction;
  double enter = -std::numeric_limits<double>::infinity();
  double leave = std::numeric_limits<double>::infinity();
  int enter_axis = 0;
  for (int axis = 0; axis < 3; ++axis) {
    const double half = box.half_size_mm[axis];
    if (direction[axis] == 0) {
      if (std::abs(origin[axis]) > half) return std::nullopt;
      continue;
    }
    double first = (-half - origin[axis]) / direction[axis];
    double second = (half - origin[axis]) / direction[axis];
    if (first > second) std::swap(first, second);
    if (first > enter) {
      enter = first;
      enter_axis = axis;
    }
    leave = std::min(leave, second);
  }
  if (enter > leave || leave < from_mm || enter > to_mm) return std::nullopt;
  Vector3d normal = Vector3d::Zero();
  normal[enter_axis] = direction[enter_axis] > 0 ? -1 : 1;
  return Hit{std::max(enter, from_mm), box.X_WB.orientation * normal};
}

}  // namespace

void Scene::PiecesIn(const Slab& slab, std::vector<Piece>& pieces) const {
  pieces.clear();
  for (const TubeSurface& tube : tubes_) {
    for (std::size_t part = 0; part < tube.part_count(); ++part) {
      const Sphere& bounds = tube.bounds(part);
      const double at = slab.normal.dot(bounds.center_mm);
      if (at + bounds.radius_mm >= slab.low_mm && at - bounds.radius_mm <= slab.high_mm) {
        pieces.push_back({&tube, part});
      }
    }
  }
}

std::optional<SceneHit> Scene::FirstHit(const std::vector<Piece>& pieces, const Ray& ray,
                                        double to_mm) const {
  std::optional<SceneHit> nearest;
  const auto consider = [&](const std::optional<Hit>& hit, bool is_part) {
    if (!hit) return;
    nearest = SceneHit{hit->along_mm, hit->normal, is_part};
    to_mm = hit->along_mm;  // only what is nearer is looked for from now on
  };
  for (const Piece& piece : pieces) {
    if (Passes(piece.tube->bounds(piece.part), ray, 0, to_mm)) {
      consider(piece.tube->FirstHit(piece.part, ray, 0, to_mm), piece.tube == &part());
    }
  }
  for (const TablePlane& table : tables_) consider(HitTable(table, ray, 0, to_mm), false);
  for (const Box& box : boxes_) consider(HitBox(box, ray, 0, to_mm), false);
  return nearest;
}

bool Scene::IsBlocked(const std::vector<Piece>& pieces, const Ray& ray, double from_mm,
                      double to_mm) const {
  for (const Piece& piece : pieces) {
    if (Passes(piece.tube->bounds(piece.part), ray, from_mm, to_mm) &&
        piece.tube->FirstHit(piece.part, ray, from_mm, to_mm)) {
      return true;
    }
  }
  for (const TablePlane& table : tables_) {
    if (HitTable(table, ray, from_mm, to_mm)) return true;
  }
  for (const Box& box : boxes_) {
    if (HitBox(box, ray, from_mm, to_mm)) return true;
  }
  return false;
}

}  // namespace bendloop::drivers
