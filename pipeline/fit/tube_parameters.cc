// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/tube_parameters.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <optional>

#include "hal/angles.h"
#include "pipeline/fit/surface_sums.h"

namespace bendloop::pipeline {
namespace {

constexpr int kBendRadiusState = kPipeRadiusState - 1;

struct TurnSettings {
  // [rad] Bends below it move in the plane of their turn vectors: angle and plane are polar
  // coordinates near their pole there. By trial.
  double slight_rad = 0.5;
  // [rad] The least angle: a bend of nothing has no plane. Moves the end of a metre by 0.1 mm.
  double least_rad = 1e-4;
};
constexpr TurnSettings kTurn;

// [rad] The last pieces of an eased bend turn by a tenth of this and less, with a radius that the
// easing changes by kilometres; samples feel none of it, but their sums' last digits times its
// square.
constexpr double kFeltRad = 1e-4;

// What a parameter does to the tube behind its place: moves it as a rigid body.
struct RigidMotion {
  int parameter;
  Eigen::Vector3d pivot_mm;
  Eigen::Vector3d velocity;  // of the point there, by the parameter
  Eigen::Vector3d omega;
};

RigidMotion Sliding(int parameter, const Eigen::Vector3d& at_mm, const Eigen::Vector3d& velocity) {
  return {parameter, at_mm, velocity, Eigen::Vector3d::Zero()};
}

RigidMotion Turning(int parameter, const Eigen::Vector3d& at_mm, const Eigen::Vector3d& axis) {
  return {parameter, at_mm, Eigen::Vector3d::Zero(), axis};
}

// The first five parameters. `R`: the start frame's orientation.
// `rolls`: not about itself where nothing feels that. A straight's roll would be what rounding
// makes of nothing, and its frame another one on each processor.
std::vector<RigidMotion> MotionsOfStart(const Eigen::Matrix3d& R, const Eigen::Vector3d& start_mm,
                                        bool rolls) {
  std::vector<RigidMotion> motions{Sliding(0, start_mm, R.col(1)), Sliding(1, start_mm, R.col(2)),
                                   Turning(3, start_mm, R.col(1)), Turning(4, start_mm, R.col(2))};
  if (rolls) motions.push_back(Turning(2, start_mm, R.col(0)));
  return motions;
}

Eigen::Vector3d Inward(const hal::SpineSegment& arc) { return arc.normal.cross(arc.tangent); }

// What is behind an arc turns about the arc's centre.
RigidMotion ByAngle(int parameter, const hal::SpineSegment& arc) {
  return Turning(parameter, arc.start_mm + arc.bend_radius_mm * Inward(arc), arc.normal);
}

// What is behind an arc slides along its chord.
RigidMotion ByBendRadius(int parameter, const hal::SpineSegment& arc) {
  const double a = arc.angle_rad();
  return Sliding(parameter, arc.start_mm,
                 std::sin(a) * arc.tangent + (1.0 - std::cos(a)) * Inward(arc));
}

// The velocities of the segment's frame, in that frame: the first six rows of `derivative`.
void MoveFrame(const std::vector<RigidMotion>& motions, const hal::SpineSegment& segment,
               Eigen::MatrixXd& derivative) {
  const Eigen::Matrix3d to_local = segment.axes().transpose();
  for (const RigidMotion& motion : motions) {
    derivative.block<3, 1>(0, motion.parameter) +=
        to_local * (motion.velocity + motion.omega.cross(segment.start_mm - motion.pivot_mm));
    derivative.block<3, 1>(3, motion.parameter) += to_local * motion.omega;
  }
}

// Angle, radius, and the kernel's variance, reach and skew.
constexpr std::size_t kOfEased = 5;

// What angle, radius and easing of an eased bend do to its pieces and to what is behind: each piece
// turns and slides that by what its own angle and radius change, and the straights beside the bend
// lose what it reaches beyond its tangent points.
class MotionsOfEased {
 public:
  using Parameters = std::array<int, kOfEased>;  // the last may be none: -1

