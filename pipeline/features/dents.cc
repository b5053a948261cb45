// SPDX-License-Identifier: Apache-2.0
#include "pipeline/features/dents.h"

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <numbers>
#include <numeric>
#include <optional>
#include <utility>
#include <vector>

#include "hal/angles.h"
#include "hal/tube_features.h"
#include "pipeline/features/dent_fit.h"
#include "pipeline/features/unrolled_wall.h"
#include "pipeline/fit/surface_form.h"
#include "pipeline/fit/surface_sums.h"

namespace bendloop::pipeline {
namespace {

struct DentSettings {
  // [of its size] and [of r_P] So far around its middle the wall is looked at, on its unrolled
  // surface.
  double look = 1.25, look_more = 0.5;
  // [of r_P] No further around the tube: beyond is its other side.
  double most_around = 2.2;
  // [of r_P] Deeper ones are still asked whether the wall is whole there: through one that was
  // pressed in nothing is seen. Beyond lies the wall across.
  double most_in = 0.6;
  // More points tell hardly more and cost time.
  std::size_t enough_points = 4000;
  // [of r_P] and [sigma] One that cells do not show by themselves is so deep at least, as its
  // points have it, and so surely: cells look everywhere.
  double least_small = 0.02, small_sigmas = 7.0;
  // And what its form leaves of its points is no more than this, of chi square for each that is
  // free: what a scan or a bend makes of a wall, waves and sides that do not meet, is no dent's
  // form.
  double small_misfit = 1.3;
  // [of its size] Of a dent that is known: what is fitted no further from its middle is that dent
  // once more; what lies further than `apart` is looked at without the points where the known one
  // is deeper than so many [sigma].
  double same = 0.5, apart = 0.75, rim_sigmas = 0.3;
  // [of its depth] What cannot be fitted and is no deeper is what cells make of its flanks, and of
  // the wall opposite it.
  double echo = 0.3;
};
constexpr DentSettings kDents;

// A circle on the wall that a dent that is known reaches to.
struct DentCircle {
  Eigen::Vector3d middle_mm;
  double radius_mm;
};

// The wall about a place, unrolled.
class Wall {
 public:
  Wall(const hal::Tube& tube, const WallForm& form, const CutFaces& faces, double noise_mm,
       std::span<const PointBlock> blocks)
      : r_mm_(tube.pipe_radius_mm),
        faces_(faces),
        face_mm_(CutFaces::ReachMm(noise_mm, r_mm_)),
        about_(form.about),
        places_(form.about),
        spine_(form.about.spine),
        frames_(SegmentFrames(spine_, 0.0, form.flattening)),
        blocks_(blocks) {
    for (const Flattening& of_bend : form.flattening) {
      const double most = 0.5 * (std::abs(of_bend.constant) + std::abs(of_bend.bump)) +
                          std::abs(of_bend.collapse) + std::abs(of_bend.plateau);
      flat_mm_ = std::max(flat_mm_, most * r_mm_);
    }
  }

  const PlacesOnWall& places() const { return places_; }

  // At most `enough_points`, as far apart as all of them; off the wall that is flattened; without
  // those in `others`, as far as these are no nearer than `own_mm`.
  std::vector<WallPoint> About(const hal::SurfaceFrame& frame, double along_mm, double reach_mm,
                               double off_mm, std::span<const DentCircle> others,
                               double own_mm) const {
    const double in_mm = std::max(off_mm, kDents.most_in * r_mm_);
    std::vector<SeenPoint> seen =
        SeenAbout(frame, along_mm, reach_mm, {-in_mm - flat_mm_, off_mm + flat_mm_});
    const UnrolledWall unrolled(spine_.segments, frame, r_mm_);
    for (const DentCircle& other : others) {
      const auto middle = PlaceOf(other.middle_mm, unrolled, along_mm);
      if (!middle) continue;
      const double radius_mm =
          std::min(other.radius_mm, std::hypot(middle->along_mm, middle->around_mm) - own_mm);
      std::erase_if(seen, [&](const SeenPoint& point) {
        const double around_mm = std::remainder(point.place.around_mm - middle->around_mm,
                                                2.0 * std::numbers::pi * r_mm_);
        return std::hypot(point.place.along_mm - middle->along_mm, around_mm) < radius_mm;
      });
    }
    const std::size_t stride = StrideTo(seen.size(), kDents.enough_points);
    std::vector<WallPoint> points;
    for (std::size_t i = 0; i < seen.size(); i += stride) {
      WallPoint point = seen[i].place;
      point.off_mm += InsideMm(*seen[i].point, seen[i].segment);
      if (point.off_mm <= off_mm && point.off_mm >= -in_mm) points.push_back(point);
    }
    return points;
  }

