// SPDX-License-Identifier: Apache-2.0
#include "pipeline/structure/structure.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "pipeline/fit/surface_sums.h"
#include "pipeline/fit/usual_bend_radius.h"
#include "pipeline/spline/arc_line_spline.h"
#include "pipeline/spline/initial_spline.h"
#include "pipeline/structure/makeable_bends.h"
#include "pipeline/structure/nominal_along.h"
#include "pipeline/structure/structure_moves.h"
#include "pipeline/structure/structure_search.h"

namespace bendloop::pipeline {
namespace {

struct StructureSettings {
  // The way to about the right bends needs no more samples. By trial.
  std::size_t enough_samples = 8000;
  // The live view has milliseconds: one tolerance [of r_P] of the simplification, few samples, few
  // steps of the fit, no comparisons.
  double glance_tolerance = 0.1;
  std::size_t glance_samples = 2000;
  int glance_steps = 15;
  // [of the usual form, FormDeviation] A tube with less is lines and arcs. By trial.
  double true_form = 0.3;
  // Twice the logarithm of the odds (150 to 1) that a part has no bend more than its nominal.
  // Evidence beyond it is a defect; below it Measurement::structure_margin says that it was a close
  // call.
  double nominal_odds = 10;
  // [of the samples] That lie on a tube of which a dent, or what sits on an end, hides no bend: a
  // deep dent has one in fifty, a flare as many. By trial.
  double as_drawn = 0.96;
  double bend_parameters = 4;
};
constexpr StructureSettings kStructure;

// Samples that lie on a fit as those of `found` lie on that.
double LieOn(const SurfaceFit& fit, const SurfaceFit& found) {
  const double limit_mm = kNoWeight * found.sigma_mm;
  return static_cast<double>(
      std::count_if(fit.distances_mm.begin(), fit.distances_mm.end(),
                    [limit_mm](double d_mm) { return std::abs(d_mm) < limit_mm; }));
}

// Whether what was found is the nominal but for bends that no machine has made, and dents or what
// sits on an end explain what they do. `expected`: a fit of the nominal.
bool IsMadeAsDrawn(const hal::BendProgram& nominal, const SurfaceFit& expected,
                   const SurfaceFit& found) {
  const std::size_t bends = expected.tube.program.bend_count();
  return bends < found.tube.program.bend_count() && LeastMadeBends(found) <= bends &&
         LieOn(expected, found) > kStructure.as_drawn * LieOn(found, found) &&
         MayBeByCorners(nominal, expected.tube, expected.sigma);
}

// The nominal's structure, where the samples let it be, instead of one that cannot be the nominal.
SurfaceFit SettleByNominal(const StructureSearch& search, const SpinePolygon& polygon,
                           const hal::BendProgram& nominal, SurfaceFit found) {
  SurfaceFit expected = search.Fit(NominalAlong(nominal, found.tube.pipe_radius_mm, polygon));
  const double advantage = search.criterion().Advantage(expected, found);
  const std::size_t bends = expected.tube.program.bend_count();
  const bool same_bends = bends == found.tube.program.bend_count();
  double favoured = advantage;
  const bool is_as_drawn = IsMadeAsDrawn(nominal, expected, found);
  if (is_as_drawn) {
    favoured = std::numeric_limits<double>::infinity();
  } else if (!same_bends && MayBe(nominal, expected.tube, expected.sigma)) {
    // Its bends need no evidence, it is enough that the samples do not speak against them; for
    // taking a bend away that the nominal does not have the samples must be nearly content.
    favoured = bends > found.tube.program.bend_count()
                   ? std::max(advantage, search.criterion().Gain(expected, found))
                   : advantage + kStructure.nominal_odds;
  }
  if (favoured > 0) {
    // That no machine makes it is worth as much as a bend costs; where samples ask for it louder
    // somebody has to know.
    const double more =
        static_cast<double>(found.tube.program.bend_count()) - static_cast<double>(bends);
    const double unmade = more * kStructure.bend_parameters * search.criterion().price();
    expected.margin = same_bends || (is_as_drawn && advantage > -unmade) ? found.margin
                                                                         : std::max(0.0, advantage);
    expected.rival = same_bends ? std::move(found.rival) : std::move(found.tube);
    return expected;
  }
  if (!same_bends && -advantage < found.margin) {
    found.margin = -advantage;
    found.rival = std::move(expected.tube);
  }
  return found;
}

// Without bends that follow what sits on the tube's ends.
void DropFittings(const StructureSearch& search, SurfaceFit& fit) {
  for (std::size_t i = 0, bends = fit.tube.program.bend_count(); i < bends; ++i) {
    ArcLineSpline spline = SplineFromTube(fit.tube);
    if (!DropUnexplained(spline, fit)) return;
    const double margin = fit.margin;
    fit = search.Fit(TubeFromSpline(spline, fit.tube.pipe_radius_mm));
    fit.margin = margin;
  }
}

// What the samples alone say. `form`: becomes what they show of the tube's form.
SurfaceFit StructureOf(const SpinePolygon& polygon, double pipe_radius_mm,
                       std::span<const PointBlock> samples, std::span<const PointBlock> all_points,
                       double caution, FormDeviation& form) {
  const bool few = CountPoints(all_points) <= kStructure.enough_samples;
  StructureSearch coarse(polygon, pipe_radius_mm, few ? all_points : samples,
                         kStructure.enough_samples, {.caution = caution});
  // First as if the tube were as far from lines and arcs as usual tubes: what is left then tells
  // how far it is. One that hardly is begins anew, with all its slight bends.
  const SurfaceFit start = coarse.Start();
  SurfaceFit fit = start;
  const auto is_true = [&] {
    coarse.LearnForm(fit);
    return coarse.form().across < kStructure.true_form * FormDeviation{}.across;
  };
  // Most often the start shows it already.
  if (!is_true()) {
    coarse.AssumeUsualForm();
    coarse.Refine(fit);
    if (is_true()) fit = start;
  }
  coarse.AssumeFormOf(fit);
  coarse.Split(fit);
  coarse.Refine(fit);
  form = coarse.form();
  const auto search = [&](const SearchOptions& options) {
    return StructureSearch(polygon, pipe_radius_mm, all_points, kPointsAtOnce, options);
  };
  // Small bends are seen in more points than the way there needed.
  if (!few) {
    StructureSearch fine = search({.caution = caution, .form = form});
    fit = fine.Fit(fit.tube);
    fine.LearnForm(fit);
    fine.AssumeFormOf(fit);
    fine.Refine(fit);
    form = fine.form();
  }
  FitPriors priors;
  if (const auto usual = FindUsualBendRadius(fit)) {
    priors.bend_radius = usual;
    StructureSearch one_die = search({.priors = priors, .caution = caution, .form = form});
    SurfaceFit of_one_die = one_die.Fit(WithUsualRadii(fit, *usual));
    one_die.Refine(of_one_die);
    if (one_die.criterion().IsBetter(of_one_die, fit)) {
      fit = std::move(of_one_die);
    } else {
      priors = {};
    }
  }
  // Round bends that follow each other may have been put in the place of oval ones.
  StructureSearch oval =
      search({.flattened = true, .priors = priors, .caution = caution, .form = form});
  SurfaceFit flattened = oval.Fit(fit.tube);
  if (!oval.criterion().IsFlattened(fit, flattened)) return fit;
  oval.Refine(flattened);
  return oval.criterion().IsFlattened(fit, flattened) ? flattened : fit;
}

}  // namespace

SurfaceFit GlanceAtStructure(const SpinePolygon& polygon, double pipe_radius_mm,
                             std::span<const PointBlock> samples) {
  const ArcLineSpline spline = InitialSpline(polygon, kStructure.glance_tolerance * pipe_radius_mm);
  return StructureSearch(polygon, pipe_radius_mm, samples, kStructure.glance_samples,
                         {.max_fit_steps = kStructure.glance_steps})
      .Fit(TubeFromSpline(spline, pipe_radius_mm));
}

SurfaceFit FindStructure(const SpinePolygon& polygon, double pipe_radius_mm,
                         std::span<const PointBlock> samples,
                         std::span<const PointBlock> all_points, const StructureOptions& options) {
  FormDeviation form;
  SurfaceFit fit = StructureOf(polygon, pipe_radius_mm, samples, all_points, options.caution, form);
  StructureSearch search(polygon, pipe_radius_mm, all_points, kPointsAtOnce,
                         {.flattened = !fit.flattening.empty(),
                          .priors = fit.priors,
                          .caution = options.caution,
                          .form = form});
  search.StartAnew(fit);
  if (options.nominal && MayBe(*options.nominal, fit.tube, fit.sigma)) return fit;
  DropFittings(search, fit);
  if (!options.nominal || MayBe(*options.nominal, fit.tube, fit.sigma)) return fit;
  return SettleByNominal(search, polygon, *options.nominal, std::move(fit));
}

}  // namespace bendloop::pipeline
