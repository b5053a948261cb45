// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/surface_fit.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include "hal/angles.h"
#include "hal/spine.h"
#include "pipeline/fit/normal_equations.h"
#include "pipeline/fit/surface_pass.h"
#include "pipeline/fit/surface_sums.h"
#include "pipeline/fit/tube_parameters.h"
#include "pipeline/math/magnitude_histogram.h"

namespace bendloop::pipeline {
namespace {

constexpr double kMadToSigma = 1.4826;  // of normal noise: 1 / its quantile of 0.75

struct SurfaceFitSettings {
  // Steps that make chi square less by less than this, a tenth of a standard error long, are the
  // last.
  double hardly = 0.03;
  // Of the normal matrix's diagonal: damping at the start, none (which only keeps the matrix from
  // being singular), the least that is felt, and that from which on no step is to be expected.
  // By trial.
  double first_damping = 1e-4, no_damping = 1e-10, least_damping = 1e-8, most_damping = 1e6;
  // Of the damping after a step that was in vain; after another one its square, and so on.
  double least_growth = 4.0;
  // Of the damping after a step that was not, few points or all.
  double relief = 0.1;
  // Times the last step's gain may still come. By trial.
  double further = 8.0;
  int most_idle = 2;            // steps without a gain
  std::size_t few_points = 10;  // fewer are no tube

  // A part of the points leads where all are at least so many times more; a start near the solution
  // loses by it. By trial.
  std::size_t leading_points = 2500, leading_stride = 4;
  double leading_tolerance = 1e-4;  // of chi square: SurfaceFitOptions::tolerance

  // Of very many points so many are fitted first, then times more, and so on.
  std::size_t coarse_points = 10'000, lead = 10;
  int full_passes = 8;  // at most; two are usual
  // A step over all points leaves less than a thousandth of what it made chi square less by. The
  // solution of one of ten of the points leaves 9 a parameter.
  double little = 300.0;
  // What all points ask for makes chi square of a part worse by one a parameter, or a few.
  double no_worse = 4.0;

  // [of r_P] Between a straight so short and one so long directions are known by more and more of
  // the straights, by such exponents; and where there is hardly one, by arcs alone. By trial on
  // passes that drift.
  double no_straight = 1.0, short_straight = 2.5, long_straight = 4.0;
  double of_short = 0.65, of_long = 0.8;
  // [rad] 1 sigma of a turn that no sample tells: what straights agree on is none of its business.
  double vague_rad = 0.05;
};
constexpr SurfaceFitSettings kFit;

// Where a fit stands: a tube and what the points say of it.
struct State {
  hal::Tube tube;
  std::vector<Flattening> flattening;
  Easing easing;
  EasedSpine spine;
  SurfaceAssignment assignment;
  double sigma_mm = 0;

