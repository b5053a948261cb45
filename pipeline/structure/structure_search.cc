// SPDX-License-Identifier: Apache-2.0
#include "pipeline/structure/structure_search.h"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <set>
#include <utility>

#include "hal/spine.h"
#include "pipeline/math/quantiles.h"
#include "pipeline/spline/initial_spline.h"
#include "pipeline/structure/bows.h"
#include "pipeline/structure/explained_parts.h"
#include "pipeline/structure/joined_tube.h"
#include "pipeline/structure/lateral_profile.h"
#include "pipeline/structure/local_gain.h"
#include "pipeline/structure/structure_moves.h"

namespace bendloop::pipeline {
namespace {

constexpr std::size_t kAll = std::numeric_limits<std::size_t>::max();
constexpr double kNoGoal = std::numeric_limits<double>::infinity();

// What the search goes by. A variance is that of a sample: gains and criteria are twice the
// logarithm of odds. Chosen by trial where nothing else is said.
struct SearchSettings {
  // [of r_P] Tolerances of the simplification: to start with, and where the search starts anew.
  std::array<double, 3> tolerances = {0.04, 0.08, 0.16};
  std::array<double, 7> other_tolerances = {0.06, 0.03, 0.1, 0.05, 0.13, 0.2, 0.02};
  int most_anew = 4;
  // [of r_P] How far a sample may be from a wrong model.
  double reach = 0.35;
  // [of the polygon's length] A straight is no longer.
  double longest = 1.1;
  // Of the samples: a bow is within reach of its straight, so a fit without it that reaches fewer
  // went astray, and the bow stays. By trial.
  double without_bow = 0.97;
  // [of r_P] What the end straights see beyond their ends.
  double left_behind = 3.0;
  // Of chi square, where a fit stops: far below the price of a parameter.
  double fit_tolerance = 2e-5;

  // Arcs that become one at most, and bends that undo each other within so many degrees.
  std::size_t most_merged = 5, most_dropped = 4;
  double undone_deg = 3.0;
  // Mean square of an arc's distances, over the median segment's, from which on it is split.
  double suspicious = 1.5;
  std::size_t most_splits = 4;
  // Bends, and turns of adding and simplifying.
  std::size_t most_added = 16;
  int most_cycles = 3;
  // [variances] Gain from which on one more bend is tried, at so many places.
  double worth_trying = 20.0;
  // The same for two in the place of a bend so many times as wide as the median one.
  double worth_splitting = 8.0, wide = 1.5;
  std::size_t most_places = 4;
  // [of r_P] Up to here a bend near the border is doubted.
  double doubtful_border = 8.0;
  // [sigma] A straight known so well is no accident of a wide bend or of one taken for two.
  double settled_sigmas = 300;

  // So many samples find out what is hopeless.
  std::size_t first_samples = 1500;
  // [variances] By which criteria that are not quite the same differ.
  double criteria_differ = 100;
  // [variances] That a part of a tube may gain when it no longer has to meet the rest.
  double unjoined_gain = 30;

