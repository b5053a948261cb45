// SPDX-License-Identifier: Apache-2.0
#include "pipeline/structure.h"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>

#include "pipeline/arc_line_spline.h"
#include "pipeline/initial_spline.h"
#include "pipeline/statistics.h"
#include "pipeline/structure_moves.h"
#include "pipeline/structure_score.h"
#include "pipeline/surface_sums.h"
#include "pipeline/usual_bend_radius.h"

namespace bendloop::pipeline {
namespace {

// Tolerances of the simplification, in pipe radii.
constexpr std::array<double, 3> kTolerances = {0.04, 0.08, 0.16};
constexpr double kReach = 0.35;  // of r_P: how far a sample may be from a wrong model
// The price of a parameter is this many times the criterion's log(n) variances: systematic errors
// reach further than the blocks in which they are estimated.
constexpr double kPrice = 1.2;
// Two straights joined by less than this are one, unless the samples insist.
constexpr double kSlightDeg = 1.0;
constexpr double kSlightPrice = 8;  // in parameters, above those of the bend
constexpr double kLongest = 1.1;    // straight, of the polygon's length
constexpr double kTruncated = 6.0;  // sigma
constexpr double kInsist = 6.0;     // sigma, for flattened bends
constexpr double kDropAngleDeg = 3.0;
constexpr double kSuspicious = 1.5;  // mean square of an arc's distances over the median segment's
constexpr std::size_t kMaxSplits = 4;
constexpr std::size_t kMaxAdded = 16;    // bends
constexpr int kMaxCycles = 3;            // of adding and simplifying
constexpr double kAsk = 20.0;            // gain, in variances, at which one more bend is tried
constexpr int kMaxTries = 4;             // places
constexpr double kDoubtfulBorder = 8.0;  // of r_P: up to here a bend near the border is doubted
// The number of bends does not need every sample; the comparison sees at most about so many.
constexpr std::size_t kEnoughSamples = 8000;
constexpr std::size_t kAllSamples = kPointsAtOnce;
// The live view has milliseconds: one tolerance, few samples, no comparisons.
constexpr double kGlanceTolerance = 0.1;
constexpr std::size_t kGlanceSamples = 2000;
constexpr int kGlanceSteps = 15;
constexpr std::size_t kScouts = 2000;  // samples
constexpr double kLost = 0.6;          // of the samples that the other reaches
constexpr double kHopeless = 2.0;      // times the rival's cost
constexpr double kNoGoal = std::numeric_limits<double>::infinity();
constexpr double kSlack = 100;  // variances, by which criteria that are not quite the same differ
constexpr int kSteps = 60;
constexpr double kTolerance = 2e-5;  // of chi square, far below the price of a parameter

struct SearchOptions {
  bool flattened = false;
  FitPriors priors = {};
  double caution = 1;  // times the price of a parameter
  int steps = kSteps;  // of a fit
};

class Search {
 public:
  Search(const SpinePolygon& polygon, double pipe_radius_mm, std::span<const PointBlock> blocks,
         std::size_t enough_samples, const SearchOptions& options)
      : radius_mm_(pipe_radius_mm),
        options_(options),
        longest_mm_(kLongest * LengthOf(polygon)),
        polygon_(&polygon),
        blocks_(Thinned(blocks, CountPoints(blocks) / enough_samples + 1)),
        samples_(blocks_.point_count()),
        scouts_(Thinned(blocks_, samples_ / kScouts + 1)) {}

  SurfaceFit Glance(const SpinePolygon& polygon) const {
    return Fit(TubeFromSpline(InitialSpline(polygon, kGlanceTolerance * radius_mm_), radius_mm_));
  }

  SurfaceFit Run(const SpinePolygon& polygon) {
    std::optional<SurfaceFit> best;
    std::size_t last_bends = static_cast<std::size_t>(-1);
    for (const double tolerance : kTolerances) {
      const hal::Tube tube =
          TubeFromSpline(InitialSpline(polygon, tolerance * radius_mm_), radius_mm_);
      if (best && tube.program.bend_count() == last_bends) continue;
      last_bends = tube.program.bend_count();
      SurfaceFit fit = Fit(tube);
      if (!best || IsBetter(fit, *best)) best = std::move(fit);
    }
    // Adding first: what was one by mistake is found before what is two by mistake is joined.
    for (std::size_t i = 0; i < kMaxSplits && Split(*best); ++i) {
    }
    Refine(*best);
    return *best;
  }

