// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/surface_fit.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>

#include "hal/spine.h"
#include "pipeline/fit/normal_equations.h"
#include "pipeline/fit/surface_pass.h"
#include "pipeline/fit/surface_sums.h"
#include "pipeline/fit/tube_parameters.h"
#include "pipeline/math/magnitude_histogram.h"

namespace bendloop::pipeline {
namespace {

constexpr double kDegrees = 180.0 / std::numbers::pi;
constexpr double kMadToSigma = 1.4826;
// Steps that make chi square less by less than this, a tenth of a standard error long, are the
// last.
constexpr double kHardly = 0.03;
constexpr double kFirstDamping = 1e-4;  // of the normal matrix's diagonal
constexpr double kNoDamping = 1e-10;
constexpr double kLeastDamping = 1e-8;  // that is felt
constexpr double kFurther = 8;          // times the last step's gain may still come
constexpr int kMaxIdle = 2;             // steps without a gain
constexpr double kLeastGrowth = 4;      // of the damping after a step that was in vain
constexpr double kMostDamping = 1e6;
// A step over all points leaves less than a thousandth of what it made chi square less by. The
// solution of one of ten of the points leaves 9 a parameter.
constexpr double kLittle = 300;
constexpr std::size_t kLead = 10;
// What all points ask for makes chi square of a part worse by one a parameter, or a few.
constexpr double kNoWorse = 4;
constexpr int kFullPasses = 8;
constexpr std::size_t kCoarsePoints = 10'000;
constexpr std::size_t kLeadingPoints = 2500;
constexpr std::size_t kLeadingStride = 4;  // at least; a start near the solution loses by it
constexpr double kLeadingTolerance = 1e-4;
constexpr std::size_t kFewPoints = 10;

// Where a fit stands: a tube and what the points say of it.
struct State {
  hal::Tube tube;
  std::vector<Flattening> flattening;
  std::vector<hal::SpineSegment> segments;
  SurfaceAssignment assignment;
  double sigma_mm = 0;

