// SPDX-License-Identifier: Apache-2.0
#include "pipeline/features/weighed_draws.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>
#include <vector>

#include "pipeline/math/definite_solver.h"

namespace bendloop::pipeline {
namespace {

struct DrawSettings {
  // Rounds that learn, each by this part of the draws of the last.
  std::array<double, 5> learning = {0.12, 0.12, 0.12, 0.12, 0.3};
  int least_learning = 50;
  double effective = 0.25;               // of the draws of a round that learns
  double kept_shape = 0.05;              // of the shape before, so that none degenerates
  double wide_part = 0.25, wider = 2.5;  // draws of the wider density, and how much wider it is
  double power_step = 0.7;
  // Fewer effective draws than this part say too little; at most so many rounds more.
  double enough = 0.1;
  int more = 2;
};
constexpr DrawSettings kDraws;

class Draws {
 public:
  Draws(Eigen::Index numbers, WalkDice& dice,
        const std::function<double(const Eigen::VectorXd&)>& log_density)
      : dice_(dice), log_density_(log_density), place_(numbers) {}

  // About a normal density. Through pointers: there are few numbers and many draws.
  void Throw(const Posterior& about, int count) {
    const Eigen::Index n = place_.size();
    const Eigen::MatrixXd factor = DefiniteSolver(about.covariance).Lower();
    const double kept = 1.0 - kDraws.wide_part;
    const double of_wide = kDraws.wide_part / std::pow(kDraws.wider, static_cast<double>(n));
    constexpr double kNarrower2 = 1.0 / (kDraws.wider * kDraws.wider);
    about_ = about.mean;
    off_.setZero(n, count);
    log_weight_.clear();
    for (int i = 0; i < count; ++i) {
      const double* normal = dice_.Of(thrown_++);
      const double scale = normal[n] < kLogWidePart ? kDraws.wider : 1.0;
      double* off = off_.data() + i * n;
      const double* column = factor.data();
      double square = 0;
      for (Eigen::Index k = 0; k < n; ++k, column += n) {
        const double by = scale * normal[k];
        square += by * by;
        for (Eigen::Index j = k; j < n; ++j) off[j] += by * column[j];
      }
      for (Eigen::Index k = 0; k < n; ++k) place_.data()[k] = about_.data()[k] + off[k];
      log_weight_.push_back(log_density_(place_) -
                            std::log(kept * std::exp(-0.5 * square) +
                                     of_wide * std::exp(-0.5 * kNarrower2 * square)));
    }
  }

  // Weighs the draws by this power; how many of them it leaves effective (Kong 1992).
  double Weigh(double power) {
    const double most = *std::max_element(log_weight_.begin(), log_weight_.end());
    weight_.resize(static_cast<Eigen::Index>(log_weight_.size()));
    for (std::size_t i = 0; i < log_weight_.size(); ++i) {
      weight_[static_cast<Eigen::Index>(i)] = std::exp(power * (log_weight_[i] - most));
    }
    weight_ /= weight_.sum();
    return 1.0 / weight_.squaredNorm();
  }

  WeighedDraws Drawn() const { return {about_, off_, weight_}; }

 private:
  static const double kLogWidePart;

  WalkDice& dice_;
  const std::function<double(const Eigen::VectorXd&)>& log_density_;
  std::size_t thrown_ = 0;
  Eigen::VectorXd place_, about_;
  Eigen::MatrixXd off_;  // a draw a column, from there
  std::vector<double> log_weight_;
  Eigen::VectorXd weight_;
};

const double Draws::kLogWidePart = std::log(kDraws.wide_part);

}  // namespace

WeighedDraws::WeighedDraws(Eigen::VectorXd about, Eigen::MatrixXd off, Eigen::VectorXd weight)
    : about_(std::move(about)), off_(std::move(off)), weight_(std::move(weight)) {}

Posterior WeighedDraws::Sum(const Eigen::VectorXd& weight) const {
  Posterior told;
  const Eigen::VectorXd off = off_ * weight;
  told.mean = about_ + off;
  told.covariance = -off * off.transpose();
  const Eigen::Index n = off.size();
  for (Eigen::Index i = 0; i < off_.cols(); ++i) {
    const double* from = off_.data() + i * n;
    double* sum = told.covariance.data();
    for (Eigen::Index k = 0; k < n; ++k, sum += n) {
      const double weighed = weight[i] * from[k];
      for (Eigen::Index j = 0; j < n; ++j) sum[j] += weighed * from[j];
    }
  }
  return told;
}

std::optional<Posterior> WeighedDraws::ToldTimes(
    const std::function<double(const Eigen::VectorXd&)>& log_factor) const {
  Eigen::VectorXd factor(weight_.size());
  for (Eigen::Index i = 0; i < off_.cols(); ++i) factor[i] = log_factor(about_ + off_.col(i));
  Eigen::VectorXd weight = weight_.array() * (factor.array() - factor.maxCoeff()).exp();
  weight /= weight.sum();
  const double effective = 1.0 / weight.squaredNorm();
  if (!(effective >= kDraws.enough * static_cast<double>(weight.size()))) return std::nullopt;
  return Sum(weight);
}

WeighedDraws WeighPosterior(const Posterior& rough, int draws, WalkDice& dice,
                            const std::function<double(const Eigen::VectorXd&)>& log_density) {
  Draws thrown(rough.mean.size(), dice, log_density);
  Posterior about = rough;
  const auto learn = [&](double effective) {
    double power = 1.0;
    while (thrown.Weigh(power) < effective) power *= kDraws.power_step;
    const Posterior told = thrown.Drawn().Told();
    about = {told.mean, told.covariance + kDraws.kept_shape * about.covariance, 0.0};
  };
  for (const double part : kDraws.learning) {
    const int count = std::max(kDraws.least_learning, static_cast<int>(part * draws));
    thrown.Throw(about, count);
    learn(kDraws.effective * count);
  }
  for (int i = 0;; ++i) {
    thrown.Throw(about, draws);
    if (thrown.Weigh(1.0) >= kDraws.enough * draws || i == kDraws.more) return thrown.Drawn();
    learn(kDraws.effective * draws);
  }
}

}  // namespace bendloop::pipeline
