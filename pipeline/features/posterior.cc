// SPDX-License-Identifier: Apache-2.0
#include "pipeline/features/posterior.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numbers>

#include "pipeline/math/definite_solver.h"

namespace bendloop::pipeline {
namespace {

// Rounds in which the steps learn, and the part of the walk that each of them takes.
constexpr int kLearningRounds = 4;
constexpr double kLearningPart = 0.2;
// Of the best step of a normal density (Roberts, Gelman and Gilks 1997).
constexpr double kBestStep = 2.38;
constexpr double kKeptShape = 0.05;  // of the shape before, so that none degenerates

// `N`: numbers, where they are known when this is compiled.
template <int N>
struct Sums {
  static constexpr int kNumbers = N > 0 ? N : Eigen::Dynamic;
  using Vector = Eigen::Matrix<double, kNumbers, 1>;
  using Matrix = Eigen::Matrix<double, kNumbers, kNumbers>;

  explicit Sums(Eigen::Index n) : first(Vector::Zero(n)), second(Matrix::Zero(n, n)) {}
  // `off`: from where the sums count; `log`: of the density there; `times`: steps that it was
  // stayed at. Through pointers: a walk has few numbers and many steps.
  void Add(const double* off, double log, double times) {
    const Eigen::Index n = N > 0 ? N : first.size();
    double* sum = first.data();
    double* square = second.data();
    for (Eigen::Index k = 0; k < n; ++k, square += n) {
      const double of_all = times * off[k];
      sum[k] += of_all;
      for (Eigen::Index i = k; i < n; ++i) square[i] += off[i] * of_all;
    }
    log_density += times * log;
    count += times;
  }
  Eigen::VectorXd Mean() const { return first / count; }
  Eigen::MatrixXd Covariance() const {
    const Matrix both = second.template selfadjointView<Eigen::Lower>();
    return both / count - Mean() * Mean().transpose();
  }

  Vector first;
  Matrix second;
  double count = 0;
  double log_density = 0;  // of all that were added
};

template <int N>
Posterior Walk(const Posterior& rough, int walk, WalkDice& dice,
               const std::function<double(const Eigen::VectorXd&)>& log_density) {
  const Eigen::VectorXd& start = rough.mean;
  const Eigen::Index n = N > 0 ? N : start.size();
  std::size_t thrown = 0;
  Eigen::VectorXd at = start, to = start;
  typename Sums<N>::Vector off = Sums<N>::Vector::Zero(n);
  double here = log_density(at);
  Eigen::MatrixXd shape = rough.covariance;
  double length = kBestStep / std::sqrt(static_cast<double>(n));
  const auto round = [&](int steps) {
    const typename Sums<N>::Matrix factor = length * DefiniteSolver(shape).Lower();
    Sums<N> sums(n);  // about the start, so that no digits are lost
    int taken = 0;
    double stayed = 0;
    for (int taking = 0; taking < steps; ++taking) {
      const double* step = dice.Of(thrown++);
      const double* from = at.data();
      double* sum = to.data();
      const double* column = factor.data();
      for (Eigen::Index k = 0; k < n; ++k) sum[k] = from[k];
      for (Eigen::Index k = 0; k < n; ++k, column += n) {
        for (Eigen::Index i = k; i < n; ++i) sum[i] += column[i] * step[k];
      }
      const double there = log_density(to);
      if (step[n] < there - here) {
        if (stayed > 0) sums.Add(off.data(), here, stayed);
        stayed = 0;
        at.swap(to);
        for (Eigen::Index k = 0; k < n; ++k) off.data()[k] = at.data()[k] - start.data()[k];
        here = there;
        ++taken;
      }
      stayed += 1;
    }
    sums.Add(off.data(), here, stayed);
    // About a quarter of the steps should be taken.
    const double part = static_cast<double>(taken) / steps;
    length *= std::clamp(part / 0.25, 0.3, 2.0);
    return sums;
  };
  for (int i = 0; i < kLearningRounds; ++i) {
    const Sums<N> sums = round(std::max(1, static_cast<int>(kLearningPart * walk)));
    shape = sums.Covariance() + kKeptShape * shape;
  }
  const Sums<N> sums = round(walk);
  return {start + sums.Mean(), sums.Covariance(), sums.log_density / sums.count};
}

}  // namespace

double Posterior::LogEvidence() const {
  const auto n = static_cast<double>(mean.size());
  const double log_volume = n * (1.0 + std::log(2.0 * std::numbers::pi));
  return mean_log_density + 0.5 * (log_volume + DefiniteSolver(covariance).LogDeterminant());
}

// SplitMix64: the same numbers with every standard library.
double WalkDice::Uniform() {
  state_ += 0x9E3779B97F4A7C15U;
  std::uint64_t x = state_;
  x = (x ^ (x >> 30U)) * 0xBF58476D1CE4E5B9U;
  x = (x ^ (x >> 27U)) * 0x94D049BB133111EBU;
  return (static_cast<double>((x ^ (x >> 31U)) >> 11U) + 0.5) * 0x1.0p-53;
}

void WalkDice::Throw() {
  for (std::size_t k = 0; k < numbers_; ++k) {
    const double first = Uniform(), second = Uniform();
    thrown_.push_back(std::sqrt(-2.0 * std::log(first)) *
                      std::cos(2.0 * std::numbers::pi * second));
  }
  thrown_.push_back(std::log(Uniform()));
}

Posterior SamplePosterior(const Eigen::VectorXd& start, const Eigen::VectorXd& scale, int walk,
                          const std::function<double(const Eigen::VectorXd&)>& log_density) {
  return SamplePosterior({start, scale.array().square().matrix().asDiagonal(), 0.0}, walk,
                         log_density);
}

Posterior SamplePosterior(const Posterior& rough, int walk,
                          const std::function<double(const Eigen::VectorXd&)>& log_density) {
  WalkDice dice(rough.mean.size());
  return SamplePosterior(rough, walk, dice, log_density);
}

Posterior SamplePosterior(const Posterior& rough, int walk, WalkDice& dice,
                          const std::function<double(const Eigen::VectorXd&)>& log_density) {
  // Ends and holes have three numbers, and ends' borders a noise; that many the compiler takes one
  // by one.
  switch (rough.mean.size()) {
    case 3:
      return Walk<3>(rough, walk, dice, log_density);
    case 4:
      return Walk<4>(rough, walk, dice, log_density);
    default:
      return Walk<Eigen::Dynamic>(rough, walk, dice, log_density);
  }
}

}  // namespace bendloop::pipeline
