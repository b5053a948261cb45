// SPDX-License-Identifier: Apache-2.0
#include "pipeline/features/local_wall.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "pipeline/fit/surface_points.h"
#include "pipeline/math/dense_solve.h"
#include "pipeline/math/quantiles.h"

namespace bendloop::pipeline {
namespace {

struct LocalSettings {
  // Samples that are asked, and how often.
  std::size_t enough = 3000;
  int rounds = 6;
  double far = 4.0;  // [sigma] What lies further off has no weight.
  // [of r_P, about] 1 sigma of the numbers before the scan, for places that few samples tell of.
  double form = 0.05;
};
constexpr LocalSettings kLocal;

}  // namespace

LocalWall::LocalWall(std::span<const OffWall> samples, double reach_mm, double noise_mm)
    : reach_mm_(reach_mm), sigma_mm_(noise_mm) {
  if (samples.empty()) return;
  std::vector<OffWall> asked;
  std::vector<double> off_mm;
  const std::size_t stride = StrideTo(samples.size(), kLocal.enough);
  for (std::size_t i = 0; i < samples.size(); i += stride) {
    asked.push_back(samples[i]);
    off_mm.push_back(samples[i].off_mm);
  }
  constexpr double kPerMedian = 1.4826;  // 1 sigma of normal errors over the median of their size
  form_[0] = Median(off_mm);
  for (int round = 0; round < kLocal.rounds; ++round) {
    off_mm.clear();
    for (const OffWall& sample : asked) {
      off_mm.push_back(std::abs(sample.off_mm - RowAt(sample.place_mm).dot(form_)));
    }
    sigma_mm_ = std::max(noise_mm, kPerMedian * Median(off_mm));
    Eigen::Matrix<double, 6, 6> normal =
        std::pow(noise_mm / (kLocal.form * reach_mm), 2) * Eigen::Matrix<double, 6, 6>::Identity();
    Numbers right = Numbers::Zero();
    for (std::size_t i = 0; i < asked.size(); ++i) {
      const double part = off_mm[i] / (kLocal.far * sigma_mm_);
      if (part >= 1.0) continue;
      const double weight = std::pow(1.0 - part * part, 2);
      const Numbers row = RowAt(asked[i].place_mm);
      normal += weight * row * row.transpose();
      right += weight * asked[i].off_mm * row;
    }
    form_ = SolveSymmetric(normal, right);
  }
}

LocalWall::Numbers LocalWall::RowAt(const Eigen::Vector2d& place_mm) const {
  const double x = place_mm.x() / reach_mm_, y = place_mm.y() / reach_mm_;
  Numbers row;
  row << 1.0, x, y, x * x, x * y, y * y;
  return row;
}

double LocalWall::SigmasBelow(const OffWall& sample) const {
  return (RowAt(sample.place_mm).dot(form_) - sample.off_mm) / sigma_mm_;
}

}  // namespace bendloop::pipeline