  // FormDeviation::across that is learnt at most, and of tubes that are lines and arcs.
  double most_across = 0.025, true_across = 0.002;
  // [of what was learnt before] To look again.
  double less_form = 0.7;
};
constexpr SearchSettings kSearch;

double TurnDeg(const SplineArc& first, const SplineArc& last) {
  return std::acos(std::clamp(first.tangent_in.dot(last.tangent_out), -1.0, 1.0)) * 180.0 /
         std::numbers::pi;
}

// Bends tighter than the pipe made wider, where the straights beside them are long enough for it.
hal::Tube NoTighter(hal::Tube tube) {
  auto& rows = tube.program.rows;
  for (std::size_t i = 0; i + 1 < rows.size(); ++i) {
    double& radius_mm = *rows[i].bend_radius_mm;
    const double tangent = std::tan(0.5 * rows[i].angle_deg * std::numbers::pi / 180.0);
    if (radius_mm >= tube.pipe_radius_mm || !(tangent > 0)) continue;
    const double shorter_mm = std::min(
        {(tube.pipe_radius_mm - radius_mm) * tangent, rows[i].length_mm, rows[i + 1].length_mm});
    rows[i].length_mm -= shorter_mm;
    rows[i + 1].length_mm -= shorter_mm;
    radius_mm += shorter_mm / tangent;
  }
  return tube;
}

bool IsWide(const hal::BendProgram& program, std::size_t bend) {
  std::vector<double> radii_mm;
  for (std::size_t i = 0; i < program.bend_count(); ++i) {
    radii_mm.push_back(*program.rows[i].bend_radius_mm);
  }
  return radii_mm[bend] > kSearch.wide * Median(radii_mm);
}

bool IsSettled(const SurfaceFit& fit, std::size_t row) {
  return fit.tube.program.rows[row].length_mm >
         kSearch.settled_sigmas * fit.sigma.rows[row].length_mm;
}

}  // namespace

StructureSearch::StructureSearch(const SpinePolygon& polygon, double pipe_radius_mm,
                                 std::span<const PointBlock> blocks, std::size_t enough,
                                 const SearchOptions& options)
    : radius_mm_(pipe_radius_mm),
      options_(options),
      longest_mm_(kSearch.longest * LengthOf(polygon)),
      polygon_(&polygon),
      blocks_(Gathered(blocks, StrideTo(CountPoints(blocks), enough))),
      criterion_(blocks_.point_count(), options.caution) {}

void StructureSearch::LearnForm(const SurfaceFit& fit) {
  options_.form = EstimateForm(fit, blocks_, kSearch.reach * radius_mm_,
                               FormDeviation{.across = kSearch.most_across});
}

SurfaceFit StructureSearch::Fit(const hal::Tube& tube) const { return FitWhole(tube, kNoGoal); }

SurfaceFit StructureSearch::Start() const {
  std::optional<SurfaceFit> best;
  std::size_t last_bends = kAll;
  for (const double tolerance : kSearch.tolerances) {
    const hal::Tube tube =
        TubeFromSpline(InitialSpline(*polygon_, tolerance * radius_mm_), radius_mm_);
    if (best && tube.program.bend_count() == last_bends) continue;
    last_bends = tube.program.bend_count();
    SurfaceFit fit = Fit(tube);
    if (!best || criterion_.IsBetter(fit, *best)) best = std::move(fit);
  }
  return *best;
}

void StructureSearch::Split(SurfaceFit& best) {
  nearest_.reset();
  for (std::size_t i = 0; i < kSearch.most_splits && SplitWorst(best); ++i) {
  }
}

bool StructureSearch::IsSeenPlaceByPlace(const SurfaceFit& rival, const SurfaceFit& better) const {
  const double gain = LocalGain(better, rival, blocks_, StructureCriterion::Variance(better),
                                StructureCriterion::LimitMm(better));
  return gain + criterion_.Advantage(better, rival) - criterion_.Gain(better, rival) > 0;
}

bool StructureSearch::IsBentMore(const SurfaceFit& rival, SurfaceFit& fit) {
  const double advantage = criterion_.Advantage(fit, rival);
  const auto holds = [&](const FormDeviation& form) {
    return IsSeenPlaceByPlace(rival, fit) && !Bow(fit, form);
  };
  if (advantage > 0) return holds(options_.form);
  const FormDeviation own = EstimateForm(fit, blocks_, kSearch.reach * radius_mm_, options_.form);
  if (own.across > std::min(kSearch.true_across, kSearch.less_form * options_.form.across))
    return false;
  const double before_mm2 = fit.variance_mm2;
  SetForm(own, fit);
  const double more = static_cast<double>(fit.tube.program.bend_count()) -
                      static_cast<double>(rival.tube.program.bend_count());
  // A bend has four parameters.
  const double learnt_more = 4.0 * more * std::log(before_mm2 / fit.variance_mm2);
  if (criterion_.Advantage(fit, rival) > learnt_more && holds(own)) {
    options_.form = own;
    return true;
  }
  SetForm(options_.form, fit);
  return false;
}

std::optional<std::size_t> StructureSearch::Bow(const SurfaceFit& fit, const FormDeviation& form,
                                                double beyond_deg) const {
  return FindBow(fit, blocks_, kSearch.reach * radius_mm_, form, options_.least_angle_deg,
                 beyond_deg);
}

void StructureSearch::DropBows(SurfaceFit& fit) {
  double beyond_deg = 0;
  while (const auto bow = Bow(fit, options_.form, beyond_deg)) {
    const ArcLineSpline without = WithoutArcs(SplineFromTube(fit.tube), *bow, *bow);
    SurfaceFit straight = Fit(TubeFromSpline(without, fit.tube.pipe_radius_mm));
    const auto reached = static_cast<double>(fit.distances_mm.size());
    if (static_cast<double>(straight.distances_mm.size()) < kSearch.without_bow * reached) {
      beyond_deg = fit.tube.program.rows[*bow].angle_deg;
      continue;
    }
    fit = std::move(straight);
    beyond_deg = 0;
  }
}

void StructureSearch::Refine(SurfaceFit& best) {
  nearest_.reset();
  DropBows(best);
  simpler_.assign(best.tube.program.bend_count(), std::nullopt);
  for (int cycle = 0; cycle < kSearch.most_cycles; ++cycle) {
    // Adding first: what was one by mistake is found before what is two by mistake is joined.
    bool added = false;
    for (std::size_t i = 0; i < kSearch.most_added && Added(best); ++i) added = true;
    if (cycle > 0 && !added) break;
    bool simplified = false;
    for (std::size_t arc = 0; arc < best.tube.program.bend_count();) {
      const bool simpler = SimplifiedAt(best, arc);
      simplified |= simpler;
      arc = simpler ? 0 : arc + 1;
    }
    if (!simplified) break;
  }
  DropBows(best);
  Rival closest = closest_;
  for (const auto& simpler : simpler_) {
    if (simpler && simpler->worse < closest.worse) closest = *simpler;
  }
  best.margin = closest.worse;
  best.rival = std::move(closest.tube);
}

void StructureSearch::StartAnew(SurfaceFit& best) {
  for (int i = 0; i < kSearch.most_anew; ++i) {
    bool started = false;
    for (const StructureWindow& window :
         BadlyExplainedParts(best, blocks_, kSearch.reach * radius_mm_)) {
      if ((started = StartedAnew(best, window))) break;
    }
    if (!started) return;
    Refine(best);
  }
}

bool StructureSearch::StartedAnew(SurfaceFit& fit, StructureWindow window) {
  nearest_.reset();
  const ArcLineSpline spline = SplineFromTube(fit.tube);
  Part part = Around(spline, window);
  const SpinePolygon nodes = NodesAlong(*polygon_, fit.tube, part.window);
  if (nodes.size() < 3) return false;
  for (const double tolerance : kSearch.other_tolerances) {
    const ArcLineSpline other = InitialSpline(nodes, tolerance * radius_mm_);
    auto better = Better(fit, spline, part, other);
    if (better && criterion_.Advantage(*better, fit) > kSearch.worth_trying) {
      Accept(fit, std::move(*better), part.window);
      return true;
    }
  }
  return false;
}

SurfaceFit StructureSearch::FitTo(std::span<const PointBlock> blocks, const hal::Tube& tube,
                                  double goal_mm2) const {
  hal::Tube start = NoTighter(tube);
  // Splines that were changed boldly may begin and end far outside the scan.
  for (hal::BendRow& row : start.program.rows) row.length_mm = std::min(row.length_mm, longest_mm_);
  return FitSurface(start, blocks,
                    {.reach_mm = kSearch.reach * radius_mm_,
                     .max_length_mm = longest_mm_,
                     .flattened = options_.flattened,
                     .priors = options_.priors,
                     .form = options_.form,
                     .max_steps = options_.max_fit_steps,
                     .tolerance = kSearch.fit_tolerance,
                     .goal_mm2 = goal_mm2});
}

SurfaceFit StructureSearch::FitWhole(const hal::Tube& tube, double goal_mm2) const {
  SurfaceFit fit = FitTo(blocks_, tube, goal_mm2);
  // A fit may slide along the tube and leave its end behind, where samples then ask for nothing.
  ArcLineSpline spline = SplineFromTube(fit.tube);
  if (ReachEnds(spline, *polygon_, kSearch.left_behind * radius_mm_)) {
    fit = FitTo(blocks_, TubeFromSpline(spline, fit.tube.pipe_radius_mm), goal_mm2);
  }
  for (std::size_t i = 0; i < tube.program.bend_count(); ++i) {
    spline = SplineFromTube(fit.tube);
    if (!DropUnseen(spline, fit) && !TrimBorders(spline, radius_mm_)) break;
    fit = FitTo(blocks_, TubeFromSpline(spline, fit.tube.pipe_radius_mm), goal_mm2);
  }
  return fit;
}

StructureSearch::Part StructureSearch::Around(const ArcLineSpline& spline,
                                              StructureWindow window) const {
  window = Widened(window, spline, radius_mm_);
  return {window, PartOf(spline, window), std::nullopt, std::nullopt};
}

const StructureSearch::Part::Fitted& StructureSearch::Fitted(const SurfaceFit& whole,
                                                             const Part& part, std::size_t enough,
                                                             std::optional<Part::Fitted>& fitted) {
  if (!nearest_) nearest_.emplace(whole.tube, blocks_);
  if (!fitted) {
    fitted.emplace(Part::Fitted{nearest_->Of(part.window, enough), {}});
    const hal::Tube tube = TubeFromSpline(part.spline, whole.tube.pipe_radius_mm);
    fitted->fit = FitTo(fitted->samples, tube, kNoGoal);
  }
  return *fitted;
}

double StructureSearch::GoalOf(const SurfaceFit& rival, const SurfaceFit& like,
                               double fewer_bends) const {
  return rival.cost_mm2 +
         (4.0 * std::max(0.0, fewer_bends) * criterion_.price() + kSearch.criteria_differ) *
             StructureCriterion::Variance(like);
}

std::optional<SurfaceFit> StructureSearch::Better(const SurfaceFit& rival,
                                                  const ArcLineSpline& whole, Part& part,
                                                  const ArcLineSpline& changed) {
  const double fewer =
      static_cast<double>(part.spline.arcs.size()) - static_cast<double>(changed.arcs.size());
  hal::Tube tube = TubeFromSpline(changed, rival.tube.pipe_radius_mm);
  const auto is_hopeless = [&](const Part::Fitted& as_it_is) {
    const SurfaceFit fit = FitTo(as_it_is.samples, tube, GoalOf(as_it_is.fit, rival, fewer));
    const double worse = criterion_.Advantage(as_it_is.fit, fit);
    tube = fit.tube;
    if (worse > kSearch.unjoined_gain) Note(worse);
    return worse > kSearch.unjoined_gain;
  };
  // What few samples say against fewer bends, more say louder.
  if (fewer > 0 && is_hopeless(Fitted(rival, part, kSearch.first_samples, part.few)))
    return std::nullopt;
  if (is_hopeless(Fitted(rival, part, kAll, part.all))) return std::nullopt;
  const ArcLineSpline spline = WithPart(whole, part.window, SplineFromTube(tube));
  SurfaceFit fit =
      FitWhole(JoinedTube(spline, rival.tube.pipe_radius_mm), GoalOf(rival, rival, fewer));
  const double worse = criterion_.Advantage(rival, fit);
  if (fit.tube.program.bend_count() > rival.tube.program.bend_count()) {
    if (IsBentMore(rival, fit)) return fit;
    if (worse < 0) return std::nullopt;
  } else if (worse < 0) {
    return fit;
  }
  // A bend that was dropped again as unseen makes no other structure.
  const bool is_other = part.spline.arcs.size() == changed.arcs.size() ||
                        fit.tube.program.bend_count() != rival.tube.program.bend_count();
  if (is_other) Note(worse, std::move(fit.tube));
  return std::nullopt;
}

void StructureSearch::Accept(SurfaceFit& fit, SurfaceFit better, const StructureWindow& window) {
  const std::size_t before = fit.tube.program.bend_count();
  const std::size_t after = better.tube.program.bend_count();
  fit = std::move(better);
  nearest_.reset();
  closest_ = {};
  if (simpler_.size() != before) return;
  std::vector<std::optional<Rival>> simpler(after);
  for (std::size_t i = 0; i < std::min(window.first, after); ++i) simpler[i] = simpler_[i];
  for (std::size_t i = window.last; i < before; ++i) {
    if (i + after >= before) simpler[i + after - before] = simpler_[i];
  }
  // What begins before may reach into it.
  for (std::size_t i = window.first - std::min(window.first, kSearch.most_merged);
       i < std::min(after, window.last + 1); ++i) {
    simpler[i] = std::nullopt;
  }
  simpler_ = std::move(simpler);
}

// Splits the arc that explains its samples worst, if two arcs do so better. False: none does.
bool StructureSearch::SplitWorst(SurfaceFit& fit) {
  const ArcLineSpline spline = SplineFromTube(fit.tube);
  const double suspicious = kSearch.suspicious * Median(fit.segment_mean_square_mm2);
  std::vector<std::pair<double, std::size_t>> worst;
  for (std::size_t i = 0; i < spline.arcs.size(); ++i) {
    const double mean_square = fit.segment_mean_square_mm2[2 * i + 1];
    if (mean_square > suspicious) worst.emplace_back(-mean_square, i);
  }
  std::sort(worst.begin(), worst.end());
  for (const auto& [mean_square, i] : worst) {
    if (SplitAt(fit, spline, i)) return true;
  }
  return false;
}

// False: one arc does as well.
bool StructureSearch::SplitAt(SurfaceFit& fit, const ArcLineSpline& spline, std::size_t arc) {
  Part part = Around(spline, {arc, arc + 1});
  ArcLineSpline finer = part.spline;
  const std::size_t at = arc - part.window.first;
  const auto arcs = SplitArc(finer.arcs[at]);
  finer.arcs[at] = arcs[0];
  finer.arcs.insert(finer.arcs.begin() + static_cast<std::ptrdiff_t>(at) + 1, arcs[1]);
  auto better = Better(fit, spline, part, finer);
  if (!better) return false;
  Accept(fit, std::move(*better), part.window);
  return true;
}

// One bend more where the samples ask for it most. False: they are content.
bool StructureSearch::Added(SurfaceFit& fit) {
  closest_ = {};
  const std::vector<MissingBend> places =
      FindMissingBends(fit, blocks_, kSearch.reach * radius_mm_);
  for (const MissingBend& missing : places) {
    if (missing.gain >= kSearch.worth_trying) continue;
    Note(4.0 * criterion_.price() - missing.gain);
    break;
  }
  for (std::size_t i = 0; i < std::min(places.size(), kSearch.most_places); ++i) {
    if (places[i].gain < kSearch.worth_trying) break;
    if (AddedAt(fit, places[i])) return true;
  }
  // Two that one of a wider radius stands in for have other places and planes than it: how little
  // it would have to turn says next to nothing of what they gain.
  std::set<std::size_t> tried;
  for (const MissingBend& missing : places) {
    const std::size_t bend = missing.segment / 2;
    if (missing.gain < kSearch.worth_splitting || tried.size() == kSearch.most_places) break;
    if (missing.segment % 2 == 0 || !IsWide(fit.tube.program, bend)) continue;
    if (tried.insert(bend).second && SplitAt(fit, SplineFromTube(fit.tube), bend)) return true;
  }
  return false;
}

bool StructureSearch::AddedAt(SurfaceFit& fit, MissingBend missing) {
  const ArcLineSpline spline = SplineFromTube(fit.tube);
  const std::size_t before = missing.segment / 2;  // arcs
  Part part = Around(spline, {before - std::min<std::size_t>(before, 1),
                              std::min(before + 1, spline.arcs.size())});
  missing.segment -= part.window.first_segment();
  const hal::Tube tube = TubeFromSpline(part.spline, fit.tube.pipe_radius_mm);
  for (const ArcLineSpline& with : WithBend(part.spline, tube, missing, *polygon_)) {
    if (auto better = Better(fit, spline, part, with)) {
      Accept(fit, std::move(*better), part.window);
      return true;
    }
  }
  return false;
}

// The best merge or drop that begins at this arc and is no worse. False: none is.
bool StructureSearch::SimplifiedAt(SurfaceFit& fit, std::size_t arc) {
  if (simpler_[arc]) return false;
  Rival closest = std::exchange(closest_, {});
  const ArcLineSpline spline = SplineFromTube(fit.tube);
  const std::size_t arcs = spline.arcs.size();
  std::optional<Part> part;
  std::optional<SurfaceFit> best;
  const auto local = [&](std::size_t i) { return i - part->window.first; };
  const auto look = [&](std::size_t last) {
    if (!part || last >= part->window.last) part = Around(spline, {arc, last + 1});
  };
  const auto consider = [&](const ArcLineSpline& simpler) {
    auto better = Better(fit, spline, *part, simpler);
    if (better && (!best || criterion_.IsBetter(*better, *best))) best = std::move(better);
  };
  for (std::size_t last = arc + 1;
       last < std::min(arc + kSearch.most_merged, arcs) && !IsSettled(fit, last); ++last) {
    look(last);
    if (const auto simpler = WithOneArc(part->spline, local(arc), local(last))) consider(*simpler);
  }
  // Bends that undo each other, as nodes disturbed by a clamp pretend them.
  for (std::size_t last = arc; last < std::min(arc + kSearch.most_dropped, arcs); ++last) {
    if (TurnDeg(spline.arcs[arc], spline.arcs[last]) > kSearch.undone_deg) continue;
    look(last);
    consider(WithoutArcs(part->spline, local(arc), local(last)));
  }
  // A bend near the border that clutter beside it pretends: the tube that goes straight on.
  const double border_mm = kSearch.doubtful_border * radius_mm_;
  for (const bool at_start : {true, false}) {
    if (arc != (at_start ? 0 : arcs - 1)) continue;
    look(arc);
    ArcLineSpline without = part->spline;
    if (at_start ? DropFirst(without, border_mm) : DropLast(without, border_mm)) consider(without);
  }
  if (!best) {
    simpler_[arc] = std::exchange(closest_, std::move(closest));
    return false;
  }
  Accept(fit, std::move(*best), part->window);
  return true;
}

}  // namespace bendloop::pipeline
