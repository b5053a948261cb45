// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <numbers>
#include <random>
#include <vector>

#include "hal/angles.h"
#include "pipeline/features/end_lines.h"
#include "pipeline/features/opening_border.h"
#include "pipeline/math/dense_solve.h"
#include "tests/support/uniform.h"

// Walls with known borders, sampled evenly and blurred by noise, and the least 1 sigma that an
// unbiased estimate of a border's numbers can have of them (Cramer and Rao).
namespace bendloop::tests {

// Samples with density n [1/mm^2] behind a border, displaced by noise of 1 sigma s, are a Poisson
// process whose density falls like the normal distribution's. Moving the border tells of each mm of
// it n / s times the integral of phi^2 / Phi, which is this.
constexpr double kBorderInformation = 0.903;

// Where a tube ends: at_mm + pipe radius * slope * cos(around - around_rad).
struct CutTube {
  double pipe_radius_mm = 8, at_mm = 0, slope = 0, around_rad = 0;

  double At(double around) const {
    return at_mm + pipe_radius_mm * slope * std::cos(around - around_rad);
  }
  // 1 sigma of `at_mm`; of the slope in either direction sqrt(2) / pipe radius of it.
  double BoundMm(double per_mm2, double smear_mm) const {
    return std::sqrt(smear_mm /
                     (kBorderInformation * per_mm2 * 2 * std::numbers::pi * pipe_radius_mm));
  }
};

inline std::vector<pipeline::EndSample> SampleEnd(const CutTube& tube, double window_mm,
                                                  double per_mm2, double smear_mm,
                                                  std::mt19937_64& random) {
  std::normal_distribution<double> noise(0, smear_mm);
  const double from_mm = -window_mm - 10, to_mm = 4;
  const double area = 2 * std::numbers::pi * tube.pipe_radius_mm * (to_mm - from_mm);
  std::vector<pipeline::EndSample> samples;
  for (int i = 0; i < static_cast<int>(per_mm2 * area); ++i) {
    const double around = Uniform(random, -std::numbers::pi, std::numbers::pi);
    const double at_mm = Uniform(random, from_mm, to_mm);
    if (at_mm < tube.At(around)) samples.push_back({around, at_mm + noise(random)});
  }
  return samples;
}

inline std::vector<Eigen::Vector2d> SampleWall(const pipeline::OpeningBorder& opening,
                                               double per_mm2, double smear_mm,
                                               std::mt19937_64& random) {
  const double half_mm =
      0.5 * opening.length_mm * (1 + opening.lean.norm()) + 0.5 * opening.width_mm;
  std::normal_distribution<double> noise(0, smear_mm);
  std::vector<Eigen::Vector2d> samples;
  for (int i = 0; i < static_cast<int>(per_mm2 * 4 * half_mm * half_mm); ++i) {
    const Eigen::Vector2d place(Uniform(random, -half_mm, half_mm),
                                Uniform(random, -half_mm, half_mm));
    if (opening.DistanceMm(place) < 0) continue;
    samples.emplace_back(place.x() + noise(random), place.y() + noise(random));
  }
  return samples;
}

// The numbers of an opening: place, width; of a slot length and axis, of a hole that leans its
// lean.
inline pipeline::OpeningBorder Moved(pipeline::OpeningBorder border, int number, double by) {
  const bool is_hole = border.is_hole();
  if (number < 2) border.middle_mm[number] += by;
  if (number == 2) border.width_mm += by;
  if (is_hole) border.length_mm = border.width_mm;
  if (number == 3) is_hole ? border.lean.x() += by : border.length_mm += by;
  if (number == 4) is_hole ? border.lean.y() += by : border.axis_rad += by;
  return border;
}

// 1 sigma of these numbers, of the first `numbers` where the others are known.
inline Eigen::VectorXd OpeningBound(const pipeline::OpeningBorder& border, int numbers,
                                    double per_mm2, double smear_mm) {
  constexpr int kPlaces = 720;
  constexpr double kStep = 1e-5;
  // The border on rays from its middle.
  std::vector<Eigen::Vector2d> places;
  for (int i = 0; i < kPlaces; ++i) {
    const double turn = 2 * std::numbers::pi * i / kPlaces;
    const Eigen::Vector2d ray(std::cos(turn), std::sin(turn));
    double low = 0, high = 2 * border.length_mm * (1 + border.lean.norm());
    for (int k = 0; k < 60; ++k) {
      const double middle = 0.5 * (low + high);
      (border.DistanceMm(border.middle_mm + middle * ray) < 0 ? low : high) = middle;
    }
    places.emplace_back(border.middle_mm + low * ray);
  }
  Eigen::MatrixXd information = Eigen::MatrixXd::Zero(numbers, numbers);
  for (int i = 0; i < kPlaces; ++i) {
    const Eigen::Vector2d& at = places[static_cast<std::size_t>(i)];
    const double length_mm = 0.5 * (places[static_cast<std::size_t>((i + 1) % kPlaces)] -
                                    places[static_cast<std::size_t>((i + kPlaces - 1) % kPlaces)])
                                       .norm();
    const auto slope = [&](const Eigen::Vector2d& to) {
      return (border.DistanceMm(at + kStep * to) - border.DistanceMm(at - kStep * to)) /
             (2 * kStep);
    };
    const double steep =
        std::hypot(slope(Eigen::Vector2d::UnitX()), slope(Eigen::Vector2d::UnitY()));
    Eigen::VectorXd moves(numbers);
    for (int k = 0; k < numbers; ++k) {
      moves[k] =
          -(Moved(border, k, kStep).DistanceMm(at) - Moved(border, k, -kStep).DistanceMm(at)) /
          (2 * kStep * steep);
    }
    information += kBorderInformation * per_mm2 / smear_mm * length_mm * moves * moves.transpose();
  }
  return pipeline::Inverse(information).diagonal().cwiseSqrt();
}

}  // namespace bendloop::tests
