// SPDX-License-Identifier: Apache-2.0
// What a bowed tube is in the rows of the trade, and how sure.
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include "hal/angles.h"
#include "pipeline/fit/bowed_tube.h"
#include "pipeline/fit/fit_priors.h"
#include "pipeline/fit/normal_equations.h"
#include "pipeline/math/cross_matrix.h"
#include "pipeline/math/dense_product.h"
#include "pipeline/math/dense_solve.h"
#include "pipeline/math/quantiles.h"

namespace bendloop::pipeline {
bool HasCorners(const hal::BendProgram& program) {
  return std::all_of(program.rows.begin(), program.rows.end() - 1, [](const hal::BendRow& row) {
    return row.angle_deg > kBowed.least_deg && row.angle_deg < kBowed.most_deg;
  });
}

bool BowedTube::IsPulledAside() const {
  for (std::size_t i = 0; i < places_.size(); ++i) {
    if (PulledAside(i) > ranks_[i] + kBowed.no_noise_sigmas * std::sqrt(2.0 * ranks_[i])) {
      return true;
    }
  }
  return false;
}

bool BowedTube::MoveTo(SurfaceFit& fit) const {
  const Eigen::MatrixXd map = TradeMap();
  Eigen::VectorXd step = step_;
  step.head(parameters_.size()) = Within(step_) - parameters_.Initial();
  const Eigen::VectorXd to = TradeAt(step);
  if (!to.allFinite() || !map.allFinite()) return false;
  SurfaceFit moved = fit;
  moved.tube = TradeTube(parameters_, state_.tube, to);
  if (!HasCorners(moved.tube.program)) return false;
  if (FarthestEndMm(moved.tube, LinesAt(step_)) >
      kBowed.near_bows * HighestBow() + kBowed.near * r_mm_) {
    return false;
  }
  moved.flattening = parameters_.FlatteningAt(to);
  moved.easing = parameters_.EasingAt(to);
  const TubeParameters at(moved.tube, options_.free_pipe_radius, moved.flattening, moved.easing);
  const EasedSpine spine = SpineOf(moved.tube.program, moved.tube.X_WT, moved.easing);
  moved.last_start = at.FrameDerivatives(spine).back().row(0);
  const Eigen::MatrixXd covariance =
      Mapped(map, noise_mm2_ * inverse_ + Disagreement(kBowed.noise_sigmas_of_bowed)) + OtherBows();
  moved.turn_surplus.resize(0);
  SetCovariance(NoSurer(at, moved.tube.program, covariance), options_.free_pipe_radius, moved);
  fit = std::move(moved);
  return true;
}

void BowedTube::MoveToLines(SurfaceFit& fit) const {
  const Eigen::VectorXd to = TradeAt(Eigen::VectorXd::Zero(size_));
  if (to.allFinite()) fit.tube = TradeTube(parameters_, state_.tube, to);
}

void BowedTube::Doubt(bool would_move, SurfaceFit& fit) const {
  const int n = parameters_.size();
  Eigen::MatrixXd covariance =
      fit.covariance + Disagreement(kBowed.noise_sigmas).topLeftCorner(n, n);
  const Eigen::VectorXd aside = step_.head(n);
  if (would_move) covariance += aside * aside.transpose();
  SetCovariance(std::move(covariance), options_.free_pipe_radius, fit);
}

Eigen::MatrixXd BowedTube::Disagreement(double noise_sigmas) const {
  Eigen::MatrixXd sum = Eigen::MatrixXd::Zero(size_, size_);
  for (std::size_t i = 0; i < places_.size(); ++i) {
    const double worth = worth_[ClassOf(places_[i].segment)];
    const Eigen::MatrixXd motion = MotionOf(places_[i]);
    const LocalMatrix information = InformationOf(places_[i].sum);
    const LocalVector pull = LeftPull(places_[i]);
    const double chi_square = pull.dot(inverses_[i] * pull) / (worth * noise_mm2_);
    const double of_noise = ranks_[i] + noise_sigmas * std::sqrt(2.0 * ranks_[i]);
    if (!(chi_square > of_noise)) continue;
    const Eigen::MatrixXd back = Product(inverse_, motion.transpose());
    const LocalMatrix others =
        LocalMatrix::Identity() -
        kBowed.leverage / worth * Product(information, Product(motion, back));
    const Eigen::VectorXd moves = back * (Inverse(others) * pull) / worth;
    sum.noalias() += (1.0 - of_noise / chi_square) * moves * moves.transpose();
  }
  return sum;
}

double BowedTube::LeastRadiusSigmaMm(const hal::BendProgram& program, std::size_t bend) const {
  // Those of the bend, and of a place before and behind it.
  const std::size_t first = bend * (spine_.pieces + 1) + 1, last = first + spine_.pieces - 1;
  double weight = 0, long_mm = 0;
  for (std::size_t i = 0; i < places_.size(); ++i) {
    const std::size_t k = places_[i].segment;
    const bool is_before = k + 1 == first && i + 1 < places_.size() && places_[i + 1].segment != k;
    const bool is_behind = k == last + 1 && i > 0 && places_[i - 1].segment != k;
    if (is_before || is_behind) long_mm += kBowed.place * r_mm_;
    if (is_before || is_behind || (k >= first && k <= last)) {
      weight += places_[i].sum(kPipeRadiusState, kPipeRadiusState);
    }
  }
  for (std::size_t k = first; k <= last; ++k) long_mm += spine_.segments[k].length_mm;
  // A sample sees half of the two directions across.
  const double of_radius = std::max(1.0, weight * r_mm_ / std::max(r_mm_, long_mm));
  const double across_mm = std::sqrt(2.0 * worth() * noise_mm2_ / of_radius);
  return 8.0 * across_mm / std::pow(program.rows[bend].angle_deg * hal::kRadiansPerDegree, 2);
}

Eigen::MatrixXd BowedTube::NoSurer(const TubeParameters& at, const hal::BendProgram& program,
                                   Eigen::MatrixXd covariance) const {
  const Eigen::VectorXd range = ExpectedRange(at, r_mm_);
  const auto is_usual = [this](double radius_mm) {
    const auto& usual = fit_.priors.bend_radius;
    return usual && RobustWeight(radius_mm - usual->mean_mm, usual->sigma_mm) > 0.5;
  };
  for (std::size_t bend = 0; bend < at.bends(); ++bend) {
    const hal::BendRow& row = program.rows[bend];
    if (row.angle_deg > kBowed.slight_deg || fit_.priors.radii_alike > 0) continue;
    if (is_usual(row.bend_radius_mm.value_or(0.0))) continue;
    const int radius = at.bend_radius(bend);
    const double least_mm = std::min(range[radius], LeastRadiusSigmaMm(program, bend));
    const double missing_mm2 = least_mm * least_mm - covariance(radius, radius);
    if (!(missing_mm2 > 0)) continue;
    // The corner stays.
    Eigen::VectorXd moves = Eigen::VectorXd::Zero(at.size());
    moves[radius] = 1.0;
    const double tangent = std::tan(0.5 * program.rows[bend].angle_deg * hal::kRadiansPerDegree);
    moves[at.length(bend)] = -tangent;
    if (bend + 1 < at.bends()) moves[at.length(bend + 1)] = -tangent;
    covariance += missing_mm2 * moves * moves.transpose();
  }
  return covariance;
}

double BowedTube::MiddleShiftMm(std::size_t k, const Eigen::VectorXd& numbers) const {
  // What eases further begins earlier, on both sides of its tangent point alike.
  const int n = parameters_.eased() ? parameters_.easing(0) : parameters_.size();
  const auto along_mm = [&](std::size_t segment) {
    return motions_[segment].row(0).head(n).dot(numbers.head(n));
  };
  // Where the tube ends the samples know.
  const double start_mm = k > 0 ? along_mm(k) : 0.0;
  const double end_mm = k + 1 < motions_.size() ? along_mm(k + 1) : 0.0;
  return 0.5 * (start_mm + end_mm);
}

LocalVector BowedTube::LineTurn(std::size_t k, double shift_mm) const {
  const Bow& bow = state_.bows[k];
  const double length_mm = LengthOf(k), by_mm = 2.0 / length_mm;
  const auto curvatures = BowCurvaturesAt(bow.middle.center());
  Eigen::Vector2d slope = Eigen::Vector2d::Zero();
  for (std::size_t s = 0; s < kBowShapes; ++s) {
    slope += shift_mm * by_mm * by_mm * curvatures[s] * bow.HeightMm(s);
  }
  const double along_mm = 0.5 * (1.0 + bow.middle.center()) * length_mm - bow.before_mm;
  LocalVector motion = LocalVector::Zero();
  motion.segment<2>(1) = -along_mm * slope;
  motion[4] = -slope[1];
  motion[5] = slope[0];
  return motion;
}

std::vector<SpineLine> BowedTube::LinesAt(const Eigen::VectorXd& numbers) const {
  std::vector<SpineLine> lines;
  for (std::size_t k = 0; k < frames_.size(); ++k) {
    if (!spine_.is_line(k)) continue;
    const hal::SpineSegment& straight = spine_.segments[k];
    LocalVector motion = motions_[k] * numbers + tails_[k];
    if (own_[k] >= 0) {
      motion += LineMotion(k) * numbers.segment<kBowModes>(own_[k]);
      motion += LineTurn(k, MiddleShiftMm(k, numbers));
    }
    const Eigen::Matrix3d axes = straight.axes();
    const Eigen::Vector3d turn = axes * motion.segment<3>(3);
    const Eigen::Vector3d direction = straight.tangent + turn.cross(straight.tangent);
    lines.push_back({straight.start_mm + axes * motion.head<3>(), direction.normalized()});
  }
  return lines;
}

Eigen::MatrixXd BowedTube::OtherBows() const {
  const Eigen::VectorXd numbers = parameters_.Initial() + step_.head(parameters_.size());
  const std::vector<SpineLine> lines = LinesAt(step_);
  double eased_mm = 0;
  for (const double variance_mm2 : state_.easing.variance_mm2) {
    eased_mm = std::max(eased_mm, std::sqrt(std::max(0.0, variance_mm2)));
  }
  Eigen::MatrixXd sum = Eigen::MatrixXd::Zero(parameters_.size(), parameters_.size());
  std::size_t row = 0;
  for (std::size_t k = 0; k < own_.size(); ++k) {
    if (!spine_.is_line(k)) continue;
    const std::size_t at = row++;
    if (own_[k] < 0) continue;
    Bow bow = state_.bows[k];
    bow.modes_mm = BowAt(k, step_);
    const double length_mm = LengthOf(k);
    const double steepest =
        2.0 / length_mm * std::max(bow.SlopeAt(-1.0).norm(), bow.SlopeAt(1.0).norm());
    const double center_mm = 0.5 * (1.0 + bow.middle.center()) * length_mm - bow.before_mm;
    const Eigen::Matrix3d axes = spine_.segments[k].axes();
    for (const int across : {1, 2}) {
      const Eigen::Vector3d turn =
          kBowed.bows_on * eased_mm / length_mm * steepest * axes.col(across);
      const auto turned = [&](double by) {
        std::vector<SpineLine> other = lines;
        other[at].direction = (other[at].direction + by * turn).normalized();
        other[at].point_mm -= by * center_mm * turn;
        return TradeNumbers(parameters_, state_.tube, other, numbers);
      };
      const Eigen::VectorXd moves = 0.5 * (turned(1.0) - turned(-1.0));
      sum += moves * moves.transpose();
    }
  }
  return sum;
}

Eigen::VectorXd BowedTube::TradeAt(const Eigen::VectorXd& numbers) const {
  return TradeNumbers(parameters_, state_.tube, LinesAt(numbers),
                      parameters_.Initial() + numbers.head(parameters_.size()));
}

Eigen::MatrixXd BowedTube::TradeMap() const {
  Eigen::MatrixXd map(parameters_.size(), size_);
  for (int i = 0; i < size_; ++i) {
    const double small =
        std::max(1e-9, 1e-2 * std::sqrt(std::max(0.0, noise_mm2_ * inverse_(i, i))));
    Eigen::VectorXd more = step_, less = step_;
    more[i] += small;
    less[i] -= small;
    map.col(i) = (TradeAt(more) - TradeAt(less)) / (2.0 * small);
  }
  return map;
}

}  // namespace bendloop::pipeline
