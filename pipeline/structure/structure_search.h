// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <limits>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "pipeline/fit/surface_fit.h"
#include "pipeline/spine/spine_polygon.h"
#include "pipeline/structure/structure_criterion.h"
#include "pipeline/structure/structure_score.h"
#include "pipeline/structure/structure_window.h"

namespace bendloop::pipeline {

struct SearchOptions {
  bool flattened = false;
  FitPriors priors = {};
  double caution = 1;  // times the usual evidence is asked for a bend
  int max_fit_steps = 60;
  FormDeviation form = {};
  // A machine makes no slighter bend; where samples ask for one a straight is bowed.
  double least_angle_deg = 0.5;
};

// Changes the structure of a tube, bend by bend, as long as the samples are explained better. Every
// change is fitted to the samples near it first, and to all of them if that promises something.
class StructureSearch {
 public:
  // Looks at about `enough` of the samples.
  StructureSearch(const SpinePolygon& polygon, double pipe_radius_mm,
                  std::span<const PointBlock> blocks, std::size_t enough,
                  const SearchOptions& options);

  // From here on what the samples of this fit show of the tube's form, at most what is usual.
  void LearnForm(const SurfaceFit& fit);
  // Judges a fit of this search's samples by the form as it is now.
  void AssumeFormOf(SurfaceFit& fit) const { AssumeForm(options_.form, true, fit); }
  void AssumeUsualForm() { options_.form = {}; }
  const FormDeviation& form() const { return options_.form; }
  const StructureCriterion& criterion() const { return criterion_; }

  SurfaceFit Fit(const hal::Tube& tube) const;
  // Of several initial splines the one whose fit is best.
  SurfaceFit Start() const;
  // Splits arcs that explain their samples much worse than the others.
  void Split(SurfaceFit& best);
  // Adds what the samples ask for and takes away what they do not mind to lose.
  void Refine(SurfaceFit& best);
  // Where samples are still explained much worse than elsewhere, starts again from the nodes.
  void StartAnew(SurfaceFit& best);

 private:
  // A part of the tube as it is, for comparison with what might be there.
  struct Part {
    StructureWindow window;
    ArcLineSpline spline;
    struct Fitted {
      OwnedBlocks samples;
      SurfaceFit fit;
    };
    std::optional<Fitted> few, all;  // to some and to all of its samples, once asked for
  };

  SurfaceFit FitTo(std::span<const PointBlock> blocks, const hal::Tube& tube,
                   double goal_mm2) const;
  SurfaceFit FitWhole(const hal::Tube& tube, double goal_mm2) const;
  Part Around(const ArcLineSpline& spline, StructureWindow window) const;
  const Part::Fitted& Fitted(const SurfaceFit& whole, const Part& part, std::size_t enough,
                             std::optional<Part::Fitted>& fitted);
  // The tube with another spline in this part, if that is better.
  std::optional<SurfaceFit> Better(const SurfaceFit& rival, const ArcLineSpline& whole, Part& part,
                                   const ArcLineSpline& changed);
  // Whether the samples ask for it still where each place counts by what is left there.
  bool IsSeenPlaceByPlace(const SurfaceFit& rival, const SurfaceFit& better) const;
  // The slightest bend that is none: below the least angle, or no more than a bow.
  std::optional<std::size_t> Bow(const SurfaceFit& fit, const FormDeviation& form,
                                 double beyond_deg = 0) const;
  // Whether a fit with a bend more than its rival is better, though maybe only where the form that
  // it leaves is the tube's: then that is what is known of the form.
  bool IsBentMore(const SurfaceFit& rival, SurfaceFit& fit);
  // Straight on in the place of such bends.
  void DropBows(SurfaceFit& fit);
  double GoalOf(const SurfaceFit& rival, const SurfaceFit& like, double fewer_bends) const;
  bool SplitWorst(SurfaceFit& fit);
  bool SplitAt(SurfaceFit& fit, const ArcLineSpline& spline, std::size_t arc);
  bool Added(SurfaceFit& fit);
  bool AddedAt(SurfaceFit& fit, MissingBend missing);
  bool SimplifiedAt(SurfaceFit& fit, std::size_t arc);
  bool StartedAnew(SurfaceFit& fit, StructureWindow window);
  void Accept(SurfaceFit& fit, SurfaceFit better, const StructureWindow& window);
  // Of the structures that are worse.
  struct Rival {
    double worse = std::numeric_limits<double>::infinity();
    std::optional<hal::Tube> tube = {};  // none: it is not known as a whole
  };
  void Note(double worse, std::optional<hal::Tube> tube = std::nullopt) {
    if (worse < closest_.worse) closest_ = {worse, std::move(tube)};
  }

  double radius_mm_;
  SearchOptions options_;
  double longest_mm_;
  const SpinePolygon* polygon_;
  OwnedBlocks blocks_;
  StructureCriterion criterion_;
  std::optional<NearestSegments> nearest_;  // of the tube that is looked at
  // By arc, once tried: the best simpler structure that begins there.
  std::vector<std::optional<Rival>> simpler_;
  Rival closest_;
};

}  // namespace bendloop::pipeline
