// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/bowed_tube.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include "pipeline/fit/fit_priors.h"
#include "pipeline/fit/normal_equations.h"
#include "pipeline/math/cross_matrix.h"
#include "pipeline/math/dense_product.h"
#include "pipeline/math/dense_solve.h"
#include "pipeline/math/quantiles.h"

namespace bendloop::pipeline {
namespace {

constexpr double kHeld = 1e-9;  // 1 sigma of a number that stays 0

}  // namespace

void BowedTube::Take(std::span<const PointBlock> blocks, double sigma_mm) {
  places_ = SumPlaces(spine_, frames_, r_mm_, kBowed.place * r_mm_, blocks, options_.reach_mm,
                      sigma_mm, state_.bows);
  SetNoise();
  SumKnown();
  worth_ = {1.0, 1.0};
}

void BowedTube::Solve(bool with_bows) {
  for (int i = 0; i < kBowed.steps; ++i) {
    const std::array<double, 2> worth = worth_;
    Assemble(with_bows);
    const Eigen::VectorXd range = Ranges();
    Eigen::MatrixXd informed = matrix_;
    for (int k = 0; k < size_; ++k) {
      if (std::isfinite(range[k])) informed(k, k) += noise_mm2_ / (range[k] * range[k]);
      if (!(informed(k, k) > 0)) informed(k, k) = 1.0;
    }
    const Eigen::VectorXd scale = informed.diagonal().cwiseSqrt().cwiseInverse();
    informed = scale.asDiagonal() * informed * scale.asDiagonal();
    inverse_ = scale.asDiagonal() *
               SolveSymmetric(informed, Eigen::MatrixXd::Identity(size_, size_)) *
               scale.asDiagonal();
    step_ = inverse_ * right_;
    SetWorth();
    if (worth_ == worth) break;  // as it would be again
  }
}

void BowedTube::SetMotions() {
  derivatives_ = parameters_.FrameDerivatives(spine_);
  const auto& segments = spine_.segments;
  motions_.assign(segments.size(), Eigen::MatrixXd::Zero(kLocalState, size_));
  for (std::size_t k = 0; k < segments.size(); ++k) {
    motions_[k].leftCols(parameters_.size()) = derivatives_[k];
  }
  const Easing within = EasingWithin(state_.tube.program, state_.easing);
  for (std::size_t j = 0; j < segments.size(); ++j) {
    if (own_[j] < 0) continue;
    const Bow& bow = state_.bows[j];
    for (const bool behind : {false, true}) {
      for (const BowHinge& hinge : BowHinges(spine_, within, bow, j, behind)) {
        AddTurn(j, hinge.segment, hinge.place_mm, Eigen::Matrix<double, 3, kBowModes>::Zero(),
                hinge.turn);
      }
    }
    // As the motion of its frame, which all behind it follow.
    const double length_mm = segments[j].length_mm;
    const BowMotion end =
        BowMotionOf(bow, BowShapesAt(bow.At(length_mm, length_mm)), length_mm, length_mm);
    const Eigen::Matrix3d axes = segments[j].axes();
    AddTurn(j, j + 1, segments[j].start_mm, axes * end.topRows<3>(), axes * end.middleRows<3>(3));
  }
}

void BowedTube::AddTurn(std::size_t j, std::size_t first, const Eigen::Vector3d& place_mm,
                        const Eigen::Matrix<double, 3, kBowModes>& velocity,
                        const Eigen::Matrix<double, 3, kBowModes>& turn) {
  const auto& segments = spine_.segments;
  for (std::size_t k = first; k < segments.size(); ++k) {
    const Eigen::Matrix3d to_local = segments[k].axes().transpose();
    const Eigen::Matrix3d arm = CrossMatrix(segments[k].start_mm - place_mm);
    motions_[k].block<3, kBowModes>(0, own_[j]) += to_local * (velocity - arm * turn);
    motions_[k].block<3, kBowModes>(3, own_[j]) += to_local * turn;
  }
}

void BowedTube::SetShapes() {
  for (std::size_t k = 0; k < motions_.size(); ++k) {
    if (!parameters_.eased() || spine_.is_line(k)) continue;
    motions_[k].col(first_shape_ + static_cast<int>(spine_.row(k))) =
        derivatives_[k].col(parameters_.easing_reach());
  }
}

void BowedTube::SetNoise() {
  double squares_mm2 = 0, weight = 0;
  ranks_.clear();
  inverses_.clear();
  for (const PlaceSum& place : places_) {
    const PlaceInverse inverse = InverseOf(place.sum);
    inverses_.push_back(inverse.of_felt);
    ranks_.push_back(inverse.rank);
    const LocalVector pull = PullOf(place.sum);
    squares_mm2 += place.sum(kLocalState, kLocalState) - pull.dot(inverses_.back() * pull);
    weight += std::max(0.0, place.sum(kPipeRadiusState, kPipeRadiusState) - inverse.rank);
  }
  noise_mm2_ = std::max(1e-12, squares_mm2 / std::max(1.0, weight));
}

void BowedTube::SumKnown() {
  for (Known& known : known_) {
    known.information.setZero(size_, size_);
    known.right.setZero(size_);
  }
  std::size_t next = 0;
  for (std::size_t k = 0; k < frames_.size(); ++k) {
    CondensedSum whole = CondensedSum::Zero();
    const std::size_t first = next;
    for (; next < places_.size() && places_[next].segment == k; ++next) {
      whole += places_[next].sum;
    }
    const Eigen::MatrixXd& motion = motions_[k];
    auto& [information, right] = known_[ClassOf(k)];
    information += TransposeProduct(motion, Product(InformationOf(whole), motion));
    right.noalias() -= motion.transpose() * PullOf(whole);
    if (own_[k] < 0) continue;
    BowMotion with_motion = BowMotion::Zero();
    auto with_itself = Eigen::Matrix<double, kBowModes, kBowModes>::Zero().eval();
    BowModes pull = BowModes::Zero();
    for (std::size_t i = first; i < next; ++i) {
      const BowMotion field = OwnMotion(places_[i]);
      const BowMotion felt = InformationOf(places_[i].sum) * field;
      with_motion += felt;
      with_itself += field.transpose() * felt;
      pull += field.transpose() * PullOf(places_[i].sum);
    }
    const Eigen::MatrixXd cross = TransposeProduct(motion, with_motion);
    information.middleCols<kBowModes>(own_[k]) += cross;
    information.middleRows<kBowModes>(own_[k]) += cross.transpose();
    information.block<kBowModes, kBowModes>(own_[k], own_[k]) += with_itself;
    right.segment<kBowModes>(own_[k]) -= pull;
  }
}

void BowedTube::Assemble(bool with_bows) {
  matrix_ = known_[0].information / worth_[0] + known_[1].information / worth_[1];
  right_ = known_[0].right / worth_[0] + known_[1].right / worth_[1];
  AddPriors(with_bows);
}

void BowedTube::AddPriors(bool with_bows) {
  const int n = parameters_.size();
  Eigen::MatrixXd of_tube = Eigen::MatrixXd::Zero(n, n);
  Eigen::VectorXd right = Eigen::VectorXd::Zero(n);
  fit_.priors.Add(parameters_, parameters_.Initial(), std::sqrt(noise_mm2_), of_tube, right);
  matrix_.topLeftCorner(n, n) += of_tube;
  right_.head(n) += right;
  for (std::size_t k = 0; k < own_.size(); ++k) {
    if (own_[k] < 0) continue;
    const double length_mm = LengthOf(k);
    for (int mode = 0; mode < kBowModes; ++mode) {
      const double range_mm = BowRangeMm(static_cast<std::size_t>(mode / 2), length_mm);
      const double certainty = noise_mm2_ / (with_bows ? range_mm * range_mm : kHeld * kHeld);
      matrix_(own_[k] + mode, own_[k] + mode) += certainty;
      right_[own_[k] + mode] -= certainty * state_.bows[k].modes_mm[mode];
    }
  }
  // A bow beside a slight bend is as good as another radius of that: what the samples do not know
  // is as usual, within ExpectedRange().
  const Eigen::VectorXd range = Ranges();
  for (std::size_t i = 0; usual_radius_mm_ && i < parameters_.bends(); ++i) {
    const int at = parameters_.bend_radius(i);
    right_[at] +=
        noise_mm2_ / (range[at] * range[at]) * (*usual_radius_mm_ - parameters_.Initial()[at]);
  }
  for (int i = first_shape_; i < size_; ++i) {
    matrix_(i, i) += noise_mm2_ / std::pow(with_bows ? kBowed.shape : kHeld, 2);
  }
}

Eigen::VectorXd BowedTube::Ranges() const {
  Eigen::VectorXd range = Eigen::VectorXd::Constant(size_, std::numeric_limits<double>::infinity());
  range.head(parameters_.size()) = ExpectedRange(parameters_, r_mm_);
  return range;
}

Eigen::MatrixXd BowedTube::MotionOf(const PlaceSum& place) const {
  const std::size_t k = place.segment;
  Eigen::MatrixXd motion = motions_[k];
  if (own_[k] >= 0) motion.middleCols<kBowModes>(own_[k]) += OwnMotion(place);
  return motion;
}

LocalVector BowedTube::LeftPull(const PlaceSum& place) const {
  const std::size_t k = place.segment;
  LocalVector moved = motions_[k] * step_;
  if (own_[k] >= 0) moved += OwnMotion(place) * step_.segment<kBowModes>(own_[k]);
  return PullOf(place.sum) + InformationOf(place.sum) * moved;
}

double BowedTube::Left() const {
  double left = 0;
  for (std::size_t i = 0; i < places_.size(); ++i) left += LeftAt(i);
  return left;
}

void BowedTube::SetWorth() {
  const std::array<double, 2> worth = worth_;
  std::array<double, 2> chi_square{}, freedom{};
  for (std::size_t i = 0; i < places_.size(); ++i) {
    const std::size_t k = places_[i].segment;
    chi_square[ClassOf(k)] += LeftAt(i);
    freedom[ClassOf(k)] += ranks_[i];
  }
  // What the numbers take of it: the trace of what the places know times the covariance.
  for (const std::size_t c : {std::size_t{0}, std::size_t{1}}) {
    freedom[c] -= known_[c].information.cwiseProduct(inverse_).sum() / worth[c];
  }
  for (const std::size_t c : {std::size_t{0}, std::size_t{1}}) {
    worth_[c] = freedom[c] > 1 ? std::max(1.0, chi_square[c] / freedom[c]) : worth_[0];
  }
}

BowedTubeState BowedTube::Next() const {
  const Eigen::VectorXd to = Within(step_);
  BowedTubeState next{parameters_.TubeAt(to), parameters_.FlatteningAt(to),
                      parameters_.EasingAt(to), state_.bows};
  for (std::size_t k = 0; k < own_.size(); ++k) {
    if (own_[k] >= 0) next.bows[k].modes_mm = BowAt(k, step_);
  }
  return next;
}

std::optional<double> BowedTube::UsualRadius() const {
  std::vector<double> known_mm;
  for (std::size_t i = 0; i < parameters_.bends(); ++i) {
    const int at = parameters_.bend_radius(i);
    const double radius_mm = parameters_.Initial()[at] + step_[at];
    const double variance_mm2 = noise_mm2_ * std::max(0.0, inverse_(at, at));
    if (std::sqrt(variance_mm2) < kBowed.known_radius * radius_mm) known_mm.push_back(radius_mm);
  }
  if (known_mm.empty()) return std::nullopt;
  return Median(std::move(known_mm));
}

bool BowedTube::IsSolved() const {
  for (std::size_t k = 0; k < own_.size(); ++k) {
    if (own_[k] < 0) continue;
    const double height_mm = BowAt(k, step_).cwiseAbs().maxCoeff();
    if (!(height_mm < kBowed.most_bow * LengthOf(k))) return false;
  }
  return step_.allFinite() && inverse_.allFinite();
}

double BowedTube::HighestBow() const {
  double most_mm = 0;
  for (std::size_t k = 0; k < own_.size(); ++k) {
    if (own_[k] >= 0) most_mm = std::max(most_mm, BowAt(k, step_).cwiseAbs().maxCoeff());
  }
  return most_mm;
}

}  // namespace bendloop::pipeline
