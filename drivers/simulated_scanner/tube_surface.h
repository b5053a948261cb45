// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <vector>

#include "hal/spine.h"
#include "hal/tube.h"

namespace bendloop::drivers {

// origin_mm + along_mm * direction, direction of unit length.
struct Ray {
  Eigen::Vector3d origin_mm = Eigen::Vector3d::Zero();
  Eigen::Vector3d direction = Eigen::Vector3d::UnitZ();

  Eigen::Vector3d At(double along_mm) const { return origin_mm + along_mm * direction; }
};

struct Hit {
  double along_mm = 0;
  Eigen::Vector3d normal = Eigen::Vector3d::UnitZ();  // unit, outward
};

struct Sphere {
  Eigen::Vector3d center_mm = Eigen::Vector3d::Zero();
  double radius_mm = 0;
};

// The skin of a bent tube: cylinders and pieces of tori around the spine's lines and arcs, open at
// both ends. Rays meet it exactly (torus: roots of the quartic).
class TubeSurface {
 public:
  explicit TubeSurface(const hal::Tube& tube);

  std::size_t part_count() const { return parts_.size(); }
  // Holds the whole part.
  const Sphere& bounds(std::size_t part) const { return parts_[part].bounds; }
  // The first point of this line or arc's skin between `from_mm` and `to_mm` along the ray, from
  // outside or from inside.
  std::optional<Hit> FirstHit(std::size_t part, const Ray& ray, double from_mm, double to_mm) const;

  const std::vector<hal::SpineSegment>& segments() const { return segments_; }
  double pipe_radius_mm() const { return pipe_radius_mm_; }

 private:
  struct Part {
    hal::SpineSegment segment;
    Sphere bounds;
    // Arcs: center, and axes from it to the start and along the start's tangent.
    Eigen::Vector3d center_mm = Eigen::Vector3d::Zero();
    Eigen::Vector3d to_start = Eigen::Vector3d::UnitX();
  };

  std::optional<Hit> HitLine(const Part& part, const Ray& ray, double from_mm, double to_mm) const;
  std::optional<Hit> HitArc(const Part& part, const Ray& ray, double from_mm, double to_mm) const;

  double pipe_radius_mm_;
  std::vector<hal::SpineSegment> segments_;
  std::vector<Part> parts_;  // of the segments that have a length
};

}  // namespace bendloop::drivers
