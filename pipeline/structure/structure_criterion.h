// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>

#include "pipeline/fit/surface_fit.h"

namespace bendloop::pipeline {

// Which of two structures explains the same samples better: twice the logarithm of the odds, the
// evidence for each taken near its fit (FitPriors::OccamPenalty()).
class StructureCriterion {
 public:
  // `caution`: times the usual evidence is asked for.
  StructureCriterion(std::size_t samples, double caution);

  // About what a parameter costs that the samples know well.
  double price() const { return price_; }
  // By how much `a` explains the samples better than `b`; the variance is taken from the better fit
  // of the two. Every sample costs at most some sigma: what neither model explains must not decide
  // between them.
  double Gain(const SurfaceFit& a, const SurfaceFit& b) const;
  // By how much `a` is better, with what both cost.
  double Advantage(const SurfaceFit& a, const SurfaceFit& b) const {
    return Gain(a, b) + PriceOf(b) - PriceOf(a);
  }
  bool IsBetter(const SurfaceFit& a, const SurfaceFit& b) const { return Advantage(a, b) > 0; }
  // Whether the samples insist that the bends are not round. Out of nothing but noise the gain is
  // chi-squared with the flattening's number of parameters.
  bool IsFlattened(const SurfaceFit& round, const SurfaceFit& flattened) const;
  // [variances] By how much more than by chance they must be explained better for that.
  static double InsistOnFlattened(const SurfaceFit& flattened);
  // [mm^2] And by as much as bends look oval where passes do not meet.
  static double AsSidesMm2(const SurfaceFit& flattened);

  // Of a sample, and what one costs at most, as a distance.
  static double Variance(const SurfaceFit& fit);
  static double LimitMm(const SurfaceFit& fit);

 private:
  double PriceOf(const SurfaceFit& fit) const;

  double caution_;
  double price_;
};

}  // namespace bendloop::pipeline