  TubeParameters Parameters(const SurfaceFitOptions& options) const {
    return {tube, options.free_pipe_radius, flattening, easing};
  }
  std::vector<SegmentFrame> Frames() const {
    return SegmentFrames(spine, kBeyond * tube.pipe_radius_mm, flattening);
  }
  void MoveTo(const TubeParameters& parameters, const Eigen::VectorXd& to,
              std::span<const PointBlock> blocks, const SurfaceFitOptions& options) {
    tube = parameters.TubeAt(to);
    flattening = parameters.FlatteningAt(to);
    easing = parameters.EasingAt(to);
    spine = SpineOf(tube.program, tube.X_WT, easing);
    AssignPoints(Frames(), tube.pipe_radius_mm, blocks, options.reach_mm, assignment);
    MagnitudeHistogram magnitudes;
    for (const double d : assignment.distances_mm) magnitudes.Add(d);
    sigma_mm = std::max(options.min_sigma_mm, kMadToSigma * magnitudes.Quantile(0.5));
  }
  std::vector<CondensedSum> Sums() const {
    const auto frames = Frames();
    std::vector<CondensedSum> sums;
    for (std::size_t k = 0; k < frames.size(); ++k) {
      sums.push_back(SumOfRows(assignment.segments[k], frames[k], tube.pipe_radius_mm, sigma_mm));
    }
    return sums;
  }
  // Points out of reach cost as much as if they were just there.
  double ChiSquare(double sigma, const SurfaceFitOptions& options) const {
    const auto out_of_reach =
        static_cast<double>(assignment.total - assignment.distances_mm.size());
    return RobustSum(assignment.distances_mm, sigma) +
           out_of_reach * RobustSum(options.reach_mm, sigma) +
           options.priors.ChiSquare(tube.program, flattening, easing);
  }
};

// The same of a walk over the points.
double ChiSquareOf(const SurfacePass& pass, double sigma_mm, const SurfaceFitOptions& options) {
  const auto out_of_reach = static_cast<double>(pass.total - pass.magnitudes.Count());
  return pass.magnitudes.Sum([sigma_mm](double d) { return RobustSum(d, sigma_mm); }) +
         out_of_reach * RobustSum(options.reach_mm, sigma_mm);
}

double LeastVarianceMm2(const FormDeviation& form, const SurfaceFit& fit) {
  return form.LeastVariance(static_cast<double>(fit.used), hal::SpineLength(fit.tube.program),
                            fit.tube.pipe_radius_mm);
}

void SetSigmas(const TubeParameters& parameters, SurfaceFit& fit) {
  const Eigen::MatrixXd& covariance = fit.covariance;
  Eigen::VectorXd variance = covariance.diagonal();
  if (fit.turn_surplus.size() == variance.size()) variance -= fit.turn_surplus;
  const Eigen::VectorXd sigma = variance.cwiseMax(0.0).cwiseSqrt();
  if (parameters.pipe_radius() >= 0) fit.pipe_radius_sigma_mm = sigma[parameters.pipe_radius()];
  fit.sigma = fit.tube.program;
  for (std::size_t i = 0; i < fit.sigma.rows.size(); ++i) {
    hal::BendRow& row = fit.sigma.rows[i];
    row = {0, 0, 0, std::nullopt};
    if (i >= parameters.bends()) continue;
    row.length_mm = sigma[parameters.length(i)];
    if (i > 0) row.rotation_deg = sigma[parameters.rotation(i)] * hal::kDegreesPerRadian;
    row.angle_deg = sigma[parameters.angle(i)] * hal::kDegreesPerRadian;
    row.bend_radius_mm = sigma[parameters.bend_radius(i)];
  }
  fit.flattening_sigma.clear();
  for (std::size_t i = 0; i < fit.flattening.size(); ++i) {
    const Eigen::Matrix4d of_bend = covariance.block<kFlatteningParameters, kFlatteningParameters>(
        parameters.flattening(i), parameters.flattening(i));
    const auto sigma_of = [&of_bend](const Eigen::Vector4d& weights) {
      return std::sqrt(std::max(0.0, weights.dot(of_bend * weights)));
    };
    fit.flattening_sigma.push_back({sigma_of({1, 1, 0.5, 0.5}), sigma_of({0.5, 0.5, 1, 1})});
  }
  fit.easing_sigma_mm2.clear();
  for (std::size_t i = 0; i < fit.easing.variance_mm2.size(); ++i) {
    fit.easing_sigma_mm2.push_back(sigma[parameters.easing(i)]);
  }
  // The last length is from its border to where the last bend ends, which the fit knows so well.
  fit.sigma.rows.back().length_mm =
      std::sqrt(std::max(0.0, fit.last_start.dot(covariance * fit.last_start)));
}

// What the samples tell of turns more surely than patches of the surface scatter; less of those
// between short straights, which arcs tell as well.
Eigen::VectorXd TurnSurplus(const TubeParameters& parameters, const SurfaceFit& fit) {
  const auto& rows = fit.tube.program.rows;
  Eigen::VectorXd surplus = Eigen::VectorXd::Zero(fit.covariance.rows());
  const auto add = [&](int parameter, double shortest_mm) {
    const double r_mm = fit.tube.pipe_radius_mm;
    const double straight = std::max(0.0, shortest_mm / r_mm);
    const double part = std::clamp(
        (straight - kFit.short_straight) / (kFit.long_straight - kFit.short_straight), 0.0, 1.0);
    const double of_straights = straight < kFit.no_straight
                                    ? kFit.of_short * straight / kFit.no_straight
                                    : kFit.of_short + (kFit.of_long - kFit.of_short) * part;
    const double effect = std::pow(fit.direction_effect / fit.design_effect, of_straights);
    const double variance = std::max(0.0, fit.covariance(parameter, parameter));
    if (variance > kFit.vague_rad * kFit.vague_rad) return;
    surplus[parameter] = (1.0 - effect) * variance;
  };
  for (std::size_t i = 0; i + 1 < rows.size(); ++i) {
    const double beside_mm = std::min(rows[i].length_mm, rows[i + 1].length_mm);
    add(parameters.angle(i), beside_mm);
    if (i > 0) add(parameters.rotation(i), std::min(rows[i - 1].length_mm, beside_mm));
  }
  return surplus;
}

void SetPenalty(const TubeParameters& parameters, const FormDeviation& form, SurfaceFit& fit) {
  fit.occam_penalty = fit.priors.OccamPenalty(
      parameters, fit.tube, fit.information,
      std::max(fit.residual_mm2 * fit.design_effect, LeastVarianceMm2(form, fit)));
}

void Report(const TubeParameters& parameters, const NormalEquations& equations,
            const SurfaceFitOptions& options, SurfaceFit& fit) {
  fit.used = static_cast<std::size_t>(equations.weight + 0.5);
  fit.information = equations.matrix;
  fit.residual_mm2 = equations.Variance();
  SetForm(options.form, fit);
  SetPenalty(parameters, options.form, fit);
  fit.covariance = equations.Covariance(
      parameters, fit.tube, fit.design_effect + options.few_causes * (fit.design_effect - 1.0));
  fit.turn_surplus = TurnSurplus(parameters, fit);
  fit.last_start = equations.last_start;
  SetSigmas(parameters, fit);
}

// Points with weight by segment.
std::vector<double> UsedOf(std::span<const SegmentPoints> segments, double sigma_mm) {
  std::vector<double> used;
  for (const SegmentPoints& of : segments) {
    const std::span<const double> distances_mm(of.distance.data(), of.size);
    used.push_back(static_cast<double>(
        std::count_if(distances_mm.begin(), distances_mm.end(),
                      [&](double d_mm) { return std::abs(d_mm) < kNoWeight * sigma_mm; })));
  }
  return used;
}
std::vector<double> UsedOf(std::span<const CondensedSum> sums) {
  std::vector<double> used;
  for (const CondensedSum& sum : sums) used.push_back(sum(kPipeRadiusState, kPipeRadiusState));
  return used;
}

void SetMeanSquares(std::span<const double> sum_mm2, std::span<const double> count,
                    SurfaceFit& fit) {
  fit.segment_samples.assign(count.begin(), count.end());
  fit.segment_mean_square_mm2.clear();
  for (std::size_t k = 0; k < sum_mm2.size(); ++k) {
    fit.segment_mean_square_mm2.push_back(sum_mm2[k] / std::max(1.0, count[k]));
  }
}

// Levenberg-Marquardt on few points. Points are given to segments, and weights to points, again at
// every step.
class FitOfFew {
 public:
  // `flattening`: where it starts. The points stay where they are.
  FitOfFew(const hal::Tube& start, std::vector<Flattening> flattening,
           std::span<const PointBlock> blocks, const SurfaceFitOptions& options)
      : options_(options),
        blocks_(blocks),
        first_(start, options.free_pipe_radius, flattening, options.easing),
        bounds_(first_, start.pipe_radius_mm, options.max_length_mm) {
    fit_.tube = start;
    fit_.priors = options.priors;
    state_.MoveTo(first_, bounds_.Inside(first_.Initial()), blocks_, options_);
  }