  // Adds what the samples ask for and takes away what they do not mind to lose.
  void Refine(SurfaceFit& best) {
    for (int cycle = 0; cycle < kMaxCycles; ++cycle) {
      bool added = false;
      for (std::size_t i = 0; i < kMaxAdded && Added(best); ++i) added = true;
      if (cycle > 0 && !added) break;
      while (Simplified(best)) {
      }
    }
    best.margin = margin_;
  }

  // The same tube with the samples, and the shape of the bends, of this search.
  SurfaceFit Again(const hal::Tube& tube) const { return Fit(tube); }

  // Whether the samples insist that the bends are not round. Out of nothing but noise the gain is
  // chi-squared with the flattening's number of parameters.
  bool IsFlattened(const SurfaceFit& round, const SurfaceFit& flattened) const {
    const auto bends = static_cast<double>(flattened.tube.program.bend_count());
    const double freedom = kFlatteningParameters * bends;
    const double price = std::max(0.0, PriceOf(flattened) - PriceOf(round));
    const double limit_mm = kTruncated * flattened.sigma_mm;
    return Cost(round, limit_mm) - Cost(flattened, limit_mm) >
           Variance(flattened) * (price + freedom + kInsist * std::sqrt(2.0 * freedom));
  }

  // Bayesian information criterion, the variance taken from the better fit of the two. Every sample
  // costs at most kTruncated sigma: what neither model explains must not decide between them.
  bool IsBetter(const SurfaceFit& a, const SurfaceFit& b) const { return Advantage(a, b) > 0; }

  double Advantage(const SurfaceFit& a, const SurfaceFit& b) const {
    // One that lost the tube has next to no distances, and a small sigma of these.
    const auto reached_a = static_cast<double>(a.distances_mm.size());
    const auto reached_b = static_cast<double>(b.distances_mm.size());
    if (reached_a < kLost * reached_b) return -kNoGoal;
    if (reached_b < kLost * reached_a) return kNoGoal;
    const double variance = std::min(Variance(a), Variance(b));
    const double limit_mm = kTruncated * std::min(a.sigma_mm, b.sigma_mm);
    const auto criterion = [&](const SurfaceFit& fit) {
      return Cost(fit, limit_mm) / variance + PriceOf(fit) +
             fit.priors.ChiSquare(fit.tube.program, fit.flattening);
    };
    return criterion(b) - criterion(a);
  }

  static double Variance(const SurfaceFit& fit) {
    return fit.sigma_mm * fit.sigma_mm * fit.design_effect;
  }

 private:
  SurfaceFit Fit(const hal::Tube& tube) const { return FitWith(tube, blocks_, kNoGoal); }

  // A fit that is better than another one; none: it is not. Of fewer bends a part of the samples
  // says first whether all of them are worth asking, and about where the fit is.
  std::optional<SurfaceFit> Better(const ArcLineSpline& spline, const SurfaceFit& rival) {
    hal::Tube tube = TubeFromSpline(spline, rival.tube.pipe_radius_mm);
    if (tube.program.bend_count() < rival.tube.program.bend_count()) {
      const double part =
          static_cast<double>(scouts_.point_count()) / static_cast<double>(samples_);
      const double hopeless_mm2 = kHopeless * part * rival.cost_mm2;
      const SurfaceFit scouted = FitWith(tube, scouts_, hopeless_mm2);
      if (scouted.cost_mm2 > hopeless_mm2) {
        Note((scouted.cost_mm2 / part - rival.cost_mm2) / Variance(rival));
        return std::nullopt;
      }
      tube = scouted.tube;
    }
    const double fewer = static_cast<double>(rival.tube.program.bend_count()) -
                         static_cast<double>(tube.program.bend_count());
    const double goal_mm2 =
        rival.cost_mm2 + (4.0 * std::max(0.0, fewer) * Price() + kSlack) * Variance(rival);
    SurfaceFit fit = FitWith(tube, blocks_, goal_mm2);
    const double worse = Advantage(rival, fit);
    if (worse < 0) return fit;
    Note(worse);
    return std::nullopt;
  }

  // Splines that were changed boldly may begin and end far outside the scan.
  hal::Tube NoLonger(hal::Tube tube) const {
    for (hal::BendRow& row : tube.program.rows) {
      row.length_mm = std::min(row.length_mm, longest_mm_);
    }
    return tube;
  }

