// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/comparison.h"

#include <algorithm>
#include <cmath>

#include "pipeline/tube/representations.h"

namespace bendloop::bench {
namespace {

// [mm, degrees] Less is what rounding leaves of an information that is nearly singular.
constexpr double kNoBound = 1e-6;

// The sigmas of the same tube from its other end. They are no program: a last row has a sigma of
// length only, as a program's has, and the rest moves as the values do.
hal::BendProgram ReverseSigma(const hal::BendProgram& sigma) {
  hal::BendProgram reversed = sigma;
  const std::size_t n = sigma.bend_count();
  for (std::size_t i = 0; i <= n; ++i) reversed.rows[i].length_mm = sigma.rows[n - i].length_mm;
  for (std::size_t i = 0; i < n; ++i) {
    reversed.rows[i].angle_deg = sigma.rows[n - 1 - i].angle_deg;
    reversed.rows[i].bend_radius_mm = sigma.rows[n - 1 - i].bend_radius_mm;
    reversed.rows[i].rotation_deg = i == 0 ? 0.0 : sigma.rows[n - i].rotation_deg;
  }
  return reversed;
}

double Misfit(const hal::BendProgram& a, const hal::BendProgram& b) {
  double sum = 0;
  for (std::size_t i = 0; i < a.rows.size(); ++i) {
    sum += std::pow(a.rows[i].length_mm - b.rows[i].length_mm, 2) +
           std::pow(a.rows[i].angle_deg - b.rows[i].angle_deg, 2) +
           std::pow(hal::WrapRotationDeg(a.rows[i].rotation_deg - b.rows[i].rotation_deg), 2);
  }
  return sum;
}

}  // namespace

double Ratio::Rms() const { return count > 0 ? std::sqrt(sum2 / count) : 0.0; }

void LraRatios::Add(const LraRatios& other) {
  length.Add(other.length);
  rotation.Add(other.rotation);
  angle.Add(other.angle);
  bend_radius.Add(other.bend_radius);
  pipe_radius.Add(other.pipe_radius);
}

Comparison Compare(const hal::Tube& truth, const pipeline::Measurement& measured,
                   const Bound& bound, double spacing_mm) {
  Comparison result;
  const hal::BendProgram& wanted = truth.program;
  result.bends_right = measured.tube.program.bend_count() == wanted.bend_count();
  if (!result.bends_right) return result;
  hal::BendProgram found = measured.tube.program;
  hal::BendProgram sigma = measured.sigma;
  const hal::BendProgram reversed = pipeline::ReverseTube(measured.tube).program;
  if (Misfit(reversed, wanted) < Misfit(found, wanted)) {
    found = reversed;
    sigma = ReverseSigma(sigma);
  }
  const auto note = [&result](double ratio, const char* name, std::size_t row) {
    if (!(std::abs(ratio) > result.worst_over_sigma)) return;
    result.worst_over_sigma = std::abs(ratio);
    result.worst_of_sigma = name + std::to_string(row + 1);
  };
  std::size_t i = 0;  // row
  const auto add = [&](Ratio LraRatios::*kind, const char* name, double error, double one_sigma,
                       double least, bool vague) {
    result.values.push_back({kind, error, least, vague});
    if (vague) {
      if (one_sigma > 0) result.vague.Add(error / one_sigma);
      return;
    }
    (result.plain.*kind).Add(error);
    if (one_sigma > 0) {
      (result.over_sigma.*kind).Add(error / one_sigma);
      note(error / one_sigma, name, i);
    }
    if (least < kNoBound) return;
    (result.over_bound.*kind).Add(error / least);
    result.worst_over_bound = std::max(result.worst_over_bound, std::abs(error / least));
  };
  const double r = truth.pipe_radius_mm;
  const std::size_t bends = wanted.bend_count();
  for (; i < bends; ++i) {
    const hal::BendRow& f = found.rows[i];
    const hal::BendRow& w = wanted.rows[i];
    const hal::BendRow& s = sigma.rows[i];
    const hal::BendRow& b = bound.program.rows[i];
    add(&LraRatios::angle, "A", f.angle_deg - w.angle_deg, s.angle_deg, b.angle_deg,
        !(b.angle_deg <= 5));
    add(&LraRatios::bend_radius, "CLR", *f.bend_radius_mm - *w.bend_radius_mm,
        s.bend_radius_mm.value_or(0), *b.bend_radius_mm,
        !(*b.bend_radius_mm <= *w.bend_radius_mm / 6));
    if (i == 0) continue;
    add(&LraRatios::length, "L", f.length_mm - w.length_mm, s.length_mm, b.length_mm,
        !(b.length_mm <= 0.5 * r));
    add(&LraRatios::rotation, "R", hal::WrapRotationDeg(f.rotation_deg - w.rotation_deg),
        s.rotation_deg, b.rotation_deg, !(b.rotation_deg <= 5));
  }
  add(&LraRatios::pipe_radius, "r", measured.tube.pipe_radius_mm - r, measured.pipe_radius_sigma_mm,
      bound.pipe_radius_mm, !(bound.pipe_radius_mm > 0));
  for (const std::size_t end : {std::size_t{0}, bends}) {
    const double error = found.rows[end].length_mm - wanted.rows[end].length_mm;
    result.ends_over_spacing.Add(error / spacing_mm);
    if (!(sigma.rows[end].length_mm > 0)) continue;
    result.ends_over_sigma.Add(error / sigma.rows[end].length_mm);
    note(error / sigma.rows[end].length_mm, "L", end);
  }
  return result;
}

}  // namespace bendloop::bench
