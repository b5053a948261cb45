// SPDX-License-Identifier: Apache-2.0
#include "pipeline/features/end_plane.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

namespace bendloop::pipeline {

EndPlane PlaneOf(const Posterior& posterior, const Eigen::Vector2d& slope_mm,
                 double pipe_radius_mm) {
  const Eigen::Vector2d slope = (posterior.mean.segment<2>(1) + slope_mm) / pipe_radius_mm;
  const Eigen::Matrix2d covariance =
      posterior.covariance.block<2, 2>(1, 1) / (pipe_radius_mm * pipe_radius_mm);
  EndPlane plane;
  plane.at_mm = posterior.mean[0];
  plane.at_sigma_mm = posterior.Sigma(0);
  plane.cosine = slope[0];
  plane.sine = slope[1];
  plane.slope_sigma = std::sqrt(0.5 * covariance.trace());
  plane.slope_sigmas = std::sqrt(std::max(0.0, slope.dot(covariance.inverse() * slope)));
  return plane;
}

double LogOddsOfOblique(const EndPlane& plane) {
  const double z2 = plane.slope_sigmas * plane.slope_sigmas;
  return std::log(kEndPlane.oblique_odds / (std::max(1.0, z2) * std::log(kEndPlane.slopes))) +
         0.5 * z2;
}

EndPlace OfEither(const EndPlace& square, const EndPlace& oblique, double log_odds) {
  const double part = 1.0 / (1.0 + std::exp(-log_odds));  // of the oblique one
  const double apart_mm = oblique.at_mm - square.at_mm;
  return {square.at_mm + part * apart_mm, part * oblique.variance_mm2 +
                                              (1.0 - part) * square.variance_mm2 +
                                              part * (1.0 - part) * apart_mm * apart_mm};
}

}  // namespace bendloop::pipeline
