// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include "pipeline/features/dent_solver.h"

namespace bendloop::pipeline {

struct DentSigmaSettings {
  // [of depth and area] 1 sigma of what a dent may be like that these forms are not.
  double of_form = 0.004;
  // [sigma] Chi square says that surely that the form is another; and [of its mean radius] points
  // of a patch so wide lie off together then.
  double unlike_sigmas = 3.0, patch = 0.5;
  // [of what it leaves beyond noise, rms] 1 sigma of its depth then.
  double of_left = 1.2;
  // One is a step whose flanks are all certainly steeper, where it is half as deep, than of any
  // flat, if they are steeper than metal is drawn: the power of a dent without a tail or a flat
  // bottom that is as steep, the tangent of its slope, and [sigma] of their logarithms.
  double step = 3.5, slope = 1.7, step_sigmas = 2.0;
};
inline constexpr DentSigmaSettings kDentSigma;

// What a dent's fit says of it, and how surely.
template <class Shape>
class DentNumbers {
 public:
  using Solver = DentSolver<Shape>;
  using Unknowns = typename Solver::Unknowns;
  using Square = typename Solver::Square;

  // `fit`: after Fit().
  explicit DentNumbers(const Solver& fit)
      : fit_(fit),
        misfit_(fit.normal().cost /
                static_cast<double>(fit.points().size() - std::size_t{Solver::kUnknowns})),
        covariance_(CovarianceOf()) {}

  // Of chi square for each point that is free, what is certainly beyond 1: its form is another.
  double Unlike() const {
    if (fit_.is_held()) return 0.0;
    const double by_chance =
        kDentSigma.unlike_sigmas * std::sqrt(2.0 / static_cast<double>(fit_.points().size()));
    return std::max(0.0, misfit_ - 1.0 - by_chance);
  }

  // Whether it is one is for others to say.
  FittedDent Dent() const {
    const Unknowns& at = fit_.at();
    const auto sigma = [&](Eigen::Index k) { return std::sqrt(covariance_(k, k)); };
    FittedDent dent;
    dent.along_mm = at[kU], dent.along_sigma_mm = sigma(kU);
    dent.around_mm = at[kV], dent.around_sigma_mm = sigma(kV);
    dent.depth_mm = at[kDepth];
    const double unlike_mm = kDentSigma.of_left * fit_.noise_mm() * std::sqrt(Unlike());
    dent.depth_sigma_mm = std::hypot(sigma(kDepth), kDentSigma.of_form * dent.depth_mm, unlike_mm);
    dent.area_mm2 = AreaOf(at);
    dent.area_sigma_mm2 = std::hypot(SigmaOf(AreaOf), kDentSigma.of_form * dent.area_mm2);
    dent.misfit = misfit_;
    dent.is_step = IsStep();
    return dent;
  }

 private:
  // Where the form is not the dent's, the residuals say so: by how much, and, if they do so
  // certainly, that neighbours lie off together.
  Square CovarianceOf() const {
    const Square inverse = Inverse(fit_.normal().matrix);
    const Square covariance = std::max(1.0, misfit_) * inverse;
    if (!(Unlike() > 0)) return covariance;
    const Square robust = inverse * Scatter() * inverse;
    const Unknowns more =
        (robust.diagonal().array() / covariance.diagonal().array()).max(1.0).sqrt();
    return more.asDiagonal() * covariance * more.asDiagonal();
  }

  // Of the right side, by what patches of the wall add to it: what a form leaves is alike on
  // neighbours.
  Square Scatter() const {
    const typename Solver::Size size(fit_.at());
    const double side_mm = kDentSigma.patch * std::sqrt(AreaOf(fit_.at()) / std::numbers::pi);
    const double weight = 1.0 / (fit_.noise_mm() * fit_.noise_mm());
    std::map<std::pair<int, int>, Unknowns> patches;
    for (const DentPoint& point : fit_.points()) {
      const typename Solver::Row row = fit_.RowOf(point, size);
      const auto place = std::pair(static_cast<int>(std::floor(point.along_mm / side_mm)),
                                   static_cast<int>(std::floor(point.around_mm / side_mm)));
      Unknowns& patch = patches.try_emplace(place, Unknowns::Zero()).first->second;
      patch += weight * row[Solver::kOff] * Eigen::Map<const Unknowns>(row.data());
    }
    Square scatter = fit_.certainty().cwiseAbs2().asDiagonal();
    for (const auto& [place, patch] : patches) scatter += patch * patch.transpose();
    return scatter;
  }

  // Of what the numbers tell, by how it changes with each.
  double SigmaOf(double (*value)(const Unknowns&)) const {
    constexpr double kStep = 1e-3;  // [sigma]
    Unknowns by;
    for (int k = 0; k < Solver::kUnknowns; ++k) {
      const double step = kStep * std::sqrt(covariance_(k, k));
      Unknowns more = fit_.at(), less = fit_.at();
      more[k] += step, less[k] -= step;
      by[k] = step > 0 ? (value(more) - value(less)) / (2.0 * step) : 0.0;
    }
    return std::sqrt(std::max(0.0, by.dot(covariance_ * by)));
  }

  bool IsStep() const {
    const double surely = LogSteepness(fit_.at()) - kDentSigma.step_sigmas * SigmaOf(LogSteepness);
    return surely > std::log(kDentSigma.step) && LogSlope(fit_.at()) > std::log(kDentSigma.slope);
  }

  // [mm2] Where it is half as deep and more.
  static double AreaOf(const Unknowns& x) {
    return Solver::ShapeOf(x).HalfArea() * std::exp(-x[kAxisU] - x[kAxisV]);
  }
  static double LogSteepness(const Unknowns& x) {
    return Solver::ShapeOf(x).LogSteepnessAllRound();
  }
  // Of the tangent of their slope, where it is half as deep.
  static double LogSlope(const Unknowns& x) {
    return Solver::ShapeOf(x).LogSlopeAllRound(Solver::ScaleOf(x)) + std::log(std::abs(x[kDepth]));
  }

  const Solver& fit_;
  double misfit_;
  Square covariance_;
};

}  // namespace bendloop::pipeline