  hal::SurfaceFrame FrameAt(double along_mm, double around_deg) const {
    return hal::FrameAt(spine_.segments, along_mm, around_deg, spine_.pieces);
  }
  // Of a place on the frames' straights, how far these bow aside there.
  Eigen::Vector3d BowedMm(double along_mm) const {
    const std::size_t segment = hal::SegmentAt(spine_.segments, along_mm);
    return about_.BesideMm(segment, along_mm - spine_.segments[segment].from_start_mm);
  }
  double length_mm() const { return spine_.length_mm(); }
  // Where along the spine a place of the wall about the frame is, and how much of the spine is
  // beside a length of the wall there.
  struct OnSpine {
    double along_mm, part;
  };
  OnSpine OnSpineAt(const hal::SurfaceFrame& frame, double frame_mm, double along_wall_mm,
                    double around_mm) const {
    const UnrolledWall unrolled(spine_.segments, frame, r_mm_);
    const auto at_mm = [&](double along_mm) {
      return unrolled.SpineAtMm(along_mm, around_mm, frame_mm);
    };
    const double step_mm = 0.05 * r_mm_;
    const double part =
        (at_mm(along_wall_mm + step_mm) - at_mm(along_wall_mm - step_mm)) / (2.0 * step_mm);
    return {std::clamp(at_mm(along_wall_mm), 0.0, length_mm()), part};
  }

 private:
  std::optional<WallPoint> PlaceOf(const Eigen::Vector3d& seen, const UnrolledWall& unrolled,
                                   double along_mm) const {
    const Eigen::Vector3d point = places_.Straightened(seen, places_.FootOf(seen));
    const SpineFoot foot = places_.FootOf(point);
    if (foot.segment < 0) return std::nullopt;
    const Eigen::Vector2d place = unrolled.PlaceOf(point, foot);
    return WallPoint{unrolled.AlongWallMm(place, along_mm), -place.y(), 0};
  }
  struct SeenPoint {
    WallPoint place;  // off the round wall
    const Eigen::Vector3d* point;
    std::size_t segment;
  };
  std::vector<SeenPoint> SeenAbout(const hal::SurfaceFrame& frame, double along_mm, double reach_mm,
                                   const std::array<double, 2>& off_mm) const {
    const Eigen::Vector3d middle = frame.spine_mm + r_mm_ * frame.outward;
    const auto& segments = spine_.segments;
    const UnrolledWall unrolled(segments, frame, r_mm_);
    const double around_mm = std::min(reach_mm, kDents.most_around * r_mm_);
    std::vector<SeenPoint> seen;
    std::vector<std::int32_t> candidates;
    for (const PointBlock& block : blocks_) {
      const double near_mm = std::hypot(reach_mm, around_mm) + r_mm_ + block.half_diagonal_mm;
      if ((block.center_mm - middle).squaredNorm() > near_mm * near_mm) continue;
      CandidateSegments(block, frames_, 2.0 * r_mm_, candidates);
      if (candidates.empty()) continue;
      for (const Eigen::Vector3d& as_seen : block.points) {
        SpineFoot foot = NearestFoot(as_seen, segments, frames_, candidates);
        const Eigen::Vector3d point = places_.Straightened(as_seen, foot);
        if (!about_.bows.empty()) foot = NearestFoot(point, segments, frames_, candidates);
        const double off = foot.distance_mm - r_mm_;
        if (foot.segment < 0 || off < off_mm[0] || off > off_mm[1]) continue;
        const auto at = static_cast<std::size_t>(foot.segment);
        if (foot.along_mm < 0 || foot.along_mm > segments[at].length_mm) continue;
        const Eigen::Vector2d place = unrolled.PlaceOf(point, foot);
        const double u = unrolled.AlongWallMm(place, along_mm), v = -place.y();
        if (std::abs(u) > reach_mm || std::abs(v) > around_mm || faces_.AreAt(as_seen, face_mm_))
          continue;
        seen.push_back({{u, v, off}, &as_seen, at});
      }
    }
    return seen;
  }
  // How far the flattened wall lies inside the round one there.
  double InsideMm(const Eigen::Vector3d& point, std::size_t segment) const {
    const SegmentFrame& frame = frames_[segment];
    if (!frame.is_flattened()) return 0.0;
    PointLanes lanes;
    lanes.x[0] = point.x(), lanes.y[0] = point.y(), lanes.z[0] = point.z();
    LocalLanes local;
    ToSegment(frame, lanes, 1, local);
    std::array<double, kBatch> inside_mm{};
    FlattenedBy(frame, r_mm_, local, inside_mm);
    return inside_mm[0];
  }

