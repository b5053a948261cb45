// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cmath>
#include <numbers>

namespace bendloop::pipeline {

// How deep a dent is about its middle, of its depth there, by a quadratic form q of the place:
//   f(q) = g ((1 + m^p) / (1 + (m g)^p))^(1/p),   g(q) = (1 + (2^t - 1) q^s)^(-1/t).
// The power s tells round dents (1: g is a gaussian, where t is nothing) from flats, the tail t how
// slowly it runs out: below nothing it ends, where (1 - 2^t) q^s is 1. A block leaves a flat
// bottom: it cuts off what would go on to m times its depth. An m below one is hardly any.
class DentForm {
 public:
  struct Numbers {
    double log_power = 0, tail = 0, log_bottom = 0;  // of s, t and m
  };
  explicit DentForm(const Numbers& x)
      : s_(std::exp(x.log_power)),
        t_(std::copysign(std::max(kLeastTail, std::abs(x.tail)), x.tail)),
        twofold_(std::expm1(std::numbers::ln2 * t_)),
        log_m_(x.log_bottom),
        log_cut_(LogOnePlusExp(kSharp * log_m_)),
        cut_(std::exp(kSharp * log_m_ - log_cut_)) {}

  // f at q > 0, and its derivatives to the logarithm of q and to the numbers.
  struct Row {
    double f, by_log_q, by_power, by_tail, by_bottom;
  };
  Row At(double q) const {
    const double log_q = std::log(q);
    const double rises = std::max(kEnd, twofold_ * std::exp(std::min(kMost, s_ * log_q)));
    const double log_rises = std::log1p(rises);
    // Beyond where a dent with a tail below nothing ends, all of it is as good as nothing.
    const double log_g = rises > kEnd ? -log_rises / t_ : -kMost;
    const double share = rises / (1.0 + rises);
    const double log_mg = log_m_ + log_g, log_here = LogOnePlusExp(kSharp * log_mg);
    const double here = std::exp(kSharp * log_mg - log_here);
    Row row;
    row.f = std::exp(log_g + (log_cut_ - log_here) / kSharp);
    const double by_log_g = row.f * (1.0 - here);
    row.by_log_q = -by_log_g * share * s_ / t_;
    row.by_power = row.by_log_q * log_q;
    row.by_tail =
        by_log_g * (log_rises / t_ - share * (1.0 + twofold_) / twofold_ * std::numbers::ln2) / t_;
    row.by_bottom = row.f * (cut_ - here);
    return row;
  }

  // Where f is so much, of 0 to 1.
  double QAt(double f) const {
    // Of g^p there: f^p / (1 + m^p - m^p f^p).
    const double log_g =
        std::log(f) - (log_cut_ + std::log1p(-cut_ * std::pow(f, kSharp))) / kSharp;
    return std::pow(std::max(0.0, std::expm1(-t_ * log_g) / twofold_), 1.0 / s_);
  }
  double HalfQ() const { return QAt(0.5); }

 private:
  static constexpr double kLeastTail = 1e-4;  // as good as none, and no division by it
  static constexpr double kSharp = 12.0;      // p: so sharply
  static constexpr double kEnd = 1e-12 - 1.0;
  static constexpr double kMost = 600.0;  // of a logarithm, beyond which numbers would be infinite

  static double LogOnePlusExp(double x) {
    return std::max(0.0, x) + std::log1p(std::exp(-std::abs(x)));
  }

  double s_, t_, twofold_, log_m_;
  double log_cut_, cut_;  // of 1 + m^p; m^p / (1 + m^p)
};

}  // namespace bendloop::pipeline
