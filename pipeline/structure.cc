// SPDX-License-Identifier: Apache-2.0
#include "pipeline/structure.h"

#include <utility>

#include "pipeline/arc_line_spline.h"
#include "pipeline/initial_spline.h"
#include "pipeline/structure_search.h"
#include "pipeline/usual_bend_radius.h"

namespace bendloop::pipeline {
namespace {

// The number of bends does not need every sample; the comparison sees at most about so many.
constexpr std::size_t kEnoughSamples = 8000;
constexpr std::size_t kAllSamples = kPointsAtOnce;
// The live view has milliseconds: one tolerance, few samples, no comparisons.
constexpr double kGlanceTolerance = 0.1;
constexpr std::size_t kGlanceSamples = 2000;
constexpr int kGlanceSteps = 15;

}  // namespace

SurfaceFit GlanceAtStructure(const SpinePolygon& polygon, double pipe_radius_mm,
                             std::span<const PointBlock> blocks) {
  const ArcLineSpline spline = InitialSpline(polygon, kGlanceTolerance * pipe_radius_mm);
  return StructureSearch(polygon, pipe_radius_mm, blocks, kGlanceSamples,
                         {.max_fit_steps = kGlanceSteps})
      .Fit(TubeFromSpline(spline, pipe_radius_mm));
}

SurfaceFit FindStructure(const SpinePolygon& polygon, double pipe_radius_mm,
                         std::span<const PointBlock> blocks, double caution) {
  const auto search = [&](std::size_t enough, const SearchOptions& options) {
    return StructureSearch(polygon, pipe_radius_mm, blocks, enough, options);
  };
  StructureSearch coarse = search(kEnoughSamples, {.caution = caution});
  SurfaceFit fit = coarse.Start();
  coarse.Split(fit);
  coarse.Refine(fit);
  // Small bends are seen in more samples than the way there needed.
  const std::size_t enough = CountPoints(blocks) <= kEnoughSamples ? kEnoughSamples : kAllSamples;
  if (enough == kAllSamples) {
    StructureSearch fine = search(enough, {.caution = caution});
    fit = fine.Fit(fit.tube);
    fine.Refine(fit);
  }
  FitPriors priors;
  if (const auto usual = FindUsualBendRadius(fit)) {
    priors.bend_radius = usual;
    StructureSearch one_die = search(enough, {.priors = priors, .caution = caution});
    SurfaceFit of_one_die = one_die.Fit(WithUsualRadii(fit, *usual));
    one_die.Refine(of_one_die);
    if (one_die.criterion().IsBetter(of_one_die, fit)) {
      fit = std::move(of_one_die);
    } else {
      priors = {};
    }
  }
  // Round bends that follow each other may have been put in the place of oval ones.
  StructureSearch oval = search(enough, {.flattened = true, .priors = priors, .caution = caution});
  SurfaceFit flattened = oval.Fit(fit.tube);
  if (!oval.criterion().IsFlattened(fit, flattened)) return fit;
  oval.Refine(flattened);
  return oval.criterion().IsFlattened(fit, flattened) ? flattened : fit;
}

}  // namespace bendloop::pipeline