  double r_mm_;
  const CutFaces& faces_;
  double face_mm_;
  double flat_mm_ = 0;  // the furthest that a bend's wall lies off the round one
  const WallSpine& about_;
  PlacesOnWall places_;
  const EasedSpine& spine_;
  std::vector<SegmentFrame> frames_;
  std::span<const PointBlock> blocks_;
};

// Along the tube of sharp bends, as its drawing has places, and around what its wall lies about.
class PlacesOfTube {
 public:
  explicit PlacesOfTube(const hal::Tube& tube)
      : segments_(hal::SpineSegments(tube.program, tube.X_WT)),
        frames_(SegmentFrames(segments_, 0.0)),
        all_(segments_.size()) {
    std::iota(all_.begin(), all_.end(), 0);
  }
  // By the dent's position, which lies that way from the wall's axis.
  void Name(const Eigen::Vector3d& outward, DentFound& dent) const {
    const SpineFoot foot = NearestFoot(dent.position_mm, segments_, frames_, all_);
    if (foot.segment < 0) return;
    const auto at = static_cast<std::size_t>(foot.segment);
    const hal::SpineSegment& segment = segments_[at];
    const double along_mm = std::clamp(foot.along_mm, 0.0, segment.length_mm);
    dent.along_mm = segment.from_start_mm + along_mm;
    dent.around_deg =
        hal::AroundDeg(hal::AroundZero(segments_, at), segment.TangentAt(along_mm), outward);
  }

