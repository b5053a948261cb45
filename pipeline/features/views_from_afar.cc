// SPDX-License-Identifier: Apache-2.0
#include "pipeline/features/views_from_afar.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstddef>

#include "hal/angles.h"

namespace bendloop::pipeline {
namespace {

struct ViewSettings {
  // From the wall's normal: what lies flatter is not seen. Views that differ by this are taken for
  // each other's, so it need not be theirs.
  double limit_deg = 75.0;
  // Views all around a place, and so far along the tube.
  double around_deg = 140.0, around_step_deg = 5.0;
  double tilt_deg = 60.0, tilt_step_deg = 30.0;
  // [of r_P] Views towards all parts of the tube that are further off than this, so far along it
  // from each other and beside it, as edges of shadows are as sharp as parts of the tube are near.
  double near = 2.5, step = 0.5, beside_step = 0.25, most_beside = 1.5;
  double hides = 0.97;  // [of r_P] how wide balls on the spine are that hide what the tube does
};
constexpr ViewSettings kViews;

class Views {
 public:
  Views(const LookedAtTube& tube, const hal::SurfaceFrame& frame,
        std::span<const WallPatch> patches)
      : frame_(frame), patches_(patches), r_mm_(tube.pipe_radius_mm) {
    for (const WallPatch& patch : patches) {
      middle_mm_ += patch.point_mm / static_cast<double>(patches.size());
    }
    for (const WallPatch& patch : patches) {
      around_mm_ = std::max(around_mm_, (patch.point_mm - middle_mm_).norm());
    }
    for (const hal::SpineSegment& segment : tube.segments) {
      const double steps = std::max(1.0, std::ceil(segment.length_mm / (kViews.step * r_mm_)));
      for (double i = 0.5; i < steps; i += 1.0) {
        const double along_mm = segment.length_mm * i / steps;
        spine_.push_back({segment.PointAt(along_mm), segment.TangentAt(along_mm)});
      }
    }
  }

  std::vector<PatchesSeen> Find() const {
    std::vector<PatchesSeen> views;
    const auto add = [&](const Eigen::Vector3d& way) {
      PatchesSeen seen = SeenFrom(way);
      if (!seen.empty()) views.push_back(std::move(seen));
    };
    AllAround(add);
    TowardsTube(add);
    std::sort(views.begin(), views.end());
    views.erase(std::unique(views.begin(), views.end()), views.end());
    return views;
  }

 private:
  struct OfSpine {
    Eigen::Vector3d point_mm, tangent;
  };

  // `add`: takes the way to a view.
  template <class Add>
  void AllAround(Add add) const {
    for (double deg = -kViews.around_deg; deg <= kViews.around_deg; deg += kViews.around_step_deg) {
      const double turn = deg * hal::kRadiansPerDegree;
      const Eigen::Vector3d across =
          std::cos(turn) * frame_.outward + std::sin(turn) * frame_.sideways();
      for (double along_deg = -kViews.tilt_deg; along_deg <= kViews.tilt_deg;
           along_deg += kViews.tilt_step_deg) {
        const double tilt = along_deg * hal::kRadiansPerDegree;
        add(Eigen::Vector3d(std::cos(tilt) * across + std::sin(tilt) * frame_.tangent));
      }
    }
  }
  template <class Add>
  void TowardsTube(Add add) const {
    for (const OfSpine& at : spine_) {
      const Eigen::Vector3d way_mm = at.point_mm - middle_mm_;
      if (way_mm.norm() < kViews.near * r_mm_) continue;
      const Eigen::Vector3d aside = at.tangent.cross(way_mm);
      if (aside.norm() < 1e-3 * way_mm.norm()) continue;
      for (double beside = -kViews.most_beside; beside <= kViews.most_beside;
           beside += kViews.beside_step) {
        add(Eigen::Vector3d((way_mm + beside * r_mm_ * aside.normalized()).normalized()));
      }
    }
  }

  PatchesSeen SeenFrom(const Eigen::Vector3d& way) const {
    static const double kLeast = std::cos(kViews.limit_deg * hal::kRadiansPerDegree);
    PatchesSeen seen;
    for (std::size_t i = 0; i < patches_.size(); ++i) {
      if (patches_[i].normal.dot(way) > kLeast) seen.push_back(static_cast<std::uint16_t>(i));
    }
    if (seen.empty()) return seen;
    std::vector<Eigen::Vector3d> hiding;
    for (const OfSpine& at : spine_) {
      const Eigen::Vector3d from = at.point_mm - middle_mm_;
      const double ahead_mm = from.dot(way);
      if (ahead_mm > -around_mm_ && (from - ahead_mm * way).norm() < around_mm_ + r_mm_) {
        hiding.push_back(at.point_mm);
      }
    }
    const double hides_mm2 = std::pow(kViews.hides * r_mm_, 2);
    std::erase_if(seen, [&](std::uint16_t i) {
      return std::any_of(hiding.begin(), hiding.end(), [&](const Eigen::Vector3d& ball) {
        const Eigen::Vector3d from = ball - patches_[i].point_mm;
        const double ahead_mm = from.dot(way);
        return ahead_mm > 0 && from.squaredNorm() - ahead_mm * ahead_mm < hides_mm2;
      });
    });
    return seen;
  }

  hal::SurfaceFrame frame_;
  std::span<const WallPatch> patches_;
  double r_mm_, around_mm_ = 0;
  Eigen::Vector3d middle_mm_ = Eigen::Vector3d::Zero();
  std::vector<OfSpine> spine_;
};

}  // namespace

std::vector<PatchesSeen> FindViews(const LookedAtTube& tube, const hal::SurfaceFrame& frame,
                                   std::span<const WallPatch> patches) {
  return Views(tube, frame, patches).Find();
}

}  // namespace bendloop::pipeline
