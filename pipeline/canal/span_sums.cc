// SPDX-License-Identifier: Apache-2.0
#include "pipeline/canal/span_sums.h"

#include <Eigen/Dense>
#include <cmath>

#include "pipeline/math/quantiles.h"

namespace bendloop::pipeline {

void CanalDistances::Follow(const CanalSurface& surface) {
  for (std::size_t i = 0; i < points_.size(); ++i) {
    feet_[i] = surface.FootNear(points_[i], feet_[i].t);
  }
}

double CanalDistances::SigmaMm(double reach_mm) const {
  std::vector<double> magnitudes;
  for (const CanalFoot& foot : feet_) {
    const double d = std::abs(foot.distance_mm);
    if (!foot.beyond && d < reach_mm) magnitudes.push_back(d);
  }
  return 1.4826 * Median(std::move(magnitudes));
}

void CanalDistances::Sum(const CanalSurface& surface, double cut_mm) {
  spans_.assign(static_cast<std::size_t>(surface.spans()), {});
  weight_ = 0;
  const double most_mm2 = cut_mm * cut_mm / 3;
  for (std::size_t i = 0; i < points_.size(); ++i) {
    const CanalFoot& foot = feet_[i];
    Eigen::Vector4d w;
    SpanSums& sums =
        spans_[static_cast<std::size_t>(CanalSurface::Span(foot.t, surface.spans(), w))];
    const double u = foot.distance_mm / cut_mm;
    if (foot.beyond || std::abs(u) >= 1) {
      sums.loss_mm2 += most_mm2;
      continue;
    }
    const double fading = 1 - u * u;
    const double weight = fading * fading;
    // The distance grows when the centre moves away from the point or the radius shrinks.
    const Eigen::Vector3d out = (points_[i] - surface.At(foot.t).head<3>()).normalized();
    SpanSums::Vector derivative;
    for (int a = 0; a < 4; ++a) derivative.segment<4>(4 * a) << -w[a] * out, -w[a];
    sums.matrix.noalias() += weight * derivative * derivative.transpose();
    sums.gradient += weight * foot.distance_mm * derivative;
    sums.loss_mm2 += most_mm2 * (1 - fading * weight);
    weight_ += weight;
  }
}

}  // namespace bendloop::pipeline
