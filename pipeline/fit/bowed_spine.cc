// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/bowed_spine.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <utility>

#include "hal/angles.h"
#include "hal/spine.h"
#include "pipeline/fit/place_sums.h"
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
  // That stand for it.
  int places = 40;
};
constexpr MiddleSettings kMiddle;

struct ExtentSettings {
  // [of a straight's points] Beyond which lie fliers: the straight ends so much of its length
  // beyond the others. So many at least tell of its end. By trial.
  double part = 0.002;
  Eigen::Index least_points = 50;
};
constexpr ExtentSettings kExtent;
constexpr double kLeast = 1e-4;  // of a bow: what is less of it is none

double AlongAt(const SegmentPoints& points, double part) {
  const auto count = static_cast<std::ptrdiff_t>(points.size);
  return Quantile(std::vector<double>(points.x.data(), points.x.data() + count), part);
}

// [mm] How far the spine lies beside a line that goes straight on, `x_mm` from its start.
Eigen::Vector3d BesideLine(const EasedSpine& spine, std::size_t segment, double x_mm) {
  const double length_mm = spine.segments[segment].length_mm;
  if (x_mm >= 0 && x_mm <= length_mm) return Eigen::Vector3d::Zero();
  const bool is_behind = x_mm > length_mm;
  const auto last = is_behind ? spine.segments.size() - 1 : std::size_t{0};
  double left_mm = is_behind ? x_mm - length_mm : -x_mm;
  if (segment == last) return Eigen::Vector3d::Zero();
  std::size_t k = is_behind ? segment + 1 : segment - 1;
  const hal::SpineSegment& next = spine.segments[k];
  const Eigen::Vector3d joint_mm = is_behind ? next.start_mm : next.PointAt(next.length_mm);
  const Eigen::Vector3d along = is_behind ? next.tangent : next.TangentAt(next.length_mm);
  while (k != last && left_mm > spine.segments[k].length_mm) {
    left_mm -= spine.segments[k].length_mm;
    is_behind ? ++k : --k;
  }
  const hal::SpineSegment& here = spine.segments[k];
  const Eigen::Vector3d from_joint_mm =
      here.PointAt(is_behind ? left_mm : here.length_mm - left_mm) - joint_mm;
  return from_joint_mm - from_joint_mm.dot(along) * along;
}

