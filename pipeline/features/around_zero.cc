// SPDX-License-Identifier: Apache-2.0
#include "pipeline/features/around_zero.h"

#include <algorithm>
#include <cmath>

#include "hal/angles.h"
#include "hal/tube_features.h"
#include "pipeline/fit/tube_parameters.h"
#include "pipeline/math/dense_product.h"

namespace bendloop::pipeline {
namespace {

// Of a segment's local state (fit/surface_sums.h): its angular velocity about its tangent and about
// normal x tangent.
constexpr Eigen::Index kTurnState = 3;

}  // namespace

AroundZeroSigma::AroundZeroSigma(const SurfaceFit& fit, const hal::Tube& tube)
    : segments_(hal::SpineSegments(tube.program, tube.X_WT)) {
  const TubeParameters fixed_radius(fit.tube, false, fit.flattening, fit.easing);
  const TubeParameters parameters(fit.tube, fit.covariance.rows() > fixed_radius.size(),
                                  fit.flattening, fit.easing);
  const auto fitted = hal::SpineSegments(fit.tube.program, fit.tube.X_WT);
  if (parameters.size() != fit.covariance.rows() || fitted.size() != segments_.size()) return;
  const auto derivatives = parameters.FrameDerivatives(fitted);
  for (const Eigen::MatrixXd& derivative : derivatives) {
    const Eigen::MatrixXd turn = derivative.middleRows(kTurnState, 2);
    turn_.emplace_back(Mapped(turn, fit.covariance));
  }
}

double AroundZeroSigma::DegAt(double along_mm) const {
  if (turn_.empty()) return 0.0;
  std::size_t at = hal::SegmentAt(segments_, along_mm);
  double on_mm = std::clamp(along_mm - segments_[at].from_start_mm, 0.0, segments_[at].length_mm);
  // A straight counts from the bend before.
  if (!segments_[at].is_arc() && at > 0) on_mm = segments_[--at].length_mm;
  const double turn = segments_[at].is_arc() ? on_mm / segments_[at].bend_radius_mm : 0.0;
  const Eigen::Vector2d tangent(std::cos(turn), std::sin(turn));
  return std::sqrt(std::max(0.0, tangent.dot(turn_[at] * tangent))) * hal::kDegreesPerRadian;
}

void AddAroundZero(const AroundZeroSigma& zero, Measurement& measurement) {
  const auto add = [&](double along_mm, double& sigma_deg) {
    sigma_deg = std::min(180.0, std::hypot(sigma_deg, zero.DegAt(along_mm)));
  };
  for (OpeningFound& found : measurement.features.openings) {
    add(found.opening.along_mm, found.sigma.around_deg);
  }
  for (DentFound& dent : measurement.dents) add(dent.along_mm, dent.around_sigma_deg);
  if (measurement.seam) add(0.0, measurement.seam->around_sigma_deg);
  auto &first = measurement.features.first_end, &last = measurement.features.last_end;
  if (first) add(0.0, first->around_sigma_deg);
  if (last) add(hal::SpineLength(measurement.tube.program), last->around_sigma_deg);
}

}  // namespace bendloop::pipeline
