// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/wrinkle_fit.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

namespace bendloop::pipeline {
namespace {

struct WaveSettings {
  // [of the bend's length] and [of r_P] The ends of a bend, where waves fade out, are not looked
  // at: the lesser of both.
  double end_part = 0.25, end = 1.0;
  // [rad] From the innermost line: beyond it waves are a tenth as high.
  double around = 1.2;
  // [of r_P] Waves are no shorter, and no longer than this; and [of what is looked at] so long.
  double shortest = 0.3, longest = 2.0, least_waves = 1.0;
  // [of what is looked at] Between wave numbers, in waves: a twentieth of one at its ends hardly
  // makes waves lower.
  double step = 0.1;
  // [sigma] and [of their height] Samples further off are no wall.
  double flier = 5.0, flier_of_height = 2.0;
  std::size_t least_samples = 60, enough_samples = 6000;
  // [of their height] 1 sigma of what waves may be that are not all alike.
  double unlike = 0.08;
};
constexpr WaveSettings kWaves;

// What is even along a bend, as easing and ovality are: a cubic along it, by a parabola around.
constexpr int kEven = 12;
using Even = Eigen::Matrix<double, kEven, 1>;

struct WaveRow {
  Even even;
  double along_mm, high, off_mm;  // high: of waves there, of those on the innermost line
};

class WaveFit {
 public:
  // `middle_mm`, `half_mm`: of what is looked at.
  WaveFit(std::span<const BendSample> samples, double middle_mm, double half_mm, double limit_mm)
      : half_mm_(half_mm) {
    std::vector<const BendSample*> near;
    for (const BendSample& sample : samples) {
      const bool is_near = std::abs(sample.along_mm - middle_mm) < half_mm &&
                           std::abs(sample.around_rad) < kWaves.around &&
                           std::abs(sample.off_mm) < limit_mm;
      if (is_near) near.push_back(&sample);
    }
    const std::size_t stride = std::max<std::size_t>(1, near.size() / kWaves.enough_samples);
    for (std::size_t i = 0; i < near.size(); i += stride) {
      const BendSample& sample = *near[i];
      const double x = (sample.along_mm - middle_mm) / half_mm, y = sample.around_rad;
      WaveRow row{Even::Zero(), sample.along_mm - middle_mm, std::pow(std::cos(y), 2),
                  sample.off_mm};
      const double along[4] = {1, x, x * x, x * x * x}, around[3] = {1, y, y * y};
      for (int k = 0; k < kEven; ++k) row.even[k] = along[k / 3] * around[k % 3];
      matrix_ += row.even * row.even.transpose();
      right_ += row.off_mm * row.even;
      squares_mm2_ += row.off_mm * row.off_mm;
      rows_.push_back(row);
    }
  }

  std::size_t samples() const { return rows_.size(); }

  // Those of the wave number that explains most. None: some samples are too much alike.
  std::optional<Waves> Best(double least_per_mm, double most_per_mm, double noise_mm) const {
    const Eigen::LDLT<Eigen::Matrix<double, kEven, kEven>> even(matrix_);
    if (even.info() != Eigen::Success || !even.isPositive()) return std::nullopt;
    std::optional<Found> best;
    const double step_per_mm = kWaves.step / (2.0 * half_mm_);
    for (double per_mm = least_per_mm; per_mm < most_per_mm; per_mm += step_per_mm) {
      const Found found = At(per_mm, even);
      if (!best || found.explained_mm2 > best->explained_mm2) best = found;
    }
    if (!best || !best->inverse.allFinite()) return std::nullopt;
    const double left_mm2 = squares_mm2_ - right_.dot(even.solve(right_)) - best->explained_mm2;
    const double free = static_cast<double>(rows_.size()) - kEven - 3.0;
    const double sample_mm2 = std::max(noise_mm * noise_mm, left_mm2 / std::max(1.0, free));
    Waves waves;
    waves.height_mm = 2.0 * best->both_mm.norm();
    waves.sigma_mm = std::hypot(2.0 * std::sqrt(0.5 * sample_mm2 * best->inverse.trace()),
                                kWaves.unlike * waves.height_mm);
    return waves;
  }

 private:
  struct Found {
    double explained_mm2 = 0;
    Eigen::Vector2d both_mm;  // of their cosine and sine
    Eigen::Matrix2d inverse;
  };
  Found At(double per_mm, const Eigen::LDLT<Eigen::Matrix<double, kEven, kEven>>& even) const {
    Eigen::Matrix<double, kEven, 2> beside = Eigen::Matrix<double, kEven, 2>::Zero();
    Eigen::Matrix2d matrix = Eigen::Matrix2d::Zero();
    Eigen::Vector2d right = Eigen::Vector2d::Zero();
    for (const WaveRow& row : rows_) {
      const double turn = 2.0 * std::numbers::pi * per_mm * row.along_mm;
      const Eigen::Vector2d wave(row.high * std::cos(turn), row.high * std::sin(turn));
      beside += row.even * wave.transpose();
      matrix += wave * wave.transpose();
      right += row.off_mm * wave;
    }
    const Eigen::Matrix<double, kEven, 2> even_beside = even.solve(beside);
    right -= even_beside.transpose() * right_;
    matrix -= even_beside.transpose() * beside;
    Found found;
    found.inverse = matrix.inverse();
    found.both_mm = found.inverse * right;
    found.explained_mm2 = right.dot(found.both_mm);
    return found;
  }

  double half_mm_;
  std::vector<WaveRow> rows_;
  Eigen::Matrix<double, kEven, kEven> matrix_ = Eigen::Matrix<double, kEven, kEven>::Zero();
  Even right_ = Even::Zero();
  double squares_mm2_ = 0;
};

}  // namespace

std::optional<Waves> FitWaves(std::span<const BendSample> samples, double length_mm,
                              double pipe_radius_mm, double about_mm, double noise_mm) {
  const double end_mm = std::min(kWaves.end_part * length_mm, kWaves.end * pipe_radius_mm);
  const double half_mm = 0.5 * length_mm - end_mm;
  const double longest_mm =
      std::min(kWaves.longest * pipe_radius_mm, 2.0 * half_mm / kWaves.least_waves);
  const double shortest_mm = kWaves.shortest * pipe_radius_mm;
  if (!(longest_mm > 1.5 * shortest_mm)) return std::nullopt;
  const WaveFit fit(samples, 0.5 * length_mm, half_mm,
                    kWaves.flier * noise_mm + kWaves.flier_of_height * about_mm);
  if (fit.samples() < kWaves.least_samples) return std::nullopt;
  return fit.Best(1.0 / longest_mm, 1.0 / shortest_mm, noise_mm);
}

}  // namespace bendloop::pipeline
