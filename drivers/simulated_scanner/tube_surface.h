// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <vector>

#include "hal/spine.h"
#include "hal/tube.h"
#include "hal/tube_features.h"

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
// both ends. Rays meet it exactly (torus: roots of the quartic), and pass through what is cut off
// or drilled; dents, bevels and burrs are met to a nanometre. A cut stays on its straight. With a
// wall of some thickness rays that enter an end or an opening meet what the cut left of it: the
// ring of an end, the flank of an opening, and the bore (tube_wall.cc).
class TubeSurface {
 public:
  // `wall_mm`: 0: a skin without thickness, and the bore returns nothing.
  explicit TubeSurface(const hal::Tube& tube, const hal::TubeFeatures& features = {},
                       double wall_mm = 0);

  std::size_t part_count() const { return parts_.size(); }
  // Holds the whole part.
  const Sphere& bounds(std::size_t part) const { return parts_[part].bounds; }
  // The first point of this line or arc's skin, or of its wall's cuts and bore, between `from_mm`
  // and `to_mm` along the ray, from outside or from inside.
  std::optional<Hit> FirstHit(std::size_t part, const Ray& ray, double from_mm, double to_mm) const;

  const std::vector<hal::SpineSegment>& segments() const { return segments_; }
  double pipe_radius_mm() const { return pipe_radius_mm_; }

 private:
  // Where an end's border is: its plane and what the border has beside it.
  struct Cut {
    Eigen::Vector3d point_mm, outward;  // on the spine; along it, out of the tube
    Eigen::Vector3d slope;              // how fast the plane goes outward across the spine
    Eigen::Vector3d zero, quarter;      // across the spine: places around count from there
    hal::EndEdge edge;

    // How far beyond the border the point lies, along the spine.
    double BeyondMm(const Eigen::Vector3d& at_mm) const;
    // How far the skin has come in there; less than 0: stands out.
    double InMm(const Eigen::Vector3d& at_mm) const;
  };
  struct Part {
    hal::SpineSegment segment;
    Sphere bounds;
    // Arcs: center, and axes from it to the start and along the start's tangent.
    Eigen::Vector3d center_mm = Eigen::Vector3d::Zero();
    Eigen::Vector3d to_start = Eigen::Vector3d::UnitX();
    // Of the ends that lie on it: what is beyond them is cut off.
    std::vector<Cut> cuts;
  };
  struct Opening {
    hal::SurfaceFrame frame;
    Eigen::Vector3d middle_mm;      // on the round skin
    Eigen::Vector3d along, across;  // unit, of its length and its width, across the drill's axis
    double half_line_mm = 0;        // the line about which it is drilled, from its middle
    double half_width_mm = 0;
  };
  struct Dent {
    hal::SurfaceFrame frame;
    double depth_mm = 0, width_mm = 0;
  };
  // The round tube's outside or its bore, which is met from within only.
  struct Round {
    double radius_mm = 0;
    bool is_bore = false;
  };

  void CutEnds(const hal::TubeFeatures& features);
  // Whether material is missing where the skin of the round tube would be.
  bool IsAway(const Part& part, const Eigen::Vector3d& point_mm) const;
  // How far the skin is pressed in, or bevelled, at this point of the round tube.
  double PressedMm(const Part& part, const Eigen::Vector3d& point_mm) const;
  double FromSpineMm(const Part& part, const Eigen::Vector3d& point_mm) const;
  std::optional<Hit> Pressed(const Part& part, const Ray& ray, const Hit& round) const;
  std::optional<Hit> HitRound(const Part& part, const Round& round, const Ray& ray, double from_mm,
                              double to_mm) const;
  std::optional<Hit> HitLine(const Part& part, const Round& round, const Ray& ray, double from_mm,
                             double to_mm) const;
  std::optional<Hit> HitArc(const Part& part, const Round& round, const Ray& ray, double from_mm,
                            double to_mm) const;

  // Whether the wall of this line or arc is there, at its bore or above.
  bool IsInWall(const Part& part, const Eigen::Vector3d& point_mm) const;
  std::optional<Hit> HitRing(const Part& part, const Cut& cut, const Ray& ray) const;
  std::optional<Hit> HitFlank(const Part& part, const Opening& opening, const Ray& ray) const;
  // The nearest of the bore, the rings and the flanks.
  std::optional<Hit> HitWall(const Part& part, const Ray& ray, double from_mm, double to_mm) const;

  double pipe_radius_mm_;
  double wall_mm_;
  std::vector<hal::SpineSegment> segments_;
  std::vector<Part> parts_;  // of the segments that have a length
  std::vector<Opening> openings_;
  std::vector<Dent> dents_;
  bool has_edges_ = false;  // bevels or burrs
};

}  // namespace bendloop::drivers
