// SPDX-License-Identifier: Apache-2.0
#include "pipeline/structure/lateral_profile.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "hal/spine.h"
#include "pipeline/fit/surface_pass.h"
#include "pipeline/math/quantiles.h"

namespace bendloop::pipeline {
namespace {

// A part of the places, and the same quantile of chi square with one degree of freedom.
struct Usual {
  double part, chi_square;
};

struct LateralSettings {
  // [of r_P] Between places: one is as long as the pipe is wide in half.
  double step = 1.0;
  // Samples of a place that tell nothing of it. By trial.
  double few_samples = 5;
  // [of the samples' information in the better direction] Less leaves the other one open. By trial.
  double known_direction = 0.2;
  // [of r_P] From where a bend begins: it eases in so long. By trial.
  double near_bend = 1.5;
  // Places that tell nothing of a tube. By trial.
  std::size_t few_places = 8;
  // On straights missing bends and dents are in the other places. A bend eases at its ends only, a
  // fifth of its places.
  Usual on_straights{0.6, 0.708}, near_bends{0.8, 1.642};
  // Two standard errors of a variance from one place's quantile.
  double unsure = 2.6;
  // The form that explains a place may be so many times what the best lines and arcs leave of it: a
  // bow of a tenth of ten pipe radii leaves a third of its height (rms), and adds up along the
  // straight.
  double of_residual = 3.0;
  // [of r_P] No pipe is truer than that: its wall is rough and out of round by more.
  double least = 0.0005;
};
constexpr LateralSettings kLateral;

// How far places lie off, squared, in every direction that their samples tell.
class Squares {
 public:
  void Add(const LateralPlace& place, double noise_mm2) {
    if (place.samples < kLateral.few_samples) return;
    Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> eigen;
    eigen.computeDirect(place.information);
    for (const int i : {0, 1}) {
      const double information = eigen.eigenvalues()[i];
      if (information < kLateral.known_direction * eigen.eigenvalues()[1]) continue;
      const double off_mm = eigen.eigenvectors().col(i).dot(place.pull) / information;
      of_places_.push_back(off_mm * off_mm);
      of_noise_.push_back(noise_mm2 / information);
    }
  }
  std::size_t size() const { return of_places_.size(); }
  // Beyond what noise explains, of the usual place.
  double ExcessMm2(const Usual& usual) const {
    if (size() < kLateral.few_places) return 0.0;
    const double unsure = 1.0 + kLateral.unsure / std::sqrt(static_cast<double>(size()));
    return std::max(
        0.0, Quantile(of_places_, usual.part) / usual.chi_square - unsure * Median(of_noise_));
  }

 private:
  std::vector<double> of_places_, of_noise_;  // mm^2
};

}  // namespace

std::vector<std::vector<LateralPlace>> LateralProfile(const SurfaceFit& fit,
                                                      std::span<const PointBlock> blocks,
                                                      double reach_mm, double limit_mm) {
  const auto segments = hal::SpineSegments(fit.tube.program, fit.tube.X_WT);
  const double r_mm = fit.tube.pipe_radius_mm;
  SurfaceAssignment assignment;
  AssignPoints(SegmentFrames(segments, kBeyond * r_mm, fit.flattening), r_mm, blocks, reach_mm,
               assignment);
  std::vector<std::vector<LateralPlace>> profile(segments.size());
  for (std::size_t k = 0; k < segments.size(); ++k) {
    const hal::SpineSegment& segment = segments[k];
    const SegmentPoints& points = assignment.segments[k];
    auto& places = profile[k];
    if (!(segment.length_mm > 0)) continue;
    places.resize(static_cast<std::size_t>(std::ceil(segment.length_mm / (kLateral.step * r_mm))));
    const double step_mm = segment.length_mm / static_cast<double>(places.size());
    for (std::size_t i = 0; i < places.size(); ++i) {
      places[i].along_mm = (static_cast<double>(i) + 0.5) * step_mm;
    }
    for (Eigen::Index i = 0; i < static_cast<Eigen::Index>(points.size); ++i) {
      const double d = points.distance[i];
      if (std::abs(d) > limit_mm) continue;
      double along_mm = points.x[i];
      Eigen::Vector2d outward(points.y[i], points.z[i]);
      if (segment.is_arc()) {  // its frame turns along: across is inward
        along_mm = segment.bend_radius_mm * std::atan2(points.x[i], -points.y[i]);
        outward[0] = segment.bend_radius_mm - std::hypot(points.x[i], points.y[i]);
      }
      if (along_mm < 0 || along_mm >= segment.length_mm) continue;
      outward.normalize();
      LateralPlace& place =
          places[std::min(static_cast<std::size_t>(along_mm / step_mm), places.size() - 1)];
      place.samples += 1;
      place.information += outward * outward.transpose();
      place.pull += d * outward;
    }
  }
  return profile;
}

FormDeviation EstimateForm(const SurfaceFit& fit, std::span<const PointBlock> blocks,
                           double reach_mm, const FormDeviation& most) {
  const double limit_mm = kNoWeight * std::hypot(fit.sigma_mm, fit.form_mm);
  const double noise_mm2 = fit.sigma_mm * fit.sigma_mm * fit.design_effect;
  const double near_mm = kLateral.near_bend * fit.tube.pipe_radius_mm;
  const auto segments = hal::SpineSegments(fit.tube.program, fit.tube.X_WT);
  const auto profile = LateralProfile(fit, blocks, reach_mm, limit_mm);
  // Straights bow, bends ease: of both what is usual.
  Squares on_straights, near_bends;
  for (std::size_t k = 0; k < profile.size(); ++k) {
    for (const LateralPlace& place : profile[k]) {
      const bool is_near =
          segments[k].is_arc() || (k > 0 && place.along_mm < near_mm) ||
          (k + 1 < profile.size() && segments[k].length_mm - place.along_mm < near_mm);
      (is_near ? near_bends : on_straights).Add(place, noise_mm2);
    }
  }
  FormDeviation form = most;
  if (on_straights.size() + near_bends.size() < kLateral.few_places) return form;
  const double excess_mm2 = std::max(on_straights.ExcessMm2(kLateral.on_straights),
                                     near_bends.ExcessMm2(kLateral.near_bends));
  const double across = kLateral.of_residual * std::sqrt(excess_mm2) / fit.tube.pipe_radius_mm;
  form.across = std::clamp(across, std::min(kLateral.least, most.across), most.across);
  return form;
}

}  // namespace bendloop::pipeline