  SurfaceFit Solve() {
    for (int i = 0; state_.assignment.distances_mm.size() >= kFit.few_points; ++i) {
      fit_.tube = state_.tube;
      fit_.flattening = state_.flattening;
      fit_.easing = state_.easing;
      if (i >= options_.max_steps || damping_ > kFit.most_damping) break;
      Linearize();
      const double chi_square = state_.ChiSquare(state_.sigma_mm, options_);
      if (i == 0) fit_.start_cost_mm2 = chi_square * state_.sigma_mm * state_.sigma_mm;
      const double hardly_mm2 = std::max(kFit.hardly, options_.tolerance * chi_square) *
                                state_.sigma_mm * state_.sigma_mm;
      const Eigen::VectorXd step = NextStep(hardly_mm2);
      if (IsHopeless(chi_square * state_.sigma_mm * state_.sigma_mm)) break;
      // Points that change their segment make steps fail that are much shorter than the noise.
      idle_ = GainOf(step) < hardly_mm2 ? idle_ + 1 : 0;
      if (idle_ > kFit.most_idle) break;
      next_.MoveTo(state_.Parameters(options_), equations_->at + step, blocks_, options_);
      const bool better = next_.ChiSquare(state_.sigma_mm, options_) < chi_square;
      if (fit_.converged && better) {
        fit_.tube = next_.tube;
        fit_.flattening = next_.flattening;
        fit_.easing = next_.easing;
      }
      if (fit_.converged) break;
      GoOn(better);
    }
    return Reported();
  }

