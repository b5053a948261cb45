// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "drivers/simulated_scanner/tube_surface.h"
#include "hal/pose.h"

namespace bendloop::drivers {

// Everything above it is free; below it nothing can be seen.
struct TablePlane {
  Eigen::Vector3d point_mm = Eigen::Vector3d::Zero();
  Eigen::Vector3d up = Eigen::Vector3d::UnitZ();  // unit
};

// A clamp or gripper: from -half_size_mm to +half_size_mm in its own frame.
struct Box {
  hal::Pose X_WB;
  Eigen::Vector3d half_size_mm = Eigen::Vector3d::Zero();
};

struct SceneHit {
  double along_mm = 0;
  Eigen::Vector3d normal = Eigen::Vector3d::UnitZ();  // unit, outward
  bool is_part = false;                               // the tube that is measured
};

// What stands in front of the sensor: the part first, then other tubes, a table, clamps.
class Scene {
 public:
  explicit Scene(const hal::Tube& part, const hal::TubeFeatures& features = {},
                 double wall_mm = 0) {
    tubes_.emplace_back(part, features, wall_mm);
  }
  void Add(const hal::Tube& tube) { tubes_.emplace_back(tube); }
  void Add(const TablePlane& table) { tables_.push_back(table); }
  void Add(const Box& box) { boxes_.push_back(box); }

  const TubeSurface& part() const { return tubes_.front(); }

  // The tube pieces that can have a point between two parallel planes: low <= normal . p <= high.
  // Keeps the rays of a laser plane from asking every piece.
  struct Slab {
    Eigen::Vector3d normal = Eigen::Vector3d::UnitY();  // unit
    double low_mm = 0;
    double high_mm = 0;
  };
  struct Piece {
    const TubeSurface* tube = nullptr;
    std::size_t part = 0;
  };
  void PiecesIn(const Slab& slab, std::vector<Piece>& pieces) const;

  // Nearest hit along the ray up to `to_mm` among `pieces`, tables and boxes.
  std::optional<SceneHit> FirstHit(const std::vector<Piece>& pieces, const Ray& ray,
                                   double to_mm) const;
  // Is there anything on the way between from_mm and to_mm?
  bool IsBlocked(const std::vector<Piece>& pieces, const Ray& ray, double from_mm,
                 double to_mm) const;

 private:
  std::vector<TubeSurface> tubes_;
  std::vector<TablePlane> tables_;
  std::vector<Box> boxes_;
};

}  // namespace bendloop::drivers