  void Note(double worse) { margin_ = std::min(margin_, worse); }

  SurfaceFit FitWith(const hal::Tube& tube, std::span<const PointBlock> blocks,
                     double goal_mm2) const {
    const SurfaceFitOptions options{.reach_mm = kReach * radius_mm_,
                                    .max_length_mm = longest_mm_,
                                    .flattened = options_.flattened,
                                    .priors = options_.priors,
                                    .max_steps = options_.steps,
                                    .tolerance = kTolerance,
                                    .goal_mm2 = goal_mm2};
    SurfaceFit fit = FitSurface(NoLonger(tube), blocks, options);
    for (std::size_t i = 0; i < tube.program.bend_count(); ++i) {
      ArcLineSpline spline = SplineFromTube(fit.tube);
      if (!DropUnseen(spline, fit) && !TrimBorders(spline, radius_mm_)) break;
      fit = FitSurface(NoLonger(TubeFromSpline(spline, fit.tube.pipe_radius_mm)), blocks, options);
    }
    return fit;
  }

  // Of a parameter, in variances.
  double Price() const {
    return options_.caution * kPrice * std::log(static_cast<double>(samples_));
  }

  // Of all parameters. One that is known before costs as much as the points know it
  // better.
  double PriceOf(const SurfaceFit& fit) const {
    const double full = Price();
    double price = full * fit.parameters;
    for (std::size_t i = 0; i < fit.tube.program.bend_count(); ++i) {
      const hal::BendRow& row = fit.tube.program.rows[i];
      if (row.angle_deg < kSlightDeg) price += kSlightPrice * full;
      const auto& usual = fit.priors.bend_radius;
      if (!usual || RobustWeight(*row.bend_radius_mm - usual->mean_mm, usual->sigma_mm) < 0.5) {
        continue;
      }
      const double better = usual->sigma_mm / fit.sigma.rows[i].bend_radius_mm.value_or(0.0);
      price += std::clamp(2.0 * kPrice * std::log(better), 0.0, full) - full;
    }
    return price;
  }

  static double Cost(const SurfaceFit& fit, double limit_mm) {
    double cost = static_cast<double>(fit.points - fit.distances_mm.size()) * limit_mm * limit_mm;
    for (const double d : fit.distances_mm) cost += std::min(d * d, limit_mm * limit_mm);
    return cost;
  }

  // Splits the arc that explains its samples worst, if two arcs do so better. False: none does.
  bool Split(SurfaceFit& fit) {
    const ArcLineSpline spline = SplineFromTube(fit.tube);
    const double suspicious = kSuspicious * Median(fit.segment_mean_square_mm2);
    std::vector<std::pair<double, std::size_t>> worst;
    for (std::size_t i = 0; i < spline.arcs.size(); ++i) {
      const double mean_square = fit.segment_mean_square_mm2[2 * i + 1];
      if (mean_square > suspicious) worst.emplace_back(-mean_square, i);
    }
    std::sort(worst.begin(), worst.end());
    for (const auto& [mean_square, i] : worst) {
      ArcLineSpline finer = spline;
      const auto arcs = SplitArc(spline.arcs[i]);
      finer.arcs[i] = arcs[0];
      finer.arcs.insert(finer.arcs.begin() + static_cast<std::ptrdiff_t>(i) + 1, arcs[1]);
      if (auto better = Better(finer, fit)) {
        fit = std::move(*better);
        return true;
      }
    }
    return false;
  }

  // One bend more where the samples ask for it most. False: they are content.
  bool Added(SurfaceFit& fit) {
    margin_ = kNoGoal;
    const ArcLineSpline spline = SplineFromTube(fit.tube);
    int tries = 0;
    for (const MissingBend& missing : FindMissingBends(fit, blocks_, kReach * radius_mm_)) {
      if (missing.gain < kAsk) Note(4.0 * Price() - missing.gain);
      if (missing.gain < kAsk || ++tries > kMaxTries) return false;
      for (const ArcLineSpline& with : WithBend(spline, fit.tube, missing, *polygon_)) {
        if (auto better = Better(with, fit)) {
          fit = std::move(*better);
          return true;
        }
      }
    }
    return false;
  }