 private:
  std::vector<hal::SpineSegment> segments_;
  std::vector<SegmentFrame> frames_;
  std::vector<std::int32_t> all_;
};

// As the cells saw it: its middle and size to about a cell; they may have seen its flank alone, so
// its depth to about itself.
void Doubt(double pipe_radius_mm, DentFound& dent) {
  constexpr double kCellPart = 0.15;  // of r_P: 1 sigma of a place in a cell half as long
  dent.along_sigma_mm = kCellPart * pipe_radius_mm;
  dent.around_sigma_deg = kCellPart * hal::kDegreesPerRadian;
  dent.area_mm2 = 0.25 * std::numbers::pi * dent.size_mm * dent.size_mm;
  dent.area_sigma_mm2 = 0.5 * dent.area_mm2;
  dent.sigma_mm = dent.depth_mm;
}

// Whether it was fitted, and not left as the cells have it.
bool IsFitted(const DentFound& dent) { return dent.sigma_mm < kVagueDepth * dent.depth_mm; }

// How far from its middle the dent is deeper than `rim_mm`, as a gaussian is.
double ReachOf(const DentFound& dent, double rim_mm) {
  return 0.5 * dent.size_mm * std::sqrt(std::log2(std::max(2.0, dent.depth_mm / rim_mm)));
}

// Whether it is one of `known` once more.
bool IsKnown(const DentFound& dent, std::span<const DentFound> known) {
  return std::any_of(known.begin(), known.end(), [&](const DentFound& other) {
    const double apart_mm = (dent.position_mm - other.position_mm).norm();
    return IsFitted(other) && apart_mm < kDents.same * std::max(dent.size_mm, other.size_mm);
  });
}

// Whether it, which could not be fitted, is what one of `known` looks like from beside it.
bool IsEcho(const DentFound& dent, const Eigen::Vector3d& tangent, double r_mm, double noise_mm,
            std::span<const DentFound> known) {
  return std::any_of(known.begin(), known.end(), [&](const DentFound& other) {
    if (!IsFitted(other) || dent.depth_mm > kDents.echo * other.depth_mm) return false;
    const double reach_mm = ReachOf(other, kDents.rim_sigmas * noise_mm) + 0.5 * dent.size_mm;
    const Eigen::Vector3d apart_mm = dent.position_mm - other.position_mm;
    return std::abs(apart_mm.dot(tangent)) < reach_mm && apart_mm.norm() < reach_mm + 2.0 * r_mm;
  });
}

// What a fit that is about this dent, though its points do not tell it by themselves, leaves open
// beyond what cells make of it.
double UnsureDepthMm(const DentFound& dent, const FittedDent& fitted, double reach_mm,
                     double pipe_radius_mm) {
  const double unsure_mm = std::hypot(fitted.depth_sigma_mm, fitted.depth_mm - dent.depth_mm);
  const bool is_of_it = fitted.depth_sigma_mm > 0 && !fitted.is_step && fitted.IsWithin(reach_mm);
  if (!is_of_it || !std::isfinite(unsure_mm)) return dent.sigma_mm;
  return std::max(dent.sigma_mm, std::min(unsure_mm, pipe_radius_mm));
}

// Whether its points show it, where cells by themselves do not.
bool IsSureSmall(const FittedDent& fitted, double pipe_radius_mm) {
  return fitted.misfit < kDents.small_misfit &&
         fitted.depth_mm > kDents.least_small * pipe_radius_mm &&
         fitted.depth_mm > kDents.small_sigmas * fitted.depth_sigma_mm;
}

// From the points about it. False: there is none, or it is one of `known`.
bool MeasureDent(const Wall& wall, double r_mm, double noise_mm, std::span<const DentFound> known,
                 DentFound& dent) {
  Doubt(r_mm, dent);
  const bool in_cells = dent.depth_mm > kClearDents.least * r_mm;
  std::vector<DentCircle> others;
  for (const DentFound& other : known) {
    const bool is_apart = (dent.position_mm - other.position_mm).norm() >
                          kDents.apart * std::max(dent.size_mm, other.size_mm);
    if (IsFitted(other) && is_apart) {
      others.push_back({other.position_mm, ReachOf(other, kDents.rim_sigmas * noise_mm)});
    }
  }
  const auto [frame, middle_mm] = wall.places().FrameTo(dent.position_mm);
  const double reach_mm = kDents.look * dent.size_mm + kDents.look_more * r_mm;
  const std::vector<WallPoint> points =
      wall.About(frame, middle_mm, reach_mm, MostOffWallMm(dent.depth_mm, noise_mm), others,
                 0.5 * dent.size_mm);
  const FittedDent fitted = FitDent(points, reach_mm, dent.depth_mm, dent.size_mm, r_mm, noise_mm);
  if (!fitted.is_fitted) {
    dent.sigma_mm = UnsureDepthMm(dent, fitted, reach_mm, r_mm);
    return in_cells && IsShown(points, reach_mm, dent.depth_mm, dent.size_mm, r_mm, noise_mm) &&
           !IsKnown(dent, known) && !IsEcho(dent, frame.tangent, r_mm, noise_mm, known);
  }
  if (!in_cells && !IsSureSmall(fitted, r_mm)) return false;
  const auto [along_mm, part] =
      wall.OnSpineAt(frame, middle_mm, fitted.along_mm, -fitted.around_mm);
  hal::SurfaceFrame there = wall.FrameAt(along_mm, 0.0);
  there.outward = UnrolledWall::Carried(
      Eigen::AngleAxisd(fitted.around_mm / r_mm, frame.tangent) * frame.outward, frame.tangent,
      there.tangent);
  dent.position_mm = there.spine_mm + r_mm * there.outward + wall.BowedMm(along_mm);
  dent.along_sigma_mm = part * fitted.along_sigma_mm;
  dent.around_sigma_deg = fitted.around_sigma_mm / r_mm * hal::kDegreesPerRadian;
  dent.depth_mm = fitted.depth_mm, dent.sigma_mm = fitted.depth_sigma_mm;
  dent.area_mm2 = fitted.area_mm2, dent.area_sigma_mm2 = fitted.area_sigma_mm2;
  dent.size_mm = 2.0 * std::sqrt(dent.area_mm2 / std::numbers::pi);
  return !IsKnown(dent, known);
}

// Whether a dent, fitted without knowing of the other, has it in what was looked at.
bool IsBeside(const DentFound& other, const DentFound& dent, double r_mm, double noise_mm) {
  const double looked_mm = kDents.look * dent.size_mm + kDents.look_more * r_mm;
  return IsFitted(other) && (dent.position_mm - other.position_mm).norm() <
                                looked_mm + ReachOf(other, kDents.rim_sigmas * noise_mm);
}

// Those that were fitted before one beside them was known, without the points of that one.
void MeasureAgain(const Wall& wall, double r_mm, double noise_mm, std::vector<DentFound>& known) {
  for (std::size_t i = 0; i + 1 < known.size(); ++i) {
    if (!IsFitted(known[i])) continue;
    std::vector<DentFound> others = known;
    others.erase(others.begin() + static_cast<std::ptrdiff_t>(i));
    const auto later = std::span(others).subspan(i);
    const bool is_beside = std::any_of(later.begin(), later.end(), [&](const DentFound& other) {
      return IsBeside(other, known[i], r_mm, noise_mm);
    });
    if (!is_beside) continue;
    DentFound again = known[i];
    if (MeasureDent(wall, r_mm, noise_mm, others, again) && IsFitted(again)) known[i] = again;
  }
}

}  // namespace

void MeasureDents(const hal::Tube& tube, const WallForm& form, const TubeEnds& ends,
                  const CutFaces& faces, double noise_mm, std::span<const PointBlock> blocks,
                  std::vector<DentFound>& dents) {
  if (dents.empty()) return;
  const double length_mm = hal::SpineLength(tube.program);
  const Wall wall(tube, form, faces, noise_mm, blocks);
  const PlacesOfTube places(tube);
  // The deepest first: cells may have parted it, and taken the wall opposite it for pressed in.
  const auto is_deeper = [](const DentFound& a, const DentFound& b) {
    return a.depth_mm > b.depth_mm;
  };
  std::stable_sort(dents.begin(), dents.end(), is_deeper);
  std::vector<DentFound> known;
  for (DentFound dent : dents) {
    if (!MeasureDent(wall, tube.pipe_radius_mm, noise_mm, known, dent)) continue;
    // What could not be fitted and was deeper in cells may have been this one.
    if (IsFitted(dent)) {
      std::erase_if(known, [&](const DentFound& other) {
        return !IsFitted(other) && IsKnown(other, std::span(&dent, 1));
      });
    }
    known.push_back(dent);
  }
  MeasureAgain(wall, tube.pipe_radius_mm, noise_mm, known);
  for (DentFound& dent : known) {
    places.Name(wall.places().FrameTo(dent.position_mm).first.outward, dent);
    const bool from_end = 2.0 * dent.along_mm > length_mm;
    dent.along_sigma_mm =
        std::hypot(dent.along_sigma_mm, from_end ? ends.last_sigma_mm : ends.first_sigma_mm);
  }
  std::stable_sort(known.begin(), known.end(), is_deeper);
  dents = std::move(known);
}

}  // namespace bendloop::pipeline
