// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/bends_with_bows.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>
#include <vector>

#include "pipeline/fit/bend_changes.h"
#include "pipeline/fit/bowed_cost.h"
#include "pipeline/fit/bowed_tube.h"
#include "pipeline/fit/dent_evidence.h"
#include "pipeline/fit/easing_fit.h"
#include "pipeline/fit/kept_ends.h"
#include "pipeline/fit/one_die.h"
#include "pipeline/fit/surface_pass.h"
#include "pipeline/fit/surface_sums.h"
#include "pipeline/fit/without_dents.h"
#include "pipeline/math/quantiles.h"
#include "pipeline/tube/representations.h"

namespace bendloop::pipeline {
namespace {

// By trial where nothing else is said.
struct ReviseSettings {
  // [of the points] With fewer on it a part of the tube may have lost its way.
  double on_tube = 0.95;
  // [of the points] That stay on the tube when a slight bend is taken away.
  double kept = 0.98;
  // A bend more must explain so many times the logarithm of the points' number, as in the search.
  double price = 4.0;
  // [variances] And each number of bows and easings, of which some explain noise, twice what they
  // explain of it (Akaike's criterion).
  double number_price = 2.0;
  // [of r_P] Where easing begins, and [sigma] from which on samples insist on it (easing_fit.cc).
  double easing = 0.3, insist = 3.0;
  // [logarithm of odds] What an easing costs, of which bends of one tube have about the same: where
  // samples insist on neither, both are likely. And the part of the odds that is not worth a doubt.
  double easing_price = 1.0, hardly_likely = 0.01;
  // [of r_P] Beside bows so little may be none, and bows looked like it.
  double hardly_eased = 0.1;
  // So many points tell which is better.
  std::size_t points = 20'000;
  int most_changes = 4;
  // Times that points of dents are left out; [of the points before] once more only where no more
  // than these are left.
  int most_undented = 6;
  double undented = 0.999;
  // [of r_P] Where dents leave out so much of an end its straight goes on beyond its points.
  double gone = 0.1;
  // [of the points] That dents leave, or they explain too much.
  double beside_dents = 0.8;
  // Times that samples of a place are worth less: what makes them disagree so much may be a dent
  // that its bend has taken in.
  double disagree = 4.0;
  // [deg] and [of r_P] Of more angle a bend is no stand-in for a bow; tighter ones stand where the
  // fit holds them (FitBounds).
  double no_slight_deg = 10.0, tightest = 1.02;
};
constexpr ReviseSettings kRevise;
constexpr double kFar = std::numeric_limits<double>::infinity();

// How much better `a` explains the points [variances].
double GainOf(const BowedSolution& a, const BowedSolution& b, std::span<const PointBlock> blocks,
              double reach_mm, std::size_t most_points = kRevise.points) {
  // Of those that fewer points were left out of as dents: a tube that lost its way takes for dents
  // what it lost.
  const auto of = [&blocks](const BowedSolution& solution) {
    return solution.undented ? std::span<const PointBlock>(*solution.undented) : blocks;
  };
  const std::span<const PointBlock> left = CountPoints(of(a)) < CountPoints(of(b)) ? of(b) : of(a);
  const OwnedBlocks points = Thinned(left, StrideTo(CountPoints(left), most_points));
  const double sigma_mm = std::min(a.bows.noise_mm, b.bows.noise_mm);
  return CostOf(b.bows.state, points, reach_mm, sigma_mm) -
         CostOf(a.bows.state, points, reach_mm, sigma_mm);
}

BowedSolution Solved(const ControlPolygon& corners, std::span<const PointBlock> blocks,
                     const SurfaceFitOptions& options, double pipe_radius_mm) {
  auto tube = TubeFromPolygon(corners);
  if (!tube) return {};
  tube->pipe_radius_mm = pipe_radius_mm;
  return SolveAnew(*tube, blocks, options);
}

// As FitSurface(). Where a part of the tube ends up off its points, those have no weight beside a
// small noise, and nothing leads back: then a fit to which all within reach count goes first.
SurfaceFit FitFromAfar(const hal::Tube& start, std::span<const PointBlock> blocks,
                       const SurfaceFitOptions& options) {
  SurfaceFit near = FitSurface(start, blocks, options);
  const auto points = static_cast<double>(near.points);
  if (static_cast<double>(near.used) > kRevise.on_tube * points) return near;
  SurfaceFitOptions to_all = options;
  to_all.min_sigma_mm = std::max(options.min_sigma_mm, options.reach_mm / kFullWeight);
  const SurfaceFit led = FitSurface(start, blocks, to_all);
  SurfaceFitOptions from_there = options;
  from_there.easing = led.easing;
  SurfaceFit far = FitSurface(led.tube, blocks, from_there);
  const double sigma_mm = std::max(near.sigma_mm, far.sigma_mm);
  const OwnedBlocks few = Thinned(blocks, StrideTo(CountPoints(blocks), kRevise.points));
  const auto cost = [&](const SurfaceFit& fit) {
    return CostOf({fit.tube, fit.flattening, fit.easing, {}}, few, options.reach_mm, sigma_mm);
  };
  return cost(far) < cost(near) ? std::move(far) : std::move(near);
}

// [mm] By how much the first and the last straight go on beyond the points that are left on them:
// their best-fit lines are of all of them, though their ends be taken for dented.
std::array<double, 2> HiddenBeside(const BowedTubeState& state, std::span<const PointBlock> all,
                                   std::span<const PointBlock> left,
                                   const SurfaceFitOptions& options) {
  const auto beyond_mm = [&](std::span<const PointBlock> blocks) {
    const OwnedBlocks few = Thinned(blocks, StrideTo(CountPoints(blocks), kRevise.points));
    return PointsBeyond(state, few, options.reach_mm);
  };
  const auto of_all = beyond_mm(all), of_left = beyond_mm(left);
  std::array<double, 2> hidden_mm = options.hidden_mm;
  for (const std::size_t end : {std::size_t{0}, std::size_t{1}}) {
    if (!of_all[end] || !of_left[end]) continue;
    const double gone_mm = *of_all[end] - *of_left[end];
    if (gone_mm > kRevise.gone * state.tube.pipe_radius_mm) hidden_mm[end] += gone_mm;
  }
  return hidden_mm;
}

BowedSolution Solve(const hal::Tube& start, std::span<const PointBlock> blocks,
                    const SurfaceFitOptions& options, std::optional<SurfaceFit> straight) {
  BowedSolution solution{
      straight ? std::move(*straight) : FitFromAfar(start, blocks, options), {}, std::nullopt, {}};
  const EndPlaces ends = EndsOf(start);
  EndAt(ends, solution.fit.tube);
  solution.straight = solution.fit.tube;
  solution.bows = FitBows(blocks, options, solution.fit);
  // What a fit has taken in of a dent it shows too shallow and too small: without it, more is seen.
  const bool may_be_dented =
      solution.bows.is_pulled_aside || solution.bows.worth > kRevise.disagree;
  for (int i = 0; i < kRevise.most_undented && may_be_dented; ++i) {
    const auto from = solution.undented ? std::span<const PointBlock>(*solution.undented) : blocks;
    auto undented = WithoutDents(solution.bows.state, solution.bows.noise_mm, blocks, from,
                                 options.reach_mm, options.dents);
    if (!undented) break;
    const auto before = static_cast<double>(CountPoints(from));
    if (i > 0 && static_cast<double>(undented->point_count()) > kRevise.undented * before) break;
    solution.undented = std::move(undented);
    SurfaceFitOptions from_there = options;
    from_there.easing = solution.fit.easing;
    from_there.hidden_mm = HiddenBeside(solution.bows.state, blocks, *solution.undented, options);
    hal::Tube start_now = start;
    if (from_there.easing.empty()) {
      // What dents hid.
      FoundEasing hidden = FindEasing(solution.fit, *solution.undented, from_there);
      from_there.easing = std::move(hidden.easing);
      start_now = hidden.eased.value_or(start);
    }
    solution.fit = FitFromAfar(start_now, *solution.undented, from_there);
    EndAt(ends, solution.fit.tube);
    solution.straight = solution.fit.tube;
    const SurfaceFit straight_fit = solution.fit;
    const BowedFit with_dents =
        std::exchange(solution.bows, FitBows(*solution.undented, from_there, solution.fit));
    if (!solution.bows.is_lost || with_dents.is_lost) continue;
    // From where lines and arcs lie the steps led astray; from the bowed tube they need not.
    solution.fit = straight_fit;
    solution.bows = FitBows(*solution.undented, from_there, solution.fit, &with_dents);
  }
  EndAt(ends, solution.fit.tube);
  return solution;
}

bool IsHardlyEased(const SurfaceFit& fit) {
  const double hardly_mm = kRevise.hardly_eased * fit.tube.pipe_radius_mm;
  const auto& variance_mm2 = fit.easing.variance_mm2;
  return std::all_of(variance_mm2.begin(), variance_mm2.end(),
                     [&](double of_bend) { return of_bend < hardly_mm * hardly_mm; });
}

BowedSolution SharpOrEased(const hal::Tube& start, std::span<const PointBlock> blocks,
                           const SurfaceFitOptions& options, std::optional<SurfaceFit> straight) {
  BowedSolution solution = Solve(start, blocks, options, std::move(straight));
  const bool is_bowed = solution.bows.state.is_bowed();
  const std::size_t bends = solution.fit.tube.program.bend_count();
  const bool is_sharp = solution.fit.easing.empty();
  if (bends == 0 || !(is_sharp ? is_bowed : IsHardlyEased(solution.fit))) return solution;
  // Where straights are taken for straight, bows hide that bends ease, or look like it: from
  // easings that are not there the bows are not found. Nor do dents that are left out by now.
  const double easing_mm = kRevise.easing * solution.fit.tube.pipe_radius_mm;
  SurfaceFitOptions with_other = options;
  with_other.easing = {};
  if (is_sharp) with_other.easing.variance_mm2.assign(bends, easing_mm * easing_mm);
  BowedSolution other =
      Solve(is_sharp ? solution.straight : start, blocks, with_other, std::nullopt);
  BowedSolution& eased = is_sharp ? other : solution;
  BowedSolution& sharp = is_sharp ? solution : other;
  const double worth = std::max(1.0, std::min(eased.bows.worth, sharp.bows.worth));
  const double gain = GainOf(eased, sharp, blocks, options.reach_mm, kBowed.enough_points);
  const bool is_eased = gain > worth * kRevise.insist * kRevise.insist;
  const double of_eased = 1.0 / (1.0 + std::exp(kRevise.easing_price - 0.5 * gain / worth));
  BowedSolution& chosen = is_eased ? eased : sharp;
  BowedSolution& left = is_eased ? sharp : eased;
  if (!left.bows.is_lost) {
    const double of_left = is_eased ? 1.0 - of_eased : of_eased;
    DoubtBy({std::move(left.fit), of_left}, options.free_pipe_radius, chosen);
  }
  return std::move(chosen);
}

// [mm] The greater a bend's angle, the more its samples tell of its radius.
double UsualRadiusMm(const hal::BendProgram& program) {
  std::vector<std::pair<double, double>> radii_mm;  // with their weights
  double all = 0;
  for (const hal::BendRow& row : program.rows) {
    if (!row.bend_radius_mm || !(row.angle_deg > 0)) continue;
    radii_mm.emplace_back(*row.bend_radius_mm, row.angle_deg * row.angle_deg);
    all += radii_mm.back().second;
  }
  std::sort(radii_mm.begin(), radii_mm.end());
  double below = 0;
  for (const auto& [radius_mm, weight] : radii_mm) {
    below += weight;
    if (below >= 0.5 * all) return radius_mm;
  }
  return 0;
}

// Radii of slight bends, their easings and the bows beside them may each be what the others are:
// together they lead a fit astray. Those of one die do not. As `solution` otherwise.
BowedSolution OfOneDie(const BowedSolution& solution, std::span<const PointBlock> blocks,
                       SurfaceFitOptions options) {
  auto start = WithBendRadii(solution.straight, UsualRadiusMm(solution.straight.program));
  if (!start) return {};
  start->pipe_radius_mm = solution.fit.tube.pipe_radius_mm;
  options.easing = solution.fit.easing;
  if (auto& variance_mm2 = options.easing.variance_mm2; !variance_mm2.empty()) {
    variance_mm2.assign(variance_mm2.size(), Median(variance_mm2));
  }
  options.priors.bend_radius.reset();
  options.priors.radii_alike = kRadiiOfOneDie;
  return SharpOrEased(*start, blocks, options, std::nullopt);
}

// Whether a bend of some angle is as tight as fits let it be: it may have lost its points.
bool IsAtBound(const hal::Tube& tube) {
  const auto& rows = tube.program.rows;
  return std::any_of(rows.begin(), rows.end(), [&tube](const hal::BendRow& row) {
    return row.angle_deg > kRevise.no_slight_deg && row.bend_radius_mm &&
           *row.bend_radius_mm < kRevise.tightest * tube.pipe_radius_mm;
  });
}

// [variances]
double PriceOfBend(std::span<const PointBlock> blocks, std::size_t most_points = kRevise.points) {
  const auto points = static_cast<double>(std::min(CountPoints(blocks), most_points));
  return kRevise.price * std::log(points);
}

// How many numbers say how far the tube is from lines and arcs.
double FormNumbers(const BowedSolution& solution) {
  const auto& bows = solution.bows.state.bows;
  const auto bowed =
      std::count_if(bows.begin(), bows.end(), [](const Bow& bow) { return !bow.is_none(); });
  return static_cast<double>(kBowModes * bowed) +
         static_cast<double>(solution.fit.easing.variance_mm2.size() +
                             solution.fit.easing.skew.size());
}

// Whether dents explain some of the points, and not too many.
bool LeavesOutDents(const BowedSolution& solution, std::span<const PointBlock> blocks) {
  if (!solution.undented || solution.bows.is_lost) return false;
  const auto all = static_cast<double>(CountPoints(blocks));
  return static_cast<double>(solution.undented->point_count()) > kRevise.beside_dents * all;
}

// How much better the points but those of the dents of `fewer` speak for it, and the numbers of its
// bends, form and dents [twice the logarithm of the odds]: what two bends explain of a dent, one
// that leaves it out need not. None: it has no dents, or too many, or the others do not like it.
std::optional<double> EvidenceBesideDents(const BowedSolution& fewer, const BowedSolution& found,
                                          std::span<const PointBlock> blocks, double reach_mm) {
  if (!LeavesOutDents(fewer, blocks)) return std::nullopt;
  const double more = AdvantageAt(*fewer.undented, found, fewer, reach_mm);
  if (more > kDentEvidence.worse) return std::nullopt;
  const double fewer_bends = static_cast<double>(found.fit.tube.program.bend_count()) -
                             static_cast<double>(fewer.fit.tube.program.bend_count());
  const std::size_t of_found = found.undented ? found.undented->point_count() : CountPoints(blocks);
  const std::size_t of_fewer = fewer.undented->point_count();
  const double dented = of_found > of_fewer ? static_cast<double>(of_found - of_fewer) : 1.0;
  return fewer_bends * PriceOfBend(blocks) - more - kDentEvidence.numbers * std::log(dented) -
         kRevise.number_price * (FormNumbers(fewer) - FormNumbers(found));
}

// Whether bends of this tube may look like two.
bool ExplainsParted(const BowedSolution& solution) {
  return !solution.fit.easing.empty() || solution.undented;
}

}  // namespace

bool IsOfSameBends(const BowedSolution& other, const BowedSolution& solution) {
  return !other.bows.is_lost &&
         other.fit.tube.program.bend_count() == solution.fit.tube.program.bend_count();
}

bool IsOfLinesAndArcs(const BowedSolution& solution) {
  return FormNumbers(solution) == 0 && !solution.undented;
}

void DoubtBy(const Doubt& doubt, bool free_pipe_radius, BowedSolution& chosen) {
  const std::size_t bends = chosen.fit.tube.program.bend_count();
  if (doubt.part < kRevise.hardly_likely || chosen.bows.is_lost ||
      doubt.other.tube.program.bend_count() != bends) {
    return;
  }
  const auto numbers = [&](const SurfaceFit& fit) {
    return TubeParameters(fit.tube, free_pipe_radius, fit.flattening, {}).Initial();
  };
  const TubeParameters parameters(chosen.fit.tube, free_pipe_radius, chosen.fit.flattening, {});
  Eigen::VectorXd apart = numbers(doubt.other) - numbers(chosen.fit);
  for (std::size_t i = 1; i < bends; ++i) {
    double& turn = apart[parameters.rotation(i)];
    turn = std::remainder(turn, 2.0 * std::numbers::pi);
  }
  Widen(doubt.part * apart * apart.transpose(), free_pipe_radius, chosen.fit);
}

double EvidenceFor(const BowedSolution& a, const BowedSolution& b,
                   std::span<const PointBlock> blocks, double reach_mm) {
  const double more_bends = static_cast<double>(a.fit.tube.program.bend_count()) -
                            static_cast<double>(b.fit.tube.program.bend_count());
  // Samples of a place that agree with either disagree with the other because of its bends.
  const double worth = std::max(1.0, std::min(a.bows.worth, b.bows.worth));
  // Between lines and arcs alone the search for bends has decided by all points.
  const bool as_searched = IsOfLinesAndArcs(a) && IsOfLinesAndArcs(b);
  const std::size_t points = as_searched ? CountPoints(blocks) : kRevise.points;
  return GainOf(a, b, blocks, reach_mm, points) / worth - more_bends * PriceOfBend(blocks, points) -
         kRevise.number_price * (FormNumbers(a) - FormNumbers(b));
}

double EvidenceWithDents(const BowedSolution& a, const BowedSolution& b,
                         std::span<const PointBlock> blocks, double reach_mm, double more) {
  const double evidence = more + EvidenceFor(a, b, blocks, reach_mm);
  if (a.fit.tube.program.bend_count() >= b.fit.tube.program.bend_count()) return evidence;
  const auto beside = EvidenceBesideDents(a, b, blocks, reach_mm);
  return std::max(evidence, beside.value_or(evidence));
}

BowedSolution SolveWithBows(const hal::Tube& start, std::span<const PointBlock> blocks,
                            const SurfaceFitOptions& options, std::optional<SurfaceFit> straight) {
  BowedSolution solution = SharpOrEased(start, blocks, options, std::move(straight));
  const std::size_t bends = solution.fit.tube.program.bend_count();
  const bool may_be_lost = solution.bows.is_lost || IsAtBound(solution.fit.tube);
  if (!may_be_lost || bends < 2 || options.priors.radii_alike > 0) return solution;
  BowedSolution other = OfOneDie(solution, blocks, options);
  const bool is_found =
      IsOfSameBends(other, solution) && GainOf(other, solution, blocks, options.reach_mm) > 0;
  return is_found ? std::move(other) : std::move(solution);
}

BowedSolution SolveAnew(const hal::Tube& start, std::span<const PointBlock> blocks,
                        SurfaceFitOptions options) {
  SurfaceFit sharp;
  sharp.tube = start;
  FoundEasing found = FindEasing(sharp, blocks, options);
  options.easing = std::move(found.easing);
  return SolveWithBows(found.eased.value_or(start), blocks, options, std::move(found.sharp));
}

bool MayHideBends(const BowedSolution& solution) {
  if (solution.bows.is_lost) return true;
  const auto& bows = solution.bows.state.bows;
  const EasedSpine spine = SpineOf(solution.bows.state);
  for (std::size_t k = 0; k < bows.size(); ++k) {
    if (IsMoreThanBendersLeave(bows[k], spine.segments[k].length_mm)) return true;
  }
  return false;
}

std::optional<double> MoreThanDents(const BowedSolution& found, const BowedSolution& fewer,
                                    std::span<const PointBlock> blocks, double reach_mm) {
  if (!LeavesOutDents(fewer, blocks) || found.bows.is_lost) return std::nullopt;
  return AdvantageAt(*fewer.undented, found, fewer, reach_mm);
}

double AdvantageAt(std::span<const PointBlock> blocks, const BowedSolution& a,
                   const BowedSolution& b, double reach_mm) {
  const OwnedBlocks points = Thinned(blocks, StrideTo(CountPoints(blocks), kRevise.points));
  const double sigma_mm = std::min(a.bows.noise_mm, b.bows.noise_mm);
  const double gain = CostOf(b.bows.state, points, reach_mm, sigma_mm) -
                      CostOf(a.bows.state, points, reach_mm, sigma_mm);
  return gain / std::max(1.0, std::min(a.bows.worth, b.bows.worth));
}

double AdvantageOf(const BowedSolution& a, const BowedSolution& b,
                   std::span<const PointBlock> blocks, double reach_mm) {
  return GainOf(a, b, blocks, reach_mm) / std::max({1.0, a.bows.worth, b.bows.worth});
}

double ReviseBends(std::span<const PointBlock> blocks, const SurfaceFitOptions& options,
                   std::optional<std::size_t> nominal_bends, BowedSolution& solution) {
  double margin = kFar;
  for (int i = 0; i < kRevise.most_changes; ++i) {
    bool is_changed = false;
    for (const BendChange& change : BendChanges(solution, nominal_bends)) {
      BowedSolution other =
          Solved(change.corners, blocks, options, solution.fit.tube.pipe_radius_mm);
      if (other.fit.points == 0) continue;
      const double unmade = ExplainsParted(other) ? change.unmade * PriceOfBend(blocks) : 0.0;
      const double advantage = EvidenceWithDents(other, solution, blocks, options.reach_mm, unmade);
      if (!std::isfinite(advantage)) continue;
      margin = std::min(margin, std::abs(advantage));
      // What lost a part of the tube is no other tube.
      const bool is_certain =
          change.is_certain && static_cast<double>(other.fit.used) >
                                   kRevise.kept * static_cast<double>(solution.fit.used);
      if (advantage < 0 && !is_certain) continue;
      solution = std::move(other);
      is_changed = true;
      break;
    }
    if (!is_changed) break;
  }
  return margin;
}

}  // namespace bendloop::pipeline
