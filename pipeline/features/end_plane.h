// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <cstddef>
#include <vector>

#include "pipeline/features/end_curve.h"
#include "pipeline/features/posterior.h"

namespace bendloop::pipeline {

struct EndPlaneSettings {
  // Slopes before the scan, 1 sigma: any that a saw makes. Samples that leave more than a tenth of
  // it open tell nothing of the cut; its pull on others is below a hundredth of their sigma's
  // reach.
  double usual_slope = 0.5;
  // [sigma] From a square cut; closer ones are taken for it.
  double oblique = 5.0;
  // [sigma] Less may be by chance.
  double may_be_oblique = 2.5;
  // Odds before the scan that an end is not square, and how many times the least slope that is not
  // is the greatest.
  double oblique_odds = 0.25, slopes = 100.0;
  // How many samples of all may lie beyond the end, as fliers do.
  double fliers = 3.0, flier_part = 0.005;
};
inline constexpr EndPlaneSettings kEndPlane;

// Where the plane of an end is: beyond_mm = at_mm + pipe radius (cosine cos(around) + sine
// sin(around)).
struct EndPlane {
  double at_mm = 0, at_sigma_mm = 0;
  double cosine = 0, sine = 0;  // the slope, towards where the tube is longest
  double slope_sigma = 0;       // of either
  double slope_sigmas = 0;      // how many sigma it is from a square cut
  bool of_lines = false;        // told by the laser lines of passes that are known
  bool of_border = false;       // told by all scattered samples beside it (end_border.h)
  bool of_columns = false;      // told by narrow columns of samples, which agree with it
  bool in_shadow = false;       // on one side samples stop before it (end_shadow.h)
  // Where no plane explains the samples: how far the border lies beyond this one, which is nearest
  // to it all round.
  std::vector<BorderPlace> border;
  int border_terms = 3;  // numbers that it and the plane take

  double Slope() const { return std::hypot(cosine, sine); }
  bool MayBeOblique() const { return slope_sigmas >= kEndPlane.may_be_oblique; }
  bool IsOblique() const { return slope_sigmas >= kEndPlane.oblique; }
  // mm at the axis, and of the slope at the pipe radius.
  Eigen::Vector3d Numbers(double pipe_radius_mm) const {
    return {at_mm, pipe_radius_mm * cosine, pipe_radius_mm * sine};
  }
};

// `slope_mm`: that the posterior counts from.
EndPlane PlaneOf(const Posterior& posterior, const Eigen::Vector2d& slope_mm,
                 double pipe_radius_mm);

// Of an end that it was cut as oblique as its plane says, and not square: of slopes within `slopes`
// each power of ten is as likely, so that one of z sigma was expected within its sigma with the
// probability 1 / (z^2 ln slopes).
double LogOddsOfOblique(const EndPlane& plane);

// Where an end meets the axis.
struct EndPlace {
  double at_mm = 0, variance_mm2 = 0;
};
// That of a square cut, or of an oblique one: both, by the logarithm of the odds of the latter.
EndPlace OfEither(const EndPlace& square, const EndPlace& oblique, double log_odds);

// Whether so many samples beyond an end, of all about it, may be fliers.
inline bool MayBeFliers(double beyond, std::size_t all) {
  return beyond <= kEndPlane.fliers + kEndPlane.flier_part * static_cast<double>(all);
}

}  // namespace bendloop::pipeline
