// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <cstddef>
#include <span>
#include <vector>

#include "pipeline/features/opening_border.h"

namespace bendloop::pipeline {

// How likely what is known of the wall about an opening is, were its border this. Samples are a
// Poisson process that is nothing inside; rays of laser lines meet the wall outside and nothing
// inside. It is asked of the same samples and rays for all shapes, or these would not compare.
class OpeningLikelihood {
 public:
  // `about`: where the border roughly is, as long as it may be about; the rest as in FitOpening.
  OpeningLikelihood(std::span<const Eigen::Vector2d> samples, std::span<const MissedPlace> missed,
                    std::span<const Eigen::Vector2d> scattered, const OpeningBorder& about,
                    double smear_mm);

  bool has_missed() const { return !missed_.empty(); }
  // Of the displacement of samples: this part of how far scattered ones lie apart.
  double BlurOfGaps(double part) const { return part / std::sqrt(density_.per_mm2) / smear_mm_; }
  // Whether what lies there was looked at.
  bool IsInZone(const Eigen::Vector2d& place_mm) const;
  // Whether there are samples that lie further this way than a place does.
  bool HasSampleBeyond(const Eigen::Vector2d& place_mm, const Eigen::Vector2d& direction) const;
  // [log] `blur`: how many times more samples and rays are displaced than they are.
  double Log(const OpeningBorder& border, double blur) const;

 private:
  double LogFlat(const OpeningBorder& border, double blur) const;
  double LogLeaning(const OpeningBorder& border, double blur) const;
  double LogHit(double square_mm2, double width_mm, double sideways_mm, double blur) const;
  double LogMissed(double square_mm2, double width_mm, double sideways_mm, double sideways_sigma_mm,
                   double blur) const;
  double HeightMm(double y_mm) const;
  std::size_t Reached(const OpeningBorder& border, double reach_mm) const;
  double FreeMm(double width_mm, double blur) const;

  OpeningBorder zone_;
  double smear_mm_;
  SampleDensity density_;         // of scattered ones, about the middle of the zone
  double sideways_smear_mm_ = 0;  // beside it, of laser lines: as their missed rays
  std::vector<Eigen::Vector2d> near_;
  std::vector<MissedPlace> missed_;
  std::vector<double> near_far_mm_;          // of each from the middle, the nearest first
  std::vector<double> near_up_, missed_up_;  // how high the wall is at each
  double lowest_up_ = 0, highest_up_ = 0;    // of the samples
};

}  // namespace bendloop::pipeline
