// SPDX-License-Identifier: Apache-2.0
#include "pipeline/structure.h"

#include <utility>

#include "pipeline/arc_line_spline.h"
#include "pipeline/initial_spline.h"
#include "pipeline/structure_search.h"
#include "pipeline/usual_bend_radius.h"

namespace bendloop::pipeline {
namespace {

// The way to about the right bends needs no more samples.
constexpr std::size_t kEnoughSamples = 8000;
// The live view has milliseconds: one tolerance, few samples, no comparisons.
constexpr double kGlanceTolerance = 0.1;
constexpr std::size_t kGlanceSamples = 2000;
constexpr int kGlanceSteps = 15;

}  // namespace

SurfaceFit GlanceAtStructure(const SpinePolygon& polygon, double pipe_radius_mm,
                             std::span<const PointBlock> samples) {
  const ArcLineSpline spline = InitialSpline(polygon, kGlanceTolerance * pipe_radius_mm);
  return StructureSearch(polygon, pipe_radius_mm, samples, kGlanceSamples,
                         {.max_fit_steps = kGlanceSteps})
      .Fit(TubeFromSpline(spline, pipe_radius_mm));
}

SurfaceFit FindStructure(const SpinePolygon& polygon, double pipe_radius_mm,
                         std::span<const PointBlock> samples,
                         std::span<const PointBlock> all_points, double caution) {
  const bool few = CountPoints(all_points) <= kEnoughSamples;
  StructureSearch coarse(polygon, pipe_radius_mm, few ? all_points : samples, kEnoughSamples,
                         {.caution = caution});
  SurfaceFit fit = coarse.Start();
  coarse.Split(fit);
  coarse.Refine(fit);
  const auto search = [&](const SearchOptions& options) {
    return StructureSearch(polygon, pipe_radius_mm, all_points, kPointsAtOnce, options);
  };
  // Small bends are seen in more points than the way there needed.
  if (!few) {
    StructureSearch fine = search({.caution = caution});
    fit = fine.Fit(fit.tube);
    fine.Refine(fit);
  }
  FitPriors priors;
  if (const auto usual = FindUsualBendRadius(fit)) {
    priors.bend_radius = usual;
    StructureSearch one_die = search({.priors = priors, .caution = caution});
    SurfaceFit of_one_die = one_die.Fit(WithUsualRadii(fit, *usual));
    one_die.Refine(of_one_die);
    if (one_die.criterion().IsBetter(of_one_die, fit)) {
      fit = std::move(of_one_die);
    } else {
      priors = {};
    }
  }
  // Round bends that follow each other may have been put in the place of oval ones.
  StructureSearch oval = search({.flattened = true, .priors = priors, .caution = caution});
  SurfaceFit flattened = oval.Fit(fit.tube);
  if (!oval.criterion().IsFlattened(fit, flattened)) return fit;
  oval.Refine(flattened);
  return oval.criterion().IsFlattened(fit, flattened) ? flattened : fit;
}

}  // namespace bendloop::pipeline
