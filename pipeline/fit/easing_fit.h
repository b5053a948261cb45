// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <span>

#include "pipeline/fit/surface_fit.h"

namespace bendloop::pipeline {

struct FoundEasing {
  Easing easing;  // of every bend [mm^2], to begin the fit of all points with; none: they are sharp
  // The fit of all points with sharp bends, where they are sharp and it was made on the way.
  std::optional<SurfaceFit> sharp;
  // Where bends are eased, the tube that they are eased in, by a part of the points: to begin
  // there. Easing moves bends inwards by its variance / 2 CLR; from where sharp ones lie a fit may
  // go astray.
  std::optional<hal::Tube> eased;
};

// How much better `a`, of the same points as `b`, explains them and what is expected of such tubes
// [variances].
double GainOf(const SurfaceFit& a, const SurfaceFit& b, const SurfaceFitOptions& options);

// Whether the samples insist on bends that ease in and out, or sharp ones explain them as well.
// `structure`: the tube with its bends; `options`: of the final fit.
FoundEasing FindEasing(const SurfaceFit& structure, std::span<const PointBlock> blocks,
                       SurfaceFitOptions options);

}  // namespace bendloop::pipeline
