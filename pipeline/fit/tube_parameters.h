// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

#include "hal/spine.h"
#include "hal/tube.h"
#include "pipeline/tube/easing.h"
#include "pipeline/tube/flattening.h"

namespace bendloop::pipeline {

// The LRA parameters of a tube as one vector, relative to a start pose, with the derivative of
// every segment's frame. All angles in radians.
//   0, 1     start point across the first tangent (tube frame y, z) [mm]
//   2, 3, 4  turn of the start frame: X_WT = reference * Rx Ry Rz (2 is left out for a straight)
//   then     pipe radius [mm]
//   then, bend by bend: length before it [mm], rotation (not for the first), angle, bend radius
//   [mm]
//   then, bend by bend, if the bends are flattened: the members of Flattening
//   then, bend by bend, if the bends are eased: the easing's variance [mm^2]; then its reach; then,
//   bend by bend, if they may rise otherwise than they fall: its skew
// The last length is no parameter: it moves no surface point.
class TubeParameters {
 public:
  // `flattening`: of every bend, or none: the bends are round. `easing`: the same; sharp.
  TubeParameters(const hal::Tube& reference, bool free_pipe_radius,
                 std::span<const Flattening> flattening = {}, const Easing& easing = {});

  int size() const { return size_; }
  std::size_t bends() const { return bends_; }
  Eigen::VectorXd Initial() const;
  hal::Tube TubeAt(const Eigen::VectorXd& parameters) const;
  std::vector<Flattening> FlatteningAt(const Eigen::VectorXd& parameters) const;
  Easing EasingAt(const Eigen::VectorXd& parameters) const;

  // Positions in the vector; -1: not a parameter.
  int pipe_radius() const { return pipe_radius_; }
  int length(std::size_t bend) const { return first_bend_[bend]; }
  int rotation(std::size_t bend) const { return bend == 0 ? -1 : first_bend_[bend] + 1; }
  int angle(std::size_t bend) const { return first_bend_[bend] + (bend == 0 ? 1 : 2); }
  int bend_radius(std::size_t bend) const { return angle(bend) + 1; }
  bool flattened() const { return !flattening_.empty(); }
  int flattening(std::size_t bend) const {  // the first
    return first_flattening_ + kFlatteningParameters * static_cast<int>(bend);
  }

  bool eased() const { return !easing_.empty(); }
  int easing(std::size_t bend) const { return first_easing_ + static_cast<int>(bend); }
  int easing_reach() const { return easing(bends_); }
  bool skewed() const { return !easing_.skew.empty(); }
  int easing_skew(std::size_t bend) const { return easing_reach() + 1 + static_cast<int>(bend); }

  // For each segment of the reference the kLocalState x size() derivative of its local state
  // (surface_sums.h), by the parameters at Initial(). `spine`: of the reference.
  std::vector<Eigen::MatrixXd> FrameDerivatives(const EasedSpine& spine) const;
  // The same as if its bends were sharp.
  std::vector<Eigen::MatrixXd> FrameDerivatives(
      const std::vector<hal::SpineSegment>& segments) const;

 private:
  // A bend's angle and by how much its plane has turned about the tangent, as carried along the
  // spine without twist.
  struct Turn {
    double angle, azimuth_change;
  };
  // Angle and plane of a slight bend are polar coordinates near their pole, where long steps go
  // astray: such bends move straight on in the plane of these.
  std::vector<Turn> TurnsAt(const Eigen::VectorXd& parameters) const;
  // What flattening does to a segment's local state. `row`: of the program.
  void SetFlattening(bool is_line, std::size_t row, Eigen::MatrixXd& derivative) const;

  hal::Tube reference_;
  std::vector<Flattening> flattening_;
  Easing easing_;
  std::size_t bends_;
  int size_ = 0;
  int pipe_radius_ = -1;
  int first_flattening_ = -1;
  int first_easing_ = -1;
  std::vector<int> first_bend_;
};

}  // namespace bendloop::pipeline
