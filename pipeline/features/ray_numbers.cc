// SPDX-License-Identifier: Apache-2.0
#include "pipeline/features/ray_numbers.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

#include "pipeline/math/dense_solve.h"
#include "pipeline/math/quantiles.h"

namespace bendloop::pipeline {
namespace {

struct NumbersSettings {
  Eigen::Index most_terms = 7;
  std::size_t pairs_a_term = 8;
  double another = 0.5;  // [rays] Neighbours that are so far from one ray apart are of no next one
  int rounds = 3;        // of leaving these out
  std::size_t checked = 64;
};
constexpr NumbersSettings kNumbers;

// Where no neighbours lie: a series with more terms than such gaps fit in may be anything there.
double WidestGapMm(std::span<const NeighbouringRays> neighbours) {
  std::vector<double> middles_mm;
  for (const NeighbouringRays& pair : neighbours) {
    middles_mm.push_back(0.5 * (pair.from_mm + pair.to_mm));
  }
  std::sort(middles_mm.begin(), middles_mm.end());
  double widest_mm = 1e-9;
  for (std::size_t i = 1; i < middles_mm.size(); ++i) {
    widest_mm = std::max(widest_mm, middles_mm[i] - middles_mm[i - 1]);
  }
  return widest_mm;
}

}  // namespace

RayNumbers::Terms RayNumbers::TermsAt(double y_mm) const {
  // Beyond the samples as at their end: a series runs away there.
  const double u = std::clamp((y_mm - middle_mm_) / half_mm_, -1.0, 1.0);
  Terms terms{Eigen::VectorXd(weights_.size()), Eigen::VectorXd(weights_.size())};
  double value = u, before = 1, slope = 1, slope_before = 0;
  for (Eigen::Index k = 0; k < weights_.size(); ++k) {
    terms.values[k] = value, terms.slopes[k] = slope / half_mm_;
    const double next = 2 * u * value - before,
                 next_slope = 2 * value + 2 * u * slope - slope_before;
    before = value, value = next;
    slope_before = slope, slope = next_slope;
  }
  terms.values += (y_mm - middle_mm_ - u * half_mm_) * terms.slopes;
  return terms;
}

double RayNumbers::At(double y_mm) const { return weights_.dot(TermsAt(y_mm).values); }

double RayNumbers::PitchMm(double y_mm) const { return 1.0 / weights_.dot(TermsAt(y_mm).slopes); }

double RayNumbers::PlaceMm(double number, double near_mm) const {
  // Newton's steps: a ray's number grows all the way, and hardly bends over a step.
  double y_mm = near_mm;
  for (int i = 0; i < 8; ++i) y_mm += (number - At(y_mm)) * PitchMm(y_mm);
  return y_mm;
}

std::optional<RayNumbers> RayNumbers::Of(std::span<const NeighbouringRays> neighbours) {
  double low_mm = 1e300, high_mm = -1e300;
  for (const NeighbouringRays& pair : neighbours) {
    low_mm = std::min(low_mm, pair.from_mm);
    high_mm = std::max(high_mm, pair.to_mm);
  }
  if (!(high_mm > low_mm)) return std::nullopt;
  RayNumbers numbers;
  numbers.middle_mm_ = 0.5 * (low_mm + high_mm);
  numbers.half_mm_ = 0.5 * (high_mm - low_mm);
  const auto most = static_cast<Eigen::Index>(neighbours.size() / kNumbers.pairs_a_term);
  const auto of_gap = static_cast<Eigen::Index>(numbers.half_mm_ / WidestGapMm(neighbours));
  for (Eigen::Index terms =
           std::min({kNumbers.most_terms, most, std::max<Eigen::Index>(1, of_gap)});
       terms > 0; --terms) {
    numbers.weights_ = Eigen::VectorXd::Zero(terms);
    if (numbers.FitTo(neighbours)) return numbers;
  }
  return std::nullopt;
}

bool RayNumbers::FitTo(std::span<const NeighbouringRays> neighbours) {
  const Eigen::Index n = weights_.size();
  std::vector<double> off;
  for (int round = 0; round < kNumbers.rounds; ++round) {
    Eigen::MatrixXd normal = Eigen::MatrixXd::Zero(n, n);
    Eigen::VectorXd right = Eigen::VectorXd::Zero(n);
    for (const NeighbouringRays& pair : neighbours) {
      const Eigen::VectorXd step = TermsAt(pair.to_mm).values - TermsAt(pair.from_mm).values;
      if (round > 0 && std::abs(weights_.dot(step) - 1.0) > kNumbers.another) continue;
      normal += step * step.transpose();
      right += step;
    }
    weights_ = SolveSymmetric(normal, right);
    if (!weights_.allFinite()) return false;
  }
  for (std::size_t i = 0; i <= kNumbers.checked; ++i) {
    const double u = 2.0 * static_cast<double>(i) / kNumbers.checked - 1.0;
    if (!(PitchMm(middle_mm_ + u * half_mm_) > 0)) return false;
  }
  for (const NeighbouringRays& pair : neighbours) {
    off.push_back(std::abs(At(pair.to_mm) - At(pair.from_mm) - 1.0));
  }
  constexpr double kPerMedian = 1.4826;  // 1 sigma of normal errors over the median of their size
  uneven_ = kPerMedian * Median(std::move(off));
  return true;
}

}  // namespace bendloop::pipeline
