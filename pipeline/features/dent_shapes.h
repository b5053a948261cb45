// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "pipeline/features/dent_form.h"

namespace bendloop::pipeline {

// How deep a dent is, of its depth in the middle, at a place z from there: along and around the
// tube, each about 1 where it is half as deep.

// At such a place, and its derivatives to it and to the shape's own numbers.
template <std::size_t kNumbers>
struct DentRow {
  double f = 0, by_along = 0, by_around = 0;
  std::array<double, kNumbers> by{};
};

// The logarithm of the power of a flat without a tail or a bottom whose flanks are as steep, for
// its size and depth, where it is half as deep.
inline double LogSteepness(const DentForm& form) {
  return std::log(-2.0 / std::numbers::ln2 * form.At(form.HalfQ()).by_log_q);
}
// The logarithm of the tangent of its slope there, of its depth over 1.
inline double LogSlope(const DentForm& form) {
  return LogSteepness(form) + std::log(std::numbers::ln2) - 0.5 * std::log(form.HalfQ());
}

// From millimetres to such places: (along, around) = (of_u u + lean v, of_v v).
struct DentScale {
  double of_u, lean, of_v;
};

// What balls, edges and blocks press: ellipses of equal depth.
class RoundDent {
 public:
  enum { kPower, kTail, kBottom, kNumbers };
  using Numbers = std::array<double, kNumbers>;
  // Before the scan, and 1 sigma. Balls and edges press gaussians, flats have a power of up to 3; a
  // tail of 1 would be 1 / (1 + q^s), and what is less than 0 ends somewhere.
  static constexpr Numbers kExpected = {0, 0, -0.4}, kSigma = {0.5, 0.5, 0.7};
  static constexpr std::array kTails = {kTail};

  explicit RoundDent(const Numbers& x)
      : form_({.log_power = x[kPower], .tail = x[kTail], .log_bottom = x[kBottom]}) {}

  DentRow<kNumbers> At(double along, double around) const {
    const double q = std::max(1e-12, along * along + around * around);
    const DentForm::Row row = form_.At(q);
    const double by_q = row.by_log_q / q;
    return {
        row.f, 2.0 * by_q * along, 2.0 * by_q * around, {row.by_power, row.by_tail, row.by_bottom}};
  }
  // [of the square of 1] Where it is half as deep and more.
  double HalfArea() const { return std::numbers::pi * form_.HalfQ(); }
  // Of its flanks, and of their slope along its lesser axis.
  double LogSteepnessAllRound() const { return LogSteepness(form_); }
  double LogSlopeAllRound(const DentScale& to) const {
    const double half = 0.5 * (to.of_u * to.of_u + to.lean * to.lean + to.of_v * to.of_v);
    const double both = to.of_u * to.of_u * to.of_v * to.of_v;
    return LogSlope(form_) + 0.5 * std::log(half + std::sqrt(std::max(0.0, half * half - both)));
  }

 private:
  DentForm form_;
};

// What jaws press: a plane across the tube that ends where it meets the round wall, as long as the
// jaw is wide. One depth along the tube times another around it.
class FlatDent {
 public:
  enum { kPower, kTail, kBottom, kPowerAround, kTailAround, kNumbers };
  using Numbers = std::array<double, kNumbers>;
  // Along the tube it is flat to its edges; around it falls off as a parabola to where it ends.
  static constexpr Numbers kExpected = {1.1, 0, -0.4, 0, -1}, kSigma = {0.5, 0.5, 0.7, 0.3, 0.3};
  static constexpr std::array kTails = {kTail, kTailAround};

  explicit FlatDent(const Numbers& x)
      : along_({.log_power = x[kPower], .tail = x[kTail], .log_bottom = x[kBottom]}),
        around_({.log_power = x[kPowerAround], .tail = x[kTailAround], .log_bottom = kNoBottom}) {}

  DentRow<kNumbers> At(double along, double around) const {
    const double q = std::max(1e-12, along * along), p = std::max(1e-12, around * around);
    const DentForm::Row f = along_.At(q), g = around_.At(p);
    return {
        f.f * g.f,
        2.0 * f.by_log_q * g.f * along / q,
        2.0 * f.f * g.by_log_q * around / p,
        {f.by_power * g.f, f.by_tail * g.f, f.by_bottom * g.f, f.f * g.by_power, f.f * g.by_tail}};
  }
  double HalfArea() const {
    // By Simpson's rule over its half width, from the middle to where it is half as deep there:
    // taken as the sine of an angle, as the border meets the axis at right angles.
    constexpr int kSteps = 32;
    const double half = std::sqrt(around_.HalfQ());
    double sum = 0;
    for (int i = 0; i < kSteps; ++i) {
      const double angle = 0.5 * std::numbers::pi * i / kSteps;
      const double there = half * std::sin(angle);
      const double rest = std::min(1.0, 0.5 / around_.At(std::max(1e-12, there * there)).f);
      sum += (i == 0       ? 1.0
              : i % 2 == 1 ? 4.0
                           : 2.0) *
             std::sqrt(along_.QAt(rest)) * std::cos(angle);
    }
    return 4.0 * half * sum * 0.5 * std::numbers::pi / kSteps / 3.0;
  }
  // A jaw's edges are as sharp as they are, but around the tube its flat runs out.
  double LogSteepnessAllRound() const {
    return std::min(LogSteepness(along_), LogSteepness(around_));
  }
  double LogSlopeAllRound(const DentScale& to) const {
    return std::min(LogSlope(along_) + std::log(std::hypot(to.of_u, to.lean)),
                    LogSlope(around_) + std::log(to.of_v));
  }

 private:
  static constexpr double kNoBottom = -3.0;
  DentForm along_, around_;
};

}  // namespace bendloop::pipeline
