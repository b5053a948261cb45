// SPDX-License-Identifier: Apache-2.0
#include "pipeline/structure/round_bends.h"

#include <cstddef>
#include <utility>

#include "pipeline/structure/structure_criterion.h"

namespace bendloop::pipeline {
namespace {

// So many points tell.
constexpr std::size_t kEnoughPoints = 32'000;

}  // namespace

void RoundBendsThatEase(const SurfaceFit& structure, std::span<const PointBlock> blocks,
                        SurfaceFitOptions& options, FoundEasing& found) {
  if (!options.flattened || !found.eased) return;
  SurfaceFitOptions round = options;
  round.flattened = false;
  FoundEasing of_round = FindEasing(structure, blocks, round);
  if (!of_round.eased) return;
  const OwnedBlocks few = Gathered(blocks, StrideTo(CountPoints(blocks), kEnoughPoints));
  const auto fit = [&few](const FoundEasing& of, SurfaceFitOptions with) {
    with.easing = of.easing;
    return FitSurface(*of.eased, few, with);
  };
  const SurfaceFit is_round = fit(of_round, round), is_flattened = fit(found, options);
  if (StructureCriterion(1.0, few.point_count()).IsFlattened(is_round, is_flattened)) return;
  options = std::move(round);
  found = std::move(of_round);
}

}  // namespace bendloop::pipeline