// Turns about a place and moves.
class RigidMotion {
 public:
  RigidMotion(Eigen::Vector3d pivot_mm, Eigen::Vector3d move_mm, const Eigen::Vector3d& turn)
      : pivot_mm_(std::move(pivot_mm)), move_mm_(std::move(move_mm)) {
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

// What a small motion of `segment`'s frame does to a rigid body.
RigidMotion MotionOf(const hal::SpineSegment& segment,
                     const Eigen::Matrix<double, kLocalState, 1>& motion) {
  return {segment.start_mm, segment.axes() * motion.head<3>(),
          segment.axes() * motion.segment<3>(3)};
}

// How much of a straight's bow is left `into_mm` deep in the bend beside it, which begins to ease
// `beyond_mm` before the tangent point: as much as is not of the bend's curvature yet.
double BowLeft(double into_mm, double beyond_mm, double variance_mm2) {
  return 0.5 * std::erfc((into_mm - beyond_mm) / std::sqrt(2.0 * variance_mm2));
}

}  // namespace

BowMotion ToBestFitLine(const Bow& bow, double line_mm) {
  const double along_mm = 0.5 * (1.0 + bow.middle.center()) * bow.LengthMm(line_mm) - bow.before_mm;
  return BowMotionOf(bow, BowLinesOf(bow.middle), along_mm, line_mm);
}

std::vector<BowHinge> BowHinges(const EasedSpine& spine, const Easing& within, const Bow& bow,
                                std::size_t segment, bool behind) {
  std::vector<BowHinge> hinges;
  const std::size_t row = spine.row(segment);
  const double beyond_mm = behind ? bow.after_mm : bow.before_mm;
  if (within.empty() || !(beyond_mm > 0)) return hinges;
  const hal::SpineSegment& line = spine.segments[segment];
  const double variance_mm2 = within.variance_mm2[behind ? row : row - 1];
  const double by_mm = 2.0 / bow.LengthMm(line.length_mm);
  double into_mm = 0;
  for (std::size_t i = 1; i <= spine.pieces; ++i) {
    const std::size_t at = behind ? segment + i : segment - i;
    const hal::SpineSegment& piece = spine.segments[at];
    const double middle_mm = into_mm + 0.5 * piece.length_mm;
    into_mm += piece.length_mm;
    const double left = BowLeft(middle_mm, beyond_mm, variance_mm2);
    if (left < kLeast) break;
    const auto curvatures =
        BowCurvaturesAt(bow.At(behind ? line.length_mm + middle_mm : -middle_mm, line.length_mm));
    // The line's axes in the frame that does not twist.
    const Eigen::Matrix3d axes =
        Eigen::Quaterniond::FromTwoVectors(line.tangent, piece.TangentAt(0.5 * piece.length_mm)) *
        line.axes();
    BowHinge hinge;
    for (std::size_t s = 0; s < kBowShapes; ++s) {
      const double half_turn = 0.5 * left * curvatures[s] * by_mm * by_mm * piece.length_mm;
      hinge.turn.col(static_cast<Eigen::Index>(2 * s)) = half_turn * axes.col(2);
      hinge.turn.col(static_cast<Eigen::Index>(2 * s + 1)) = -half_turn * axes.col(1);
    }
    // A piece stays one: it is turned as the line is that fits a parabola best, and what is behind
    // it as the parabola's end.
    for (const auto& [of, part] : {std::pair(at, 1.0 / 6.0), std::pair(at + 1, 5.0 / 6.0)}) {
      hinge.segment = of;
      hinge.place_mm = piece.PointAt(part * piece.length_mm);
      hinges.push_back(hinge);
    }
  }
  return hinges;
}

EasedSpine SpineOf(const BowedTubeState& state) {
  EasedSpine spine = SpineOf(state.tube.program, state.tube.X_WT, state.easing);
  auto& segments = spine.segments;
  const Easing within = EasingWithin(state.tube.program, state.easing);
  const auto turn_at_hinges = [&](std::size_t k, bool behind) {
    for (const BowHinge& hinge : BowHinges(spine, within, state.bows[k], k, behind)) {
      const RigidMotion motion(hinge.place_mm, Eigen::Vector3d::Zero(),
                               hinge.turn * state.bows[k].modes_mm);
      for (std::size_t i = hinge.segment; i < segments.size(); ++i)
        segments[i] = motion(segments[i]);
    }
  };
  for (std::size_t k = 0; k < segments.size() && k < state.bows.size(); ++k) {
    const Bow& bow = state.bows[k];
    const double line_mm = segments[k].length_mm;
    if (bow.is_none() || !(line_mm > 0)) continue;
    turn_at_hinges(k, false);
    const hal::SpineSegment straight = segments[k];
    const BowMotion to_end =
        BowMotionOf(bow, BowShapesAt(bow.At(line_mm, line_mm)), line_mm, line_mm);
    const RigidMotion rest = MotionOf(straight, to_end * bow.modes_mm);
    for (std::size_t i = k + 1; i < segments.size(); ++i) segments[i] = rest(segments[i]);
    turn_at_hinges(k, true);
    segments[k] = MotionOf(straight, ToBestFitLine(bow, line_mm) * bow.modes_mm)(straight);
  }
  return spine;
}

Bow ExtentOf(const BowedTubeState& state, const EasedSpine& spine, std::size_t segment) {
  const double line_mm = spine.segments[segment].length_mm;
  const std::size_t row = spine.row(segment), bends = state.tube.program.bend_count();
  const Easing within = EasingWithin(state.tube.program, state.easing);
  double eased_mm2 = 0;
  const auto eased = [&](std::size_t bend) {
    if (within.empty()) return EasedBend{};
    const hal::BendRow& of_bend = state.tube.program.rows[bend];
    return Ease(of_bend.angle_deg * hal::kRadiansPerDegree, of_bend.bend_radius_mm.value_or(0.0),
                within.of(bend));
  };
  for (const double variance : state.easing.variance_mm2) {
    eased_mm2 += variance / static_cast<double>(bends);
  }
  Bow bow;
  bow.before_mm = row > 0 ? eased(row - 1).behind_mm : 0.0;
  bow.after_mm = row < bends ? eased(row).before_mm : 0.0;
  const double straight_mm = std::max(1e-9, bow.LengthMm(line_mm));
  const double off_mm = std::clamp(kMiddle.eased * std::sqrt(std::max(0.0, eased_mm2)),
                                   kMiddle.beside_bend * straight_mm, kMiddle.most * straight_mm);
  bow.middle = {2.0 * off_mm / straight_mm - 1.0, 1.0 - 2.0 * off_mm / straight_mm};
  return bow;
}

Eigen::Matrix<double, kLocalState, 1> TailsOf(const EasedSpine& spine, const Bow& straight,
                                              std::size_t segment) {
  Eigen::Matrix<double, kLocalState, 1> motion = Eigen::Matrix<double, kLocalState, 1>::Zero();
  const hal::SpineSegment& line = spine.segments[segment];
  const double half_mm = 0.5 * straight.LengthMm(line.length_mm);
  const double from_mm = (1.0 + straight.middle.from) * half_mm - straight.before_mm;
  const double to_mm = (1.0 + straight.middle.to) * half_mm - straight.before_mm;
  if (from_mm >= 0 && to_mm <= line.length_mm) return motion;
  // Least squares over places as far from each other.
  const Eigen::Matrix<double, 2, 3> across = line.axes().rightCols<2>().transpose();
  const double center_mm = 0.5 * (from_mm + to_mm);
  Eigen::Vector2d off_mm = Eigen::Vector2d::Zero(), slope = Eigen::Vector2d::Zero();
  double spread_mm2 = 0;
  for (int i = 0; i < kMiddle.places; ++i) {
    const double x_mm = from_mm + (i + 0.5) / kMiddle.places * (to_mm - from_mm);
    const Eigen::Vector2d beside_mm = across * BesideLine(spine, segment, x_mm);
    off_mm += beside_mm / kMiddle.places;
    slope += (x_mm - center_mm) * beside_mm;
    spread_mm2 += (x_mm - center_mm) * (x_mm - center_mm);
  }
  slope /= std::max(1e-9, spread_mm2);
  motion.segment<2>(1) = off_mm - center_mm * slope;
  motion[4] = -slope[1];
  motion[5] = slope[0];
  return motion;
}

SurfaceAssignment PointsOf(const BowedTubeState& state, const EasedSpine& spine, double beyond_mm,
                           std::span<const PointBlock> blocks, double reach_mm) {
  const double r_mm = state.tube.pipe_radius_mm;
  SurfaceAssignment points;
  const auto frames = SegmentFrames(spine, beyond_mm, state.flattening);
  AssignPoints(frames, r_mm, blocks, reach_mm, points);
  for (std::size_t k = 0; k < points.segments.size() && k < state.bows.size(); ++k) {
    Straighten(state.bows[k], frames[k], spine.segments[k].length_mm, r_mm, points.segments[k]);
  }
  return points;
}

std::array<std::optional<double>, 2> PointsBeyond(const BowedTubeState& state,
                                                  std::span<const PointBlock> blocks,
                                                  double reach_mm) {
  const double r_mm = state.tube.pipe_radius_mm;
  const EasedSpine spine = SpineOf(state);
  SurfaceAssignment points;
  AssignPoints(SegmentFrames(spine, kBeyond * r_mm, state.flattening), r_mm, blocks, reach_mm,
               points);
  const auto tells = [](const SegmentPoints& of) {
    return static_cast<Eigen::Index>(of.size) >= kExtent.least_points;
  };
  std::array<std::optional<double>, 2> beyond_mm;
  if (const SegmentPoints& first = points.segments.front(); tells(first)) {
    const double to_mm = spine.segments.front().length_mm;
    beyond_mm[0] = (to_mm - AlongAt(first, kExtent.part)) / (1.0 - kExtent.part) - to_mm;
  }
  if (const SegmentPoints& last = points.segments.back(); tells(last)) {
    beyond_mm[1] =
        AlongAt(last, 1.0 - kExtent.part) / (1.0 - kExtent.part) - spine.segments.back().length_mm;
  }
  return beyond_mm;
}

void EndWithPoints(std::span<const PointBlock> blocks, double reach_mm,
                   const std::array<double, 2>& beyond_mm, BowedTubeState& state) {
  const auto points_mm = PointsBeyond(state, blocks, reach_mm);
  auto& rows = state.tube.program.rows;
  if (points_mm[1]) {
    rows.back().length_mm = std::max(0.0, rows.back().length_mm + *points_mm[1] + beyond_mm[1]);
  }
  if (points_mm[0]) {
    const double longer_mm = std::max(*points_mm[0] + beyond_mm[0], -rows.front().length_mm);
    rows.front().length_mm += longer_mm;
    state.tube.X_WT.position_mm -=
        longer_mm * (state.tube.X_WT.orientation * Eigen::Vector3d::UnitX());
  }
}

}  // namespace bendloop::pipeline