 private:
  void Linearize() {
    if (equations_) return;
    equations_.emplace(state_.Parameters(options_), state_.spine, state_.Sums(), options_.priors,
                       state_.sigma_mm);
  }

  double GainOf(const Eigen::VectorXd& step) const { return step.dot(equations_->right); }

  // The damped step; where little is to be gained that without damping, if it agrees that this is
  // the end.
  Eigen::VectorXd NextStep(double hardly_mm2) {
    Eigen::VectorXd step = BoundedStep(*equations_, bounds_, damping_);
    if (GainOf(step) >= hardly_mm2) return step;
    Eigen::VectorXd undamped = BoundedStep(*equations_, bounds_, kFit.no_damping);
    fit_.converged = GainOf(undamped) < hardly_mm2;
    return fit_.converged ? undamped : step;
  }

  // Whether the goal is out of reach at the pace of the last steps. `cost_mm2`: where it stands.
  bool IsHopeless(double cost_mm2) {
    pace_mm2_ = last_cost_mm2_ ? std::max(0.5 * pace_mm2_, *last_cost_mm2_ - cost_mm2) : cost_mm2;
    last_cost_mm2_ = cost_mm2;
    return cost_mm2 - options_.goal_mm2 > kFit.further * pace_mm2_;
  }

  // From where the step led, if it was better; else from here with a shorter one.
  void GoOn(bool better) {
    if (better) {
      std::swap(state_, next_);
      equations_.reset();
      damping_ = std::max(kFit.no_damping, kFit.relief * damping_);
      growth_ = kFit.least_growth;
    } else {
      damping_ = growth_ * std::max(damping_, kFit.least_damping);
      growth_ *= kFit.least_growth;
    }
  }

  SurfaceFit Reported() {
    fit_.points = state_.assignment.total;
    fit_.sigma_mm = state_.sigma_mm;
    if (options_.report == FitReport::kTube) return std::move(fit_);
    fit_.cost_mm2 = state_.ChiSquare(fit_.sigma_mm, options_) * fit_.sigma_mm * fit_.sigma_mm;
    DesignEffect design_effect;
    design_effect.Add(state_.assignment.segments, state_.Frames(), state_.tube.pipe_radius_mm,
                      kNoWeight * state_.sigma_mm);
    fit_.design_effect = design_effect.Value();
    fit_.direction_effect = design_effect.OfDirections();
    fit_.sides_mm2 = design_effect.SidesMm2();
    SetMeanSquares(state_.assignment.segment_sum_mm2, state_.assignment.segment_count, fit_);
    fit_.segment_used = UsedOf(state_.assignment.segments, fit_.sigma_mm);
    if (options_.report == FitReport::kAll) {
      Linearize();
      Report(state_.Parameters(options_), *equations_, options_, fit_);
    }
    fit_.distances_mm = std::move(state_.assignment.distances_mm);
    return std::move(fit_);
  }

