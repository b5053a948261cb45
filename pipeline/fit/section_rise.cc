// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/section_rise.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <utility>
#include <vector>

#include "pipeline/fit/easing_fit.h"

namespace bendloop::pipeline {
namespace {

struct RiseSettings {
  std::size_t points = 16'000;
  // [of r_P] Half lengths that are tried first; the step from the best of them on, and how small it
  // becomes; the shortest and the longest.
  std::array<double, 3> first{0.3, 0.6, 1.0};
  double step = 0.15, fine = 0.03, least = 0.1, most = 1.5;
  // [of r_P] Easing to begin with, of bends that seem sharp.
  double easing = 0.15;
  // [variances] By so much it may be worse: most bends that are not round get a rise. That the
  // section rises with the curvature is a guess, by which the oval would tell where a bend begins.
  double worse = 4.0;
  // [sigma] From which on samples insist on easing beside the rise.
  double insist = 3.0;
  // [of r_P] So far a bend's outer wall stands out where it is taped or sleeved.
  double stands_out = 0.01;
  // [variances] Of less no step is worth it; and so many fits are enough.
  double better = 0.1;
  int most_fits = 40;
};
constexpr RiseSettings kRise;

// A fit by few points, and how much better it is than the one without a rise.
struct Trial {
  SectionRise rise;
  double gain = 0;
  SurfaceFit fit;
};

// Whether it ends before the next bend begins, and within a quarter turn of each.
bool HasRoom(const SectionRise& rise, const hal::BendProgram& program) {
  for (std::size_t i = 0; i < program.bend_count(); ++i) {
    const hal::BendRow& row = program.rows[i];
    if (i > 0 && rise.half_mm + rise.before_mm > row.length_mm) return false;
    const double quarter_mm = 0.5 * std::numbers::pi * row.bend_radius_mm.value_or(0.0);
    if (rise.half_mm - rise.before_mm > quarter_mm) return false;
  }
  return true;
}

// No bender makes such a wall: something is around it.
bool StandsOut(const SurfaceFit& fit) {
  return std::any_of(fit.flattening.begin(), fit.flattening.end(),
                     [](const Flattening& of) { return of.OuterWallPart() < -kRise.stands_out; });
}

// The best of few, then from there along both numbers as long as that is better, by smaller and
// smaller steps.
class RiseSearch {
 public:
  RiseSearch(const BowedSolution& solution, std::span<const PointBlock> blocks,
             const SurfaceFitOptions& options)
      : few_(Gathered(blocks, StrideTo(CountPoints(blocks), kRise.points))), with_(options) {
    more_ = static_cast<double>(CountPoints(blocks)) / static_cast<double>(few_.point_count());
    with_.report = FitReport::kCost;
    with_.easing = solution.fit.easing;
    without_ = FitSurface(solution.fit.tube, few_, with_);
    r_mm_ = without_.tube.pipe_radius_mm;
    if (with_.easing.empty()) {
      with_.easing.variance_mm2.assign(without_.tube.program.bend_count(),
                                       std::pow(kRise.easing * r_mm_, 2));
    }
    with_.easing.skew.clear();
  }

  Trial Best() {
    for (const double half : kRise.first) Try({half * r_mm_, 0.0});
    for (double step_mm = kRise.step * r_mm_;
         step_mm > kRise.fine * r_mm_ && fits_ < kRise.most_fits;) {
      const SectionRise from = best_.rise;
      for (const double by_mm : {-step_mm, step_mm}) {
        Try({from.half_mm + by_mm, from.before_mm});
        Try({from.half_mm, from.before_mm + by_mm});
      }
      const bool rests =
          best_.rise.half_mm == from.half_mm && best_.rise.before_mm == from.before_mm;
      if (rests) step_mm *= 0.5;
    }
    if (!best_.rise.is_none()) StaySharp();
    return std::move(best_);
  }

 private:
  void Try(const SectionRise& rise) {
    if (rise.half_mm < kRise.least * r_mm_ || rise.half_mm > kRise.most * r_mm_ ||
        std::abs(rise.before_mm) > rise.half_mm || !HasRoom(rise, without_.tube.program)) {
      return;
    }
    ++fits_;
    with_.section_rise = rise;
    if (!best_.fit.easing.empty()) with_.easing = best_.fit.easing;
    SurfaceFit fit = FitSurface(without_.tube, few_, with_);
    const double gain = GainOf(fit, without_, with_);
    if (best_.rise.is_none() || gain > best_.gain + kRise.better) {
      best_ = {rise, gain, std::move(fit)};
    }
  }

  // Unless the points, of all of them so many times as many, insist on easing.
  void StaySharp() {
    with_.section_rise = best_.rise;
    with_.easing = {};
    SurfaceFit sharp = FitSurface(best_.fit.tube, few_, with_);
    const double gain = more_ * GainOf(best_.fit, sharp, with_);
    if (!(gain > kRise.insist * kRise.insist * sharp.design_effect)) best_.fit = std::move(sharp);
  }

  OwnedBlocks few_;
  SurfaceFitOptions with_;
  double more_ = 1, r_mm_ = 0;
  SurfaceFit without_;
  int fits_ = 0;
  Trial best_;
};

}  // namespace

void TrySectionRise(std::span<const PointBlock> blocks, SurfaceFitOptions& options,
                    BowedSolution& solution) {
  if (!options.flattened || solution.bows.is_lost) return;
  const auto fitted = solution.undented ? std::span<const PointBlock>(*solution.undented) : blocks;
  const Trial best = RiseSearch(solution, fitted, options).Best();
  if (best.rise.is_none() || !(best.gain >= -kRise.worse * best.fit.design_effect)) return;
  SurfaceFitOptions with = options;
  with.section_rise = best.rise;
  with.easing = best.fit.easing;
  BowedSolution other = SolveWithBows(best.fit.tube, blocks, with);
  if (!IsOfSameBends(other, solution) || StandsOut(other.fit)) return;
  if (!(AdvantageOf(other, solution, blocks, options.reach_mm) >= -kRise.worse)) return;
  options = std::move(with);
  solution = std::move(other);
}

}  // namespace bendloop::pipeline