  // One step: the cheapest merge or drop that is no worse. False: none is.
  bool Simplified(SurfaceFit& fit) {
    const ArcLineSpline spline = SplineFromTube(fit.tube);
    std::optional<SurfaceFit> best;
    const auto consider = [&](const ArcLineSpline& simpler) {
      auto better = Better(simpler, fit);
      if (better && (!best || IsBetter(*better, *best))) best = std::move(better);
    };
    for (std::size_t i = 0; i < spline.arcs.size(); ++i) {
      for (std::size_t j = i + 1; j < std::min(i + 3, spline.arcs.size()); ++j) {
        const auto merged = MergedArc(spline.arcs[i], spline.arcs[j]);
        if (!merged) continue;
        ArcLineSpline simpler = spline;
        simpler.arcs[i] = *merged;
        simpler.arcs.erase(simpler.arcs.begin() + static_cast<std::ptrdiff_t>(i) + 1,
                           simpler.arcs.begin() + static_cast<std::ptrdiff_t>(j) + 1);
        consider(simpler);
      }
      // Bends that undo each other, as nodes disturbed by a clamp pretend them.
      for (std::size_t j = i; j < std::min(i + 4, spline.arcs.size()); ++j) {
        const double turn = std::acos(
            std::clamp(spline.arcs[i].tangent_in.dot(spline.arcs[j].tangent_out), -1.0, 1.0));
        if (turn * 180.0 / std::numbers::pi > kDropAngleDeg) continue;
        ArcLineSpline simpler = spline;
        simpler.arcs.erase(simpler.arcs.begin() + static_cast<std::ptrdiff_t>(i),
                           simpler.arcs.begin() + static_cast<std::ptrdiff_t>(j) + 1);
        consider(simpler);
      }
    }
    // A bend near the border that clutter beside it pretends: the tube that goes straight on.
    const double border_mm = kDoubtfulBorder * radius_mm_;
    ArcLineSpline without = spline;
    if (DropLast(without, border_mm)) consider(without);
    without = spline;
    if (DropFirst(without, border_mm)) consider(without);
    if (!best) return false;
    fit = std::move(*best);
    margin_ = kNoGoal;
    return true;
  }

  double radius_mm_;
  SearchOptions options_;
  double longest_mm_;
  const SpinePolygon* polygon_;
  OwnedBlocks blocks_;
  std::size_t samples_;
  OwnedBlocks scouts_;
  double margin_ = kNoGoal;
};

}  // namespace

SurfaceFit GlanceAtStructure(const SpinePolygon& polygon, double pipe_radius_mm,
                             std::span<const PointBlock> blocks) {
  return Search(polygon, pipe_radius_mm, blocks, kGlanceSamples, {.steps = kGlanceSteps})
      .Glance(polygon);
}

SurfaceFit FindStructure(const SpinePolygon& polygon, double pipe_radius_mm,
                         std::span<const PointBlock> blocks, double caution) {
  const SearchOptions any{.caution = caution};
  SurfaceFit fit = Search(polygon, pipe_radius_mm, blocks, kEnoughSamples, any).Run(polygon);
  // Small bends are seen in more samples than the way there needed.
  const std::size_t enough = CountPoints(blocks) <= kEnoughSamples ? kEnoughSamples : kAllSamples;
  if (enough == kAllSamples) {
    Search fine(polygon, pipe_radius_mm, blocks, enough, any);
    fit = fine.Again(fit.tube);
    fine.Refine(fit);
  }
  FitPriors priors;
  if (const auto usual = FindUsualBendRadius(fit)) {
    priors.bend_radius = usual;
    Search one_die(polygon, pipe_radius_mm, blocks, enough, {.priors = priors, .caution = caution});
    SurfaceFit of_one_die = one_die.Again(WithUsualRadii(fit, *usual));
    one_die.Refine(of_one_die);
    if (one_die.IsBetter(of_one_die, fit)) {
      fit = std::move(of_one_die);
    } else {
      priors = {};
    }
  }
  // Round bends that follow each other may have been put in the place of oval ones.
  Search oval(polygon, pipe_radius_mm, blocks, enough,
              {.flattened = true, .priors = priors, .caution = caution});
  SurfaceFit flattened = oval.Again(fit.tube);
  if (!oval.IsFlattened(fit, flattened)) return fit;
  oval.Refine(flattened);
  return oval.IsFlattened(fit, flattened) ? flattened : fit;
}

}  // namespace bendloop::pipeline
