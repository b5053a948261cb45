// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/bowed_spine.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "hal/angles.h"
#include "hal/spine.h"
#include "pipeline/fit/surface_pass.h"
#include "pipeline/fit/surface_sums.h"
#include "pipeline/math/quantiles.h"

namespace bendloop::pipeline {
namespace {

struct MiddleSettings {
  // [of a straight] Beside each end, at least and at most.
  double beside_bend = 0.125, most = 0.4;
  // [easing lengths] A Gaussian's curvature is gone to 2 % there.
  double eased = 2.0;
};
constexpr MiddleSettings kMiddle;

struct ExtentSettings {
  // [of a straight's points] Beyond which lie fliers: the straight ends so much of its length
  // beyond the others. So many at least tell of its end. By trial.
  double part = 0.002;
  Eigen::Index least_points = 50;
};
constexpr ExtentSettings kExtent;

double AlongAt(const SegmentPoints& points, double part) {
  const auto count = static_cast<std::ptrdiff_t>(points.size);
  return Quantile(std::vector<double>(points.x.data(), points.x.data() + count), part);
}

// Turned and moved as a rigid body by what a small motion of `segment`'s frame is.
class FrameMotion {
 public:
  FrameMotion(const hal::SpineSegment& segment, const Eigen::Matrix<double, kLocalState, 1>& motion)
      : pivot_mm_(segment.start_mm), move_mm_(segment.axes() * motion.head<3>()) {
    const Eigen::Vector3d turn = segment.axes() * motion.segment<3>(3);
    const double angle = turn.norm();
    if (angle > 0) turn_ = Eigen::AngleAxisd(angle, turn / angle);
  }
  hal::SpineSegment operator()(hal::SpineSegment segment) const {
    segment.start_mm = pivot_mm_ + move_mm_ + turn_ * (segment.start_mm - pivot_mm_);
    segment.tangent = turn_ * segment.tangent;
    segment.normal = turn_ * segment.normal;
    return segment;
  }

 private:
  Eigen::Vector3d pivot_mm_, move_mm_;
  Eigen::Quaterniond turn_ = Eigen::Quaterniond::Identity();
};

}  // namespace

BowMotion ToBestFitLine(const Bow& bow, double length_mm) {
  return BowMotionOf(BowLinesOf(bow.middle), 0.5 * (1.0 + bow.middle.center()) * length_mm,
                     length_mm);
}

EasedSpine SpineOf(const BowedTubeState& state) {
  EasedSpine spine = SpineOf(state.tube.program, state.tube.X_WT, state.easing);
  auto& segments = spine.segments;
  for (std::size_t k = 0; k < segments.size() && k < state.bows.size(); ++k) {
    const Bow& bow = state.bows[k];
    const double length_mm = segments[k].length_mm;
    if (bow.is_none() || !(length_mm > 0)) continue;
    const hal::SpineSegment straight = segments[k];
    const BowMotion to_end = BowMotionOf(BowShapesAt(1.0), length_mm, length_mm);
    const FrameMotion behind(straight, to_end * bow.modes_mm);
    for (std::size_t i = k + 1; i < segments.size(); ++i) segments[i] = behind(segments[i]);
    segments[k] = FrameMotion(straight, ToBestFitLine(bow, length_mm) * bow.modes_mm)(straight);
  }
  return spine;
}

StraightMiddle MiddleOf(const BowedTubeState& state, const EasedSpine& spine, std::size_t segment) {
  const double line_mm = spine.segments[segment].length_mm;
  const std::size_t row = spine.row(segment), bends = state.tube.program.bend_count();
  const Easing within = EasingWithin(state.tube.program, state.easing);
  double eased_mm2 = 0;
  const auto beyond_mm = [&](std::size_t bend) {
    if (within.empty()) return 0.0;
    const hal::BendRow& of_bend = state.tube.program.rows[bend];
    return Ease(of_bend.angle_deg * hal::kRadiansPerDegree, of_bend.bend_radius_mm.value_or(0.0),
                within.variance_mm2[bend], within.reach, within.room_of_mm(bend))
        .beyond_mm;
  };
  for (const double variance : state.easing.variance_mm2) {
    eased_mm2 += variance / static_cast<double>(bends);
  }
  const double before_mm = row > 0 ? beyond_mm(row - 1) : 0.0;
  const double after_mm = row < bends ? beyond_mm(row) : 0.0;
  const double straight_mm = line_mm + before_mm + after_mm;
  const double off_mm = std::clamp(kMiddle.eased * std::sqrt(std::max(0.0, eased_mm2)),
                                   kMiddle.beside_bend * straight_mm, kMiddle.most * straight_mm);
  const auto at = [&](double along_mm) {
    return std::clamp(2.0 * (along_mm - before_mm) / std::max(1e-9, line_mm) - 1.0, -1.0, 1.0);
  };
  return {at(off_mm), at(straight_mm - off_mm)};
}

void EndWithPoints(std::span<const PointBlock> blocks, double reach_mm, BowedTubeState& state) {
  const double r_mm = state.tube.pipe_radius_mm;
  const EasedSpine spine = SpineOf(state);
  SurfaceAssignment points;
  AssignPoints(SegmentFrames(spine, kBeyond * r_mm, state.flattening), r_mm, blocks, reach_mm,
               points);
  auto& rows = state.tube.program.rows;
  const auto tells = [](const SegmentPoints& of) {
    return static_cast<Eigen::Index>(of.size) >= kExtent.least_points;
  };
  if (const SegmentPoints& last = points.segments.back(); tells(last)) {
    const double to_mm = AlongAt(last, 1.0 - kExtent.part) / (1.0 - kExtent.part);
    rows.back().length_mm =
        std::max(0.0, rows.back().length_mm + to_mm - spine.segments.back().length_mm);
  }
  if (const SegmentPoints& first = points.segments.front(); tells(first)) {
    const double to_mm = spine.segments.front().length_mm;
    const double points_mm = (to_mm - AlongAt(first, kExtent.part)) / (1.0 - kExtent.part);
    const double from_mm = std::min(to_mm - points_mm, rows.front().length_mm);
    rows.front().length_mm -= from_mm;
    state.tube.X_WT.position_mm +=
        from_mm * (state.tube.X_WT.orientation * Eigen::Vector3d::UnitX());
  }
}

}  // namespace bendloop::pipeline