  // `free`: the straights leave room for more easing.
  MotionsOfEased(double angle_rad, double bend_radius_mm, const BendKernel& easing, bool free,
                 const Parameters& parameters)
      : parameters_(parameters), count_(parameters.back() < 0 ? kOfEased - 1 : kOfEased) {
    // Central differences of plain functions: such a part leaves ten digits.
    constexpr double kPart = 1e-5;
    constexpr std::size_t kAtSkew = kOfEased - 1;
    const std::array<double, kOfEased> at = {angle_rad, bend_radius_mm, easing.variance_mm2,
                                             easing.reach, easing.skew.value_or(0.0)};
    for (std::size_t i = 0; i < count_; ++i) {
      if (i == 2 && !free) continue;
      std::array<double, kOfEased> less = at, more = at;
      less[i] = i == kAtSkew ? at[i] - kPart : at[i] * (1.0 - kPart);
      more[i] = i == kAtSkew ? at[i] + kPart : at[i] * (1.0 + kPart);
      const auto eased = [&](const std::array<double, kOfEased>& of) {
        const auto skew = easing.skew ? std::optional(of[kAtSkew]) : std::nullopt;
        return Ease(of[0], of[1], {of[2], of[3], skew, easing.room_mm});
      };
      const EasedBend a = eased(less), b = eased(more);
      const double per = 1.0 / (more[i] - less[i]);
      for (std::size_t k = 0; k < kEasedPieces; ++k) {
        by_[i].pieces[k] = {per * (b.pieces[k].angle_rad - a.pieces[k].angle_rad),
                            per * (b.pieces[k].bend_radius_mm - a.pieces[k].bend_radius_mm)};
      }
      by_[i].before_mm = per * (b.before_mm - a.before_mm);
      by_[i].behind_mm = per * (b.behind_mm - a.behind_mm);
    }
  }

  // `first`: its first piece. What it adds to the motions is added to by each piece.
  void Begin(const hal::SpineSegment& first, std::vector<RigidMotion>& motions) {
    first_motion_ = motions.size();
    for (std::size_t i = 0; i < count_; ++i) {
      motions.push_back(
          Sliding(parameters_[i], Eigen::Vector3d::Zero(), -by_[i].before_mm * first.tangent));
    }
  }
  void Pass(const hal::SpineSegment& segment, std::size_t piece, Eigen::MatrixXd& derivative,
            std::vector<RigidMotion>& motions) const {
    for (std::size_t i = 0; i < count_; ++i) {
      const BendPiece& by = by_[i].pieces[piece];
      if (segment.angle_rad() >= kFeltRad) {
        derivative(kBendRadiusState, parameters_[i]) = by.bend_radius_mm;
      }
      Add(by.angle_rad, ByAngle(parameters_[i], segment), motions[first_motion_ + i]);
      Add(by.bend_radius_mm, ByBendRadius(parameters_[i], segment), motions[first_motion_ + i]);
    }
  }
  void End(const hal::SpineSegment& last, std::vector<RigidMotion>& motions) const {
    for (std::size_t i = 0; i < count_; ++i) {
      motions[first_motion_ + i].velocity -=
          by_[i].behind_mm * last.TangentAt(last.length_mm).normalized();
    }
  }

 private:
  // `to`: about the origin.
  static void Add(double times, const RigidMotion& motion, RigidMotion& to) {
    to.velocity += times * (motion.velocity - motion.omega.cross(motion.pivot_mm));
    to.omega += times * motion.omega;
  }