  TubeParameters Parameters(const SurfaceFitOptions& options) const {
    return {tube, options.free_pipe_radius, flattening};
  }
  std::vector<SegmentFrame> Frames() const {
    return SegmentFrames(segments, kBeyond * tube.pipe_radius_mm, flattening);
  }
  void MoveTo(const TubeParameters& parameters, const Eigen::VectorXd& to,
              std::span<const PointBlock> blocks, const SurfaceFitOptions& options) {
    tube = parameters.TubeAt(to);
    flattening = parameters.FlatteningAt(to);
    segments = hal::SpineSegments(tube.program, tube.X_WT);
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
           options.priors.ChiSquare(tube.program, flattening);
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

void Report(const TubeParameters& parameters, const NormalEquations& equations,
            const FormDeviation& form, SurfaceFit& fit) {
  fit.used = static_cast<std::size_t>(equations.weight + 0.5);
  SetForm(form, fit);
  fit.learnt = fit.priors.Learnt(
      parameters, fit.tube, equations.matrix,
      std::max(equations.Variance() * fit.design_effect, LeastVarianceMm2(form, fit)));
  fit.covariance = equations.Covariance(parameters, fit.tube, fit.design_effect);
  const Eigen::MatrixXd& covariance = fit.covariance;
  const Eigen::VectorXd sigma = covariance.diagonal().cwiseMax(0.0).cwiseSqrt();
  if (parameters.pipe_radius() >= 0) fit.pipe_radius_sigma_mm = sigma[parameters.pipe_radius()];
  fit.sigma = fit.tube.program;
  for (std::size_t i = 0; i < fit.sigma.rows.size(); ++i) {
    hal::BendRow& row = fit.sigma.rows[i];
    row = {0, 0, 0, std::nullopt};
    if (i >= parameters.bends()) continue;
    row.length_mm = sigma[parameters.length(i)];
    if (i > 0) row.rotation_deg = sigma[parameters.rotation(i)] * kDegrees;
    row.angle_deg = sigma[parameters.angle(i)] * kDegrees;
    row.bend_radius_mm = sigma[parameters.bend_radius(i)];
  }
  fit.flattening_sigma.clear();
  for (std::size_t i = 0; i < fit.flattening.size(); ++i) {
    const Eigen::Matrix3d of_bend = covariance.block<kFlatteningParameters, kFlatteningParameters>(
        parameters.flattening(i), parameters.flattening(i));
    const auto sigma_of = [&of_bend](const Eigen::Vector3d& weights) {
      return std::sqrt(std::max(0.0, weights.dot(of_bend * weights)));
    };
    fit.flattening_sigma.push_back({sigma_of({1, 1, 0.5}), sigma_of({0.5, 0.5, 1})});
  }
  // The last length is from its border to where the last bend ends, which the fit knows so well.
  fit.last_start = equations.last_start;
  fit.sigma.rows.back().length_mm =
      std::sqrt(std::max(0.0, fit.last_start.dot(covariance * fit.last_start)));
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
// every step. `flattening`: where it starts.
SurfaceFit FitFew(const hal::Tube& start, std::vector<Flattening> flattening,
                  std::span<const PointBlock> blocks, const SurfaceFitOptions& options) {
  SurfaceFit fit;
  fit.tube = start;
  fit.priors = options.priors;
  State state, next;
  state.tube = start;
  state.flattening = std::move(flattening);
  const TubeParameters first = state.Parameters(options);
  const FitBounds bounds(first, start.pipe_radius_mm, options.max_length_mm);
  state.MoveTo(first, bounds.Inside(first.Initial()), blocks, options);
  double damping = kFirstDamping;
  double growth = kLeastGrowth;
  int idle = 0;
  double last_cost_mm2 = 0, pace_mm2 = 0;
  std::optional<NormalEquations> equations;
  for (int i = 0; state.assignment.distances_mm.size() >= kFewPoints; ++i) {
    const TubeParameters parameters = state.Parameters(options);
    if (!equations) {
      equations.emplace(parameters, state.segments, state.Sums(), options.priors, state.sigma_mm);
    }
    fit.tube = state.tube;
    fit.flattening = state.flattening;
    if (i >= options.max_steps || damping > kMostDamping) break;
    const double chi_square = state.ChiSquare(state.sigma_mm, options);
    const double hardly_mm2 =
        std::max(kHardly, options.tolerance * chi_square) * state.sigma_mm * state.sigma_mm;
    Eigen::VectorXd step = BoundedStep(*equations, bounds, damping);
    if (step.dot(equations->right) < hardly_mm2) {
      const Eigen::VectorXd undamped = BoundedStep(*equations, bounds, kNoDamping);
      fit.converged = undamped.dot(equations->right) < hardly_mm2;
      if (fit.converged) step = undamped;
    }
    const Eigen::VectorXd moved = equations->at + step;
    const double cost_mm2 = chi_square * state.sigma_mm * state.sigma_mm;
    pace_mm2 = i == 0 ? cost_mm2 : std::max(0.5 * pace_mm2, last_cost_mm2 - cost_mm2);
    last_cost_mm2 = cost_mm2;
    if (cost_mm2 - options.goal_mm2 > kFurther * pace_mm2) break;
    // Points that change their segment make steps fail that are much shorter than the noise.
    idle = step.dot(equations->right) < hardly_mm2 ? idle + 1 : 0;
    if (idle > kMaxIdle) break;
    next.MoveTo(parameters, moved, blocks, options);
    const bool better = next.ChiSquare(state.sigma_mm, options) < chi_square;
    if (fit.converged && better) {
      fit.tube = next.tube;
      fit.flattening = next.flattening;
    }
    if (fit.converged) break;
    if (better) {
      std::swap(state, next);
      equations.reset();
      damping = std::max(kNoDamping, 0.1 * damping);
      growth = kLeastGrowth;
    } else {
      damping = growth * std::max(damping, kLeastDamping);
      growth *= kLeastGrowth;
    }
  }
  fit.points = state.assignment.total;
  fit.sigma_mm = state.sigma_mm;
  fit.cost_mm2 = state.ChiSquare(fit.sigma_mm, options) * fit.sigma_mm * fit.sigma_mm;
  DesignEffect design_effect;
  design_effect.Add(state.assignment.segments, state.Frames(), state.tube.pipe_radius_mm,
                    kNoWeight * state.sigma_mm);
  fit.design_effect = design_effect.Value();
  SetMeanSquares(state.assignment.segment_sum_mm2, state.assignment.segment_count, fit);
  const TubeParameters parameters = state.Parameters(options);
  if (!equations)
    equations.emplace(parameters, state.segments, state.Sums(), options.priors, state.sigma_mm);
  Report(parameters, *equations, options.form, fit);
  fit.distances_mm = std::move(state.assignment.distances_mm);
  return fit;
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
         before.ChiSquare(sigma_mm, options) + kNoWorse * static_cast<double>(at.size());
}

// The same; of very many points a part leads most of the way.
SurfaceFit FitSome(const hal::Tube& start, std::span<const PointBlock> blocks,
                   const SurfaceFitOptions& options) {
  std::vector<Flattening> round(options.flattened ? start.program.bend_count() : 0);
  const std::size_t stride = CountPoints(blocks) / kLeadingPoints;
  if (stride < kLeadingStride) return FitFew(start, std::move(round), blocks, options);
  SurfaceFitOptions to_lead = options;
  to_lead.goal_mm2 = std::numeric_limits<double>::infinity();
  to_lead.tolerance = std::max(options.tolerance, kLeadingTolerance);
  SurfaceFit fit = FitFew(start, std::move(round), Gathered(blocks, stride), to_lead);
  return FitFew(fit.tube, std::move(fit.flattening), blocks, options);
}

// From a solution of a part of the points to that of all, by steps over all of them. `coarse`: the
// part.
void FitMany(std::span<const PointBlock> blocks, std::span<const PointBlock> coarse,
             const SurfaceFitOptions& options, SurfaceFit& fit) {
  fit.converged = false;
  const FitBounds bounds(TubeParameters(fit.tube, options.free_pipe_radius, fit.flattening),
                         fit.tube.pipe_radius_mm, options.max_length_mm);
  hal::Tube tube = fit.tube;
  std::vector<Flattening> flattening = fit.flattening;
  std::optional<NormalEquations> equations;  // at the best tube so far
  double chi_square = 0;
  double sigma_mm = fit.sigma_mm;
  double damping = kNoDamping;
  for (int i = 0; i < kFullPasses && !fit.converged; ++i) {
    const TubeParameters parameters(tube, options.free_pipe_radius, flattening);
    const auto segments = hal::SpineSegments(tube.program, tube.X_WT);
    const SurfacePass pass =
        PassOverSurface(SegmentFrames(segments, kBeyond * tube.pipe_radius_mm, flattening),
                        tube.pipe_radius_mm, blocks, options.reach_mm, sigma_mm, options.workers);
    const double here =
        ChiSquareOf(pass, sigma_mm, options) + options.priors.ChiSquare(tube.program, flattening);
    if (!equations || here < chi_square) {
      fit.tube = tube;
      fit.flattening = flattening;
      equations.emplace(parameters, segments, pass.sums, options.priors, sigma_mm);
      fit.points = pass.total;
      fit.design_effect = pass.design_effect.Value();
      SetMeanSquares(pass.segment_sum_mm2, pass.segment_count, fit);
      Report(parameters, *equations, options.form, fit);
      sigma_mm = std::max(options.min_sigma_mm, kMadToSigma * pass.magnitudes.Quantile(0.5));
      fit.sigma_mm = sigma_mm;
      chi_square =
          ChiSquareOf(pass, sigma_mm, options) + options.priors.ChiSquare(tube.program, flattening);
      damping = std::max(kNoDamping, 0.1 * damping);
    } else {
      damping = 10.0 * std::max(damping, kFirstDamping);
    }
    const TubeParameters from(fit.tube, options.free_pipe_radius, fit.flattening);
    const Eigen::VectorXd step = BoundedStep(*equations, bounds, damping);
    const Eigen::VectorXd to = equations->at + step;
    tube = from.TubeAt(to);
    flattening = from.FlatteningAt(to);
    fit.converged = step.dot(equations->right) < kLittle * sigma_mm * sigma_mm;
    if (fit.converged && IsNoWorse(from, equations->at, to, coarse, sigma_mm, options)) {
      fit.tube = tube;
      fit.flattening = flattening;
    }
  }
}

}  // namespace

void SetForm(const FormDeviation& form, SurfaceFit& fit) {
  fit.form_mm = form.AcrossMm(fit.tube.pipe_radius_mm);
  fit.variance_mm2 =
      std::max(fit.sigma_mm * fit.sigma_mm * fit.design_effect, LeastVarianceMm2(form, fit));
}

// A part of many points leads so near to the solution that all of them hardly need more than one
// step.
SurfaceFit FitSurface(const hal::Tube& start, std::span<const PointBlock> blocks,
                      const SurfaceFitOptions& options) {
  const std::size_t points = CountPoints(blocks);
  if (points <= kPointsAtOnce) return FitSome(start, blocks, options);
  const OwnedBlocks coarse = Thinned(blocks, points / kCoarsePoints);
  SurfaceFit fit = FitSome(start, coarse, options);
  fit.distances_mm.clear();
  for (std::size_t part = kLead * kCoarsePoints; part < points; part *= kLead) {
    FitMany(Thinned(blocks, points / part), coarse, options, fit);
  }
  FitMany(blocks, coarse, options, fit);
  return fit;
}

}  // namespace bendloop::pipeline
