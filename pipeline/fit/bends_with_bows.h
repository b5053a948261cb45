// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <optional>
#include <span>

#include "pipeline/fit/bowed_fit.h"
#include "pipeline/fit/surface_fit.h"
#include "pipeline/fit/surface_points.h"

namespace bendloop::pipeline {

// A tube with its bows, fitted to all points but those of dents.
struct BowedSolution {
  SurfaceFit fit;
  BowedFit bows;
  std::optional<OwnedBlocks> undented;  // none: there are no dents
  hal::Tube straight;  // as if no straight bowed: all of it runs where the points are
};
// `straight`: what FitSurface() makes of these, if it is known.
BowedSolution SolveWithBows(const hal::Tube& start, std::span<const PointBlock> blocks,
                            const SurfaceFitOptions& options,
                            std::optional<SurfaceFit> straight = std::nullopt);

// Whether what another fit found has as many bends, and no bow led it astray: only then the two can
// be asked which of them is the better.
bool IsOfSameBends(const BowedSolution& other, const BowedSolution& solution);

// Whether nothing of it eases, bows or is dented, as the search for bends takes tubes to be.
bool IsOfLinesAndArcs(const BowedSolution& solution);

// How much better the points speak for `a`, of as many bends as `b` [twice the logarithm of the
// odds].
double AdvantageOf(const BowedSolution& a, const BowedSolution& b,
                   std::span<const PointBlock> blocks, double reach_mm);

// The same of these points alone, dents or none.
double AdvantageAt(std::span<const PointBlock> blocks, const BowedSolution& a,
                   const BowedSolution& b, double reach_mm);

// How much better the points, and the numbers of bends and of form, speak for `a` [twice the
// logarithm of the odds].
double EvidenceFor(const BowedSolution& a, const BowedSolution& b,
                   std::span<const PointBlock> blocks, double reach_mm);

// The same, `more` of them beforehand; where `b` has more bends, also of the points beside the
// dents that `a` is without, if those speak more for it.
double EvidenceWithDents(const BowedSolution& a, const BowedSolution& b,
                         std::span<const PointBlock> blocks, double reach_mm, double more = 0);

// What a tube may be as well, `part` of the odds. `chosen` is less sure by as much as that lies
// elsewhere.
struct Doubt {
  SurfaceFit other;
  double part = 0;
};
void DoubtBy(const Doubt& doubt, bool free_pipe_radius, BowedSolution& chosen);

// The same as SolveWithBows() where it is not known whether the bends ease.
BowedSolution SolveAnew(const hal::Tube& start, std::span<const PointBlock> blocks,
                        SurfaceFitOptions options);

// Whether a straight bows by more than benders leave, or bows led astray: a slight bend in it looks
// like that.
bool MayHideBends(const BowedSolution& solution);

// How much better the points but those of the dents of `fewer`, a tube of fewer bends, speak for
// `found` [twice the logarithm of the odds]: below 0 dents explain what its bends do. None: `fewer`
// has no dents, or too many, or bows led one of them astray.
std::optional<double> MoreThanDents(const BowedSolution& found, const BowedSolution& fewer,
                                    std::span<const PointBlock> blocks, double reach_mm);

// Bends are found as if straights were straight, and dents no dents: now and then one stands in for
// those, or a bow of what no bender leaves stands in for a slight bend. Once both are fitted that
// shows: two bends with nothing between them become one, one that no machine makes none, such a bow
// a bend, where the points are explained as well. `nominal_bends`: more or fewer are tried only
// towards it. By how much the next best was worse [twice the logarithm of the odds]; none was
// tried: infinite.
double ReviseBends(std::span<const PointBlock> blocks, const SurfaceFitOptions& options,
                   std::optional<std::size_t> nominal_bends, BowedSolution& solution);

}  // namespace bendloop::pipeline