  const SurfaceFitOptions& options_;
  std::span<const PointBlock> blocks_;
  TubeParameters first_;
  FitBounds bounds_;
  SurfaceFit fit_;
  State state_, next_;
  std::optional<NormalEquations> equations_;  // at `state_`
  double damping_ = kFit.first_damping;
  double growth_ = kFit.least_growth;
  int idle_ = 0;
  double pace_mm2_ = 0;
  std::optional<double> last_cost_mm2_;
};

SurfaceFit FitFew(const hal::Tube& start, std::vector<Flattening> flattening,
                  std::span<const PointBlock> blocks, const SurfaceFitOptions& options) {
  return FitOfFew(start, std::move(flattening), blocks, options).Solve();
}

// Whether a step that all points ask for suits a part of them: along what the points hardly feel
// even a step of little gain may be long.
bool IsNoWorse(const TubeParameters& from, const Eigen::VectorXd& at, const Eigen::VectorXd& to,
               std::span<const PointBlock> part, double sigma_mm,
               const SurfaceFitOptions& options) {
  State before, after;
  before.MoveTo(from, at, part, options);
  after.MoveTo(from, to, part, options);
  return after.ChiSquare(sigma_mm, options) <
         before.ChiSquare(sigma_mm, options) + kFit.no_worse * static_cast<double>(at.size());
}

// The same; of very many points a part leads most of the way.
SurfaceFit FitSome(const hal::Tube& start, std::span<const PointBlock> blocks,
                   const SurfaceFitOptions& options) {
  std::vector<Flattening> round(options.flattened ? start.program.bend_count() : 0,
                                {.is_wide = options.wide_plateau, .rise = options.section_rise});
  const std::size_t stride = CountPoints(blocks) / kFit.leading_points;
  if (stride < kFit.leading_stride) return FitFew(start, std::move(round), blocks, options);
  SurfaceFitOptions to_lead = options;
  to_lead.goal_mm2 = std::numeric_limits<double>::infinity();
  to_lead.tolerance = std::max(options.tolerance, kFit.leading_tolerance);
  to_lead.report = FitReport::kTube;
  SurfaceFit fit = FitFew(start, std::move(round), Gathered(blocks, stride), to_lead);
  SurfaceFitOptions from_there = options;
  from_there.easing = fit.easing;
  return FitFew(fit.tube, std::move(fit.flattening), blocks, from_there);
}

// From a solution of a part of the points to that of all, by steps over all of them. `coarse`: the
// part.
void FitMany(std::span<const PointBlock> blocks, std::span<const PointBlock> coarse,
             const SurfaceFitOptions& options, SurfaceFit& fit) {
  fit.converged = false;
  const FitBounds bounds(
      TubeParameters(fit.tube, options.free_pipe_radius, fit.flattening, fit.easing),
      fit.tube.pipe_radius_mm, options.max_length_mm);
  hal::Tube tube = fit.tube;
  std::vector<Flattening> flattening = fit.flattening;
  Easing easing = fit.easing;
  std::optional<NormalEquations> equations;  // at the best tube so far
  double chi_square = 0;
  double sigma_mm = fit.sigma_mm;
  double damping = kFit.no_damping;
  for (int i = 0; i < kFit.full_passes && !fit.converged; ++i) {
    const TubeParameters parameters(tube, options.free_pipe_radius, flattening, easing);
    const EasedSpine spine = SpineOf(tube.program, tube.X_WT, easing);
    const SurfacePass pass =
        PassOverSurface(SegmentFrames(spine, kBeyond * tube.pipe_radius_mm, flattening),
                        tube.pipe_radius_mm, blocks, options.reach_mm, sigma_mm, options.workers);
    const double here = ChiSquareOf(pass, sigma_mm, options) +
                        options.priors.ChiSquare(tube.program, flattening, easing);
    if (!equations || here < chi_square) {
      fit.tube = tube;
      fit.flattening = flattening;
      fit.easing = easing;
      equations.emplace(parameters, spine, pass.sums, options.priors, sigma_mm);
      fit.points = pass.total;
      fit.design_effect = pass.design_effect.Value();
      fit.direction_effect = pass.design_effect.OfDirections();
      fit.sides_mm2 = pass.design_effect.SidesMm2();
      SetMeanSquares(pass.segment_sum_mm2, pass.segment_count, fit);
      fit.segment_used = UsedOf(pass.sums);
      Report(parameters, *equations, options, fit);
      sigma_mm = std::max(options.min_sigma_mm, kMadToSigma * pass.magnitudes.Quantile(0.5));
      fit.sigma_mm = sigma_mm;
      chi_square = ChiSquareOf(pass, sigma_mm, options) +
                   options.priors.ChiSquare(tube.program, flattening, easing);
      damping = std::max(kFit.no_damping, kFit.relief * damping);
    } else {
      damping = 10.0 * std::max(damping, kFit.first_damping);
    }
    const TubeParameters from(fit.tube, options.free_pipe_radius, fit.flattening, fit.easing);
    const Eigen::VectorXd step = BoundedStep(*equations, bounds, damping);
    const Eigen::VectorXd to = equations->at + step;
    tube = from.TubeAt(to);
    flattening = from.FlatteningAt(to);
    easing = from.EasingAt(to);
    fit.converged = step.dot(equations->right) < kFit.little * sigma_mm * sigma_mm;
    if (fit.converged && IsNoWorse(from, equations->at, to, coarse, sigma_mm, options)) {
      fit.tube = tube;
      fit.flattening = flattening;
      fit.easing = easing;
    }
  }
}

}  // namespace

void SetForm(const FormDeviation& form, SurfaceFit& fit) {
  fit.form_mm = form.AcrossMm(fit.tube.pipe_radius_mm);
  fit.variance_mm2 =
      std::max(fit.sigma_mm * fit.sigma_mm * fit.design_effect, LeastVarianceMm2(form, fit));
}

void AssumeForm(const FormDeviation& form, bool free_pipe_radius, SurfaceFit& fit) {
  SetForm(form, fit);
  SetPenalty(TubeParameters(fit.tube, free_pipe_radius, fit.flattening, fit.easing), form, fit);
}

void Widen(const Eigen::MatrixXd& covariance, bool free_pipe_radius, SurfaceFit& fit) {
  const TubeParameters parameters(fit.tube, free_pipe_radius, fit.flattening, fit.easing);
  const Eigen::Index count = std::min<Eigen::Index>(covariance.rows(), parameters.flattening(0));
  fit.covariance.topLeftCorner(count, count) += covariance.topLeftCorner(count, count);
  SetSigmas(parameters, fit);
}

void SetCovariance(Eigen::MatrixXd covariance, bool free_pipe_radius, SurfaceFit& fit) {
  fit.covariance = std::move(covariance);
  SetSigmas(TubeParameters(fit.tube, free_pipe_radius, fit.flattening, fit.easing), fit);
}

// A part of many points leads so near to the solution that all of them hardly need more than one
// step.
SurfaceFit FitSurface(const hal::Tube& start, std::span<const PointBlock> blocks,
                      const SurfaceFitOptions& options) {
  const std::size_t points = CountPoints(blocks);
  if (points <= kPointsAtOnce) return FitSome(start, blocks, options);
  const OwnedBlocks coarse = Thinned(blocks, points / kFit.coarse_points);
  SurfaceFitOptions of_coarse = options;
  of_coarse.report = FitReport::kTube;
  SurfaceFit fit = FitSome(start, coarse, of_coarse);
  for (std::size_t part = kFit.lead * kFit.coarse_points; part < points; part *= kFit.lead) {
    FitMany(Thinned(blocks, points / part), coarse, options, fit);
  }
  FitMany(blocks, coarse, options, fit);
  return fit;
}

}  // namespace bendloop::pipeline
