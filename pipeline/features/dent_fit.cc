// SPDX-License-Identifier: Apache-2.0
#include "pipeline/features/dent_fit.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <span>
#include <vector>

#include "pipeline/features/dent_sigma.h"
#include "pipeline/features/dent_solver.h"
#include "pipeline/math/quantiles.h"
#include "pipeline/math/simd.h"

namespace bendloop::pipeline {
namespace {

struct DentFitSettings {
  // [of its depth] and [sigma] Points further off are none of the wall's.
  double most_off = 2.5, off_sigmas = 6.0;
  // Points: fewer tell no area, or not even a depth.
  std::size_t least_points = 60, least_held = 20;
  // [of chi square] By so much a flat must explain them better than what is round does: half of it
  // is what its two numbers more might by chance.
  double flat = 20.0;
  // [of area] 1 sigma of a dent that is known no better was not fitted.
  double vague_area = 0.5;
  // Where it is half as deep and more a wall that was pressed in is all that there is: so much of
  // what is seen there lies no further from it than fliers do, or [of depth], or [of the cells'
  // depth] where its form is not known. Behind an opening and on its flanks samples lie at all
  // depths, and beside them on the wall.
  double least_whole = 0.75, whole = 0.3, whole_of_cells = 1.25;
  // [of the cells' depth] and [sigma] One that its points say is certainly no deeper than this is
  // none, nor is one that is not certainly pressed in.
  double denied = 0.5, denied_sigmas = 3.0;
  // Nor is one of which fewer points lie as deep as that, or [of depth] as flanks are: a hole right
  // there may leave no more of it.
  int least_deep = 8;
  double flank = 0.25;
};
constexpr DentFitSettings kDentFit;
// Some are left to tell how well it fits.
static_assert(kDentFit.least_held > kDentUnknowns<RoundDent> &&
              kDentFit.least_points > kDentUnknowns<FlatDent>);

// What is seen where it is half as deep and more: on it, above it and below it. `deep`: what lies
// on it anywhere, pressed in by no less than a flank.
struct Inside {
  int on = 0, above = 0, below = 0, deep = 0;
  bool MostAreNot(int other) const {
    return other <= (1.0 - kDentFit.least_whole) * (on + above + below);
  }
};
// `whole_mm`: no further off it.
template <class Shape>
Inside CountInside(const DentSolver<Shape>& fit, double whole_mm) {
  const typename DentSolver<Shape>::Size size(fit.at());
  const double depth_mm = fit.at()[kDepth];
  whole_mm = std::max(whole_mm, kDentSolver.flier * fit.noise_mm());
  Inside inside;
  for (const DentPoint& point : fit.all()) {
    const auto [off_mm, part] = fit.OffOf(point, size);
    const double in_mm = depth_mm * part - off_mm;
    if (std::abs(off_mm) <= whole_mm && in_mm > kDentFit.flank * depth_mm) ++inside.deep;
    if (part < 0.5) continue;  // beyond where it is half as deep
    ++(off_mm > whole_mm ? inside.above : off_mm < -whole_mm ? inside.below : inside.on);
  }
  return inside;
}

// How many points lie so deep below what is usual.
int CountDeep(std::span<const DentPoint> points, double deep_mm) {
  std::vector<double> off_mm;
  for (const DentPoint& point : points) off_mm.push_back(point.off_mm);
  if (off_mm.empty()) return 0;
  const double usual_mm = Median(off_mm);
  return static_cast<int>(std::count_if(off_mm.begin(), off_mm.end(),
                                        [&](double off) { return usual_mm - off > deep_mm; }));
}

// The points about a place, and what cells show of it.
struct SeenDent {
  std::span<const WallPoint> points;
  double reach_mm, depth_mm, size_mm, pipe_radius_mm, noise_mm;
};

// A dent as a shape of its kind fits it.
struct FitOfShape {
  FittedDent dent;
  Inside inside;
  double chi_square = 0;  // of all points, no more of one than fliers have
  bool is_unlike = false;
};
template <class Shape>
FitOfShape ResultOf(const DentSolver<Shape>& fit) {
  const DentNumbers<Shape> numbers(fit);
  FitOfShape result{numbers.Dent(), {}};
  result.inside = CountInside(fit, kDentFit.whole * result.dent.depth_mm);
  result.is_unlike = numbers.Unlike() > 0;
  const typename DentSolver<Shape>::Size size(fit.at());
  for (const DentPoint& point : fit.all()) {
    const double off = fit.OffOf(point, size).off_mm / fit.noise_mm();
    result.chi_square += std::min(off * off, kDentSolver.flier * kDentSolver.flier);
  }
  return result;
}

template <class Shape>
DentSolver<Shape> SolverOf(const SeenDent& seen) {
  return {seen.points,  seen.reach_mm,       seen.depth_mm,
          seen.size_mm, seen.pipe_radius_mm, seen.noise_mm};
}

bool IsDent(const FitOfShape& fit, const SeenDent& seen) {
  const FittedDent& dent = fit.dent;
  return !dent.is_step && dent.depth_sigma_mm < kVagueDepth * dent.depth_mm &&
         dent.area_sigma_mm2 < kDentFit.vague_area * dent.area_mm2 &&
         dent.depth_mm + kDentFit.denied_sigmas * dent.depth_sigma_mm >
             kDentFit.denied * seen.depth_mm &&
         dent.IsWithin(seen.reach_mm) &&
         dent.area_mm2 < std::numbers::pi * seen.reach_mm * seen.reach_mm &&
         fit.inside.deep >= kDentFit.least_deep &&
         fit.inside.MostAreNot(fit.inside.above + fit.inside.below);
}

BENDLOOP_LOOP void AddRoundRowsBody(DentSums<kDentUnknowns<RoundDent>>& sums) { AddProducts(sums); }
BENDLOOP_MULTIVERSION(void, AddRoundRows, (DentSums<kDentUnknowns<RoundDent>> & sums), (sums))
BENDLOOP_LOOP void AddFlatRowsBody(DentSums<kDentUnknowns<FlatDent>>& sums) { AddProducts(sums); }
BENDLOOP_MULTIVERSION(void, AddFlatRows, (DentSums<kDentUnknowns<FlatDent>> & sums), (sums))

}  // namespace

void AddDentRows(DentSums<kDentUnknowns<RoundDent>>& sums) { AddRoundRows(sums); }
void AddDentRows(DentSums<kDentUnknowns<FlatDent>>& sums) { AddFlatRows(sums); }

double MostOffWallMm(double depth_mm, double noise_mm) {
  return kDentFit.most_off * depth_mm + kDentFit.off_sigmas * noise_mm;
}

FittedDent FitDent(std::span<const WallPoint> points, double reach_mm, double depth_mm,
                   double size_mm, double pipe_radius_mm, double noise_mm) {
  if (!(noise_mm > 0)) return {};
  const SeenDent seen{points, reach_mm, depth_mm, size_mm, pipe_radius_mm, noise_mm};
  auto round = SolverOf<RoundDent>(seen);
  if (!round.Fit(kDentFit.least_points)) return {};
  FitOfShape best = ResultOf(round);
  // The wall of a hole is no ellipse either.
  if (best.is_unlike && !best.dent.is_step) {
    auto flat = SolverOf<FlatDent>(seen);
    if (flat.Fit(kDentFit.least_points)) {
      FitOfShape other = ResultOf(flat);
      if (other.chi_square < best.chi_square - kDentFit.flat) best = std::move(other);
    }
  }
  best.dent.is_fitted = IsDent(best, seen);
  return best.dent;
}

bool IsShown(std::span<const WallPoint> points, double reach_mm, double depth_mm, double size_mm,
             double pipe_radius_mm, double noise_mm) {
  if (!(noise_mm > 0)) return true;
  auto held = SolverOf<RoundDent>({points, reach_mm, depth_mm, size_mm, pipe_radius_mm, noise_mm});
  if (CountDeep(held.points(), kDentFit.denied * depth_mm) < kDentFit.least_deep) return false;
  held.Hold();
  if (!held.Fit(kDentFit.least_held)) return false;
  const FittedDent dent = DentNumbers(held).Dent();
  const double unsure_mm = kDentFit.denied_sigmas * dent.depth_sigma_mm;
  const Inside inside = CountInside(held, kDentFit.whole_of_cells * depth_mm);
  return dent.depth_mm > unsure_mm && dent.depth_mm + unsure_mm > kDentFit.denied * depth_mm &&
         inside.MostAreNot(inside.below);
}

}  // namespace bendloop::pipeline