  Parameters parameters_;
  std::size_t count_;
  std::array<EasedBend, kOfEased> by_{};  // derivatives
  std::size_t first_motion_ = 0;
};

}  // namespace

TubeParameters::TubeParameters(const hal::Tube& reference, bool free_pipe_radius,
                               std::span<const Flattening> flattening, const Easing& easing)
    : reference_(reference),
      flattening_(flattening.begin(), flattening.end()),
      easing_(easing),
      bends_(reference.program.bend_count()) {
  size_ = 5;
  if (free_pipe_radius) pipe_radius_ = size_++;
  for (std::size_t i = 0; i < bends_; ++i) {
    first_bend_.push_back(size_);
    size_ += i == 0 ? 3 : 4;
  }
  first_flattening_ = size_;
  size_ += kFlatteningParameters * static_cast<int>(flattening_.size());
  first_easing_ = size_;
  if (eased()) size_ += static_cast<int>(bends_) + 1;
  if (skewed()) size_ += static_cast<int>(bends_);
}

Eigen::VectorXd TubeParameters::Initial() const {
  Eigen::VectorXd parameters = Eigen::VectorXd::Zero(size_);
  if (pipe_radius_ >= 0) parameters[pipe_radius_] = reference_.pipe_radius_mm;
  for (std::size_t i = 0; i < bends_; ++i) {
    const hal::BendRow& row = reference_.program.rows[i];
    parameters[length(i)] = row.length_mm;
    if (i > 0) parameters[rotation(i)] = row.rotation_deg / hal::kDegreesPerRadian;
    parameters[angle(i)] = row.angle_deg / hal::kDegreesPerRadian;
    parameters[bend_radius(i)] = row.bend_radius_mm.value_or(0.0);
  }
  for (std::size_t i = 0; i < flattening_.size(); ++i) {
    const Flattening& f = flattening_[i];
    parameters.segment<kFlatteningParameters>(flattening(i)) << f.constant, f.bump, f.collapse,
        f.plateau;
  }
  if (!eased()) return parameters;
  for (std::size_t i = 0; i < bends_; ++i) parameters[easing(i)] = easing_.variance_mm2[i];
  parameters[easing_reach()] = easing_.reach;
  for (std::size_t i = 0; skewed() && i < bends_; ++i) {
    parameters[easing_skew(i)] = easing_.of(i).skew.value_or(0.0);
  }
  return parameters;
}

std::vector<TubeParameters::Turn> TubeParameters::TurnsAt(const Eigen::VectorXd& parameters) const {
  std::vector<Turn> turns;
  double azimuth = parameters[2];
  for (std::size_t i = 0; i < bends_; ++i) {
    const hal::BendRow& row = reference_.program.rows[i];
    const double before = row.angle_deg / hal::kDegreesPerRadian;
    const double along = parameters[angle(i)];
    if (i > 0) azimuth += parameters[rotation(i)] - row.rotation_deg / hal::kDegreesPerRadian;
    if (before < kTurn.slight_rad) {
      const double across = before * azimuth;
      turns.push_back(
          {std::max(kTurn.least_rad, std::hypot(along, across)), std::atan2(across, along)});
    } else {
      turns.push_back({std::max(kTurn.least_rad, std::abs(along)),
                       along < 0 ? azimuth + std::numbers::pi : azimuth});
    }
  }
  return turns;
}

hal::Tube TubeParameters::TubeAt(const Eigen::VectorXd& parameters) const {
  hal::Tube tube = reference_;
  const std::vector<Turn> turns = TurnsAt(parameters);
  const double roll = bends_ > 0 ? turns[0].azimuth_change : 0.0;
  const Eigen::Quaterniond turn = Eigen::AngleAxisd(roll, Eigen::Vector3d::UnitX()) *
                                  Eigen::AngleAxisd(parameters[3], Eigen::Vector3d::UnitY()) *
                                  Eigen::AngleAxisd(parameters[4], Eigen::Vector3d::UnitZ());
  tube.X_WT.position_mm +=
      reference_.X_WT.orientation * Eigen::Vector3d(0, parameters[0], parameters[1]);
  tube.X_WT.orientation = (reference_.X_WT.orientation * turn).normalized();
  if (pipe_radius_ >= 0) tube.pipe_radius_mm = parameters[pipe_radius_];
  for (std::size_t i = 0; i < bends_; ++i) {
    hal::BendRow& row = tube.program.rows[i];
    row.length_mm = parameters[length(i)];
    if (i > 0) {
      const double change = turns[i].azimuth_change - turns[i - 1].azimuth_change;
      row.rotation_deg = hal::WrapRotationDeg(reference_.program.rows[i].rotation_deg +
                                              change * hal::kDegreesPerRadian);
    }
    row.angle_deg = turns[i].angle * hal::kDegreesPerRadian;
    row.bend_radius_mm = parameters[bend_radius(i)];
  }
  return tube;
}

std::vector<Flattening> TubeParameters::FlatteningAt(const Eigen::VectorXd& parameters) const {
  std::vector<Flattening> list;
  for (std::size_t i = 0; i < flattening_.size(); ++i) {
    const auto of_bend = parameters.segment<kFlatteningParameters>(flattening(i));
    list.push_back({of_bend[0], of_bend[1], of_bend[2], of_bend[3], flattening_[i].is_wide,
                    flattening_[i].rise});
  }
  return list;
}

Easing TubeParameters::EasingAt(const Eigen::VectorXd& parameters) const {
  Easing at;
  if (!eased()) return at;
  for (std::size_t i = 0; i < bends_; ++i) at.variance_mm2.push_back(parameters[easing(i)]);
  at.reach = parameters[easing_reach()];
  for (std::size_t i = 0; skewed() && i < bends_; ++i) {
    at.skew.push_back(parameters[easing_skew(i)]);
  }
  return at;
}

std::vector<Eigen::MatrixXd> TubeParameters::FrameDerivatives(
    const std::vector<hal::SpineSegment>& segments) const {
  return FrameDerivatives(EasedSpine{segments, 1, std::vector<double>(segments.size(), 1.0)});
}

// A bend's own; of a line those of the bends beside it. Where these begin, and their planes, move
// it, too: by that the derivative is less than it is, as by what moves a bend's section along it.
void TubeParameters::SetFlattening(bool is_line, std::size_t row,
                                   Eigen::MatrixXd& derivative) const {
  if (!is_line) {
    derivative
        .block<kFlatteningParameters, kFlatteningParameters>(kFlatteningState, flattening(row))
        .setIdentity();
    return;
  }
  const auto beside = [&](std::size_t of_bend, int state) {
    derivative(state, flattening(of_bend)) = 1.0;
    derivative(state + 1, flattening(of_bend) + 2) = 1.0;
    derivative(state + 1, flattening(of_bend) + 3) = 1.0;
  };
  if (row > 0) beside(row - 1, kFlatteningState);
  if (row < bends_) beside(row, kFlatteningState + 2);
}

std::vector<Eigen::MatrixXd> TubeParameters::FrameDerivatives(const EasedSpine& spine) const {
  const auto& segments = spine.segments;
  std::vector<RigidMotion> motions = MotionsOfStart(reference_.X_WT.orientation.toRotationMatrix(),
                                                    segments.front().start_mm, bends_ > 0);
  std::vector<Eigen::MatrixXd> derivatives;
  derivatives.reserve(segments.size());
  const Easing within = EasingWithin(reference_.program, easing_);
  std::optional<MotionsOfEased> of_eased;
  for (std::size_t k = 0; k < segments.size(); ++k) {
    const hal::SpineSegment& segment = segments[k];
    const std::size_t bend = spine.row(k);
    Eigen::MatrixXd& derivative =
        derivatives.emplace_back(Eigen::MatrixXd::Zero(kLocalState, size_));
    if (pipe_radius_ >= 0) derivative(kPipeRadiusState, pipe_radius_) = 1.0;
    if (flattened()) SetFlattening(spine.is_line(k), bend, derivative);
    if (spine.pieces > 1 && !spine.is_line(k)) {
      if (spine.is_line(k - 1)) {
        const hal::BendRow& row = reference_.program.rows[bend];
        of_eased.emplace(
            row.angle_deg / hal::kDegreesPerRadian, row.bend_radius_mm.value_or(0.0),
            within.of(bend), within.variance_mm2[bend] == easing_.variance_mm2[bend],
            MotionsOfEased::Parameters{angle(bend), bend_radius(bend), easing(bend), easing_reach(),
                                       skewed() ? easing_skew(bend) : -1});
        of_eased->Begin(segment, motions);
      }
      MoveFrame(motions, segment, derivative);
      of_eased->Pass(segment, k % (spine.pieces + 1) - 1, derivative, motions);
      if (spine.is_line(k + 1)) of_eased->End(segment, motions);
      continue;
    }
    const bool leads_to_bend = spine.is_line(k) && bend < bends_;
    if (leads_to_bend && bend > 0) {
      motions.push_back(Turning(rotation(bend), segment.start_mm, segment.tangent));
    }
    MoveFrame(motions, segment, derivative);
    if (leads_to_bend) {
      motions.push_back(Sliding(length(bend), segment.start_mm, segment.tangent));
    }
    if (spine.is_line(k)) continue;
    derivative(kBendRadiusState, bend_radius(bend)) = 1.0;
    motions.push_back(ByAngle(angle(bend), segment));
    motions.push_back(ByBendRadius(bend_radius(bend), segment));
  }
  return derivatives;
}

}  // namespace bendloop::pipeline
