// SPDX-License-Identifier: Apache-2.0
#include "pipeline/math/arc_tangents.h"

#include <cmath>
#include <cstddef>
#include <numbers>

#include "pipeline/math/simd.h"

namespace bendloop::pipeline {
namespace {

// Two half angles, then the series, whose next term is below 1e-18. Without a branch, so that
// several are taken at once.
BENDLOOP_LOOP void FindTurnsBody(const double* y, const double* x, std::size_t count,
                                 double* turn) {
  for (std::size_t i = 0; i < count; ++i) {
    const double across = std::abs(y[i]), along = std::abs(x[i]);
    const double less = across < along ? across : along;
    const double more = across < along ? along : across;
    double t = less / (more > 0 ? more : 1.0);
    t = t / (1.0 + std::sqrt(1.0 + t * t));
    t = t / (1.0 + std::sqrt(1.0 + t * t));
    const double s = t * t;
    double sum = 1.0 / 23.0;
    sum = 1.0 / 21.0 - s * sum;
    sum = 1.0 / 19.0 - s * sum;
    sum = 1.0 / 17.0 - s * sum;
    sum = 1.0 / 15.0 - s * sum;
    sum = 1.0 / 13.0 - s * sum;
    sum = 1.0 / 11.0 - s * sum;
    sum = 1.0 / 9.0 - s * sum;
    sum = 1.0 / 7.0 - s * sum;
    sum = 1.0 / 5.0 - s * sum;
    sum = 1.0 / 3.0 - s * sum;
    double angle = 4.0 * t * (1.0 - s * sum);
    angle = across > along ? 0.5 * std::numbers::pi - angle : angle;
    angle = x[i] < 0 ? std::numbers::pi - angle : angle;
    turn[i] = y[i] < 0 ? -angle : angle;
  }
}
BENDLOOP_MULTIVERSION(void, FindTurns,
                      (const double* y, const double* x, std::size_t count, double* turn),
                      (y, x, count, turn))

}  // namespace

void ArcTangents(std::span<const double> y, std::span<const double> x, std::span<double> turn) {
  FindTurns(y.data(), x.data(), turn.size(), turn.data());
}

}  // namespace bendloop::pipeline
