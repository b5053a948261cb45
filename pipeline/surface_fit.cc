// SPDX-License-Identifier: Apache-2.0
#include "pipeline/surface_fit.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>

#include "pipeline/magnitude_histogram.h"
#include "pipeline/surface_pass.h"
#include "pipeline/surface_sums.h"
#include "pipeline/tube_parameters.h"

namespace bendloop::pipeline {
namespace {

constexpr double kDegrees = 180.0 / std::numbers::pi;
constexpr double kMadToSigma = 1.4826;
constexpr double kMaxTurnBackRad = 0.5;  // a slight bend may turn over to the other side
constexpr double kMaxStepRad = 1.0;      // where samples hardly feel an angle, linear means nothing
constexpr double kWidestBend = 100.0;    // pipe radii
constexpr double kTightest = 0.01;
constexpr double kMaxFlattening = 0.4;
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
// A step over all points leaves less than a thousandth of what it made chi square less by.
constexpr double kLittle = 30;
constexpr int kFullPasses = 8;
constexpr std::size_t kCoarsePoints = 10'000;
constexpr std::size_t kFewPoints = 10;

// The least squares around a tube. The rows of one segment depend on the parameters through the
// segment's eight local coordinates only, so their sum of outer products (9 x 9) says all that is
// needed of its points.
struct NormalEquations {
  NormalEquations(const TubeParameters& parameters, const std::vector<hal::SpineSegment>& segments,
                  std::span<const CondensedSum> sums, const FitPriors& priors, double sigma_mm)
      : at(parameters.Initial()),
        matrix(Eigen::MatrixXd::Zero(parameters.size(), parameters.size())),
        right(Eigen::VectorXd::Zero(parameters.size())) {
    const auto derivatives = parameters.FrameDerivatives(segments);
    for (std::size_t k = 0; k < segments.size(); ++k) {
      const Eigen::Matrix<double, kLocalState, Eigen::Dynamic> weighted =
          sums[k].topLeftCorner<kLocalState, kLocalState>() * derivatives[k];
      matrix.noalias() += derivatives[k].transpose() * weighted;
      right.noalias() -= derivatives[k].transpose() * sums[k].col(kLocalState).head<kLocalState>();
      squares_mm2 += sums[k](kLocalState, kLocalState);
      weight += sums[k](kPipeRadiusState, kPipeRadiusState);
    }
    priors.Add(parameters, at, sigma_mm, matrix, right);
    last_start = derivatives.back().row(0);
    scale = matrix.diagonal().cwiseSqrt();
    for (double& s : scale) s = s > 0 ? 1.0 / s : 0.0;
    scaled = scale.asDiagonal() * matrix * scale.asDiagonal();
    for (Eigen::Index i = 0; i < scale.size(); ++i) {
      if (scale[i] == 0) scaled(i, i) = 1.0;  // no point feels it: it stays
    }
  }

  double Variance() const {  // of a point
    return squares_mm2 / std::max(1.0, weight - static_cast<double>(right.size()));
  }

  Eigen::VectorXd at;
  Eigen::MatrixXd matrix, scaled;  // with a diagonal of ones
  Eigen::VectorXd right, scale;
  Eigen::VectorXd last_start;  // derivative of where the last straight begins, along it
  double squares_mm2 = 0;      // weighted
  double weight = 0;
};

// The solution stays a tube: no negative straights, no angle of nothing, no bend tighter than the
// pipe. (A bend that begins as a tighter one may stay so: making it wider would move all that comes
// after it away from the points.)
struct Bounds {
  Bounds(const TubeParameters& parameters, double pipe_radius_mm, double max_length_mm)
      : low(Eigen::VectorXd::Constant(parameters.size(), -1e9)),
        high(Eigen::VectorXd::Constant(parameters.size(), 1e9)),
        step(Eigen::VectorXd::Constant(parameters.size(), max_length_mm)) {
    const auto bound = [&](int index, double from, double to) {
      low[index] = from;
      high[index] = to;
    };
    for (std::size_t i = 0; i < parameters.bends(); ++i) {
      bound(parameters.length(i), 0.0, max_length_mm);
      bound(parameters.angle(i), -kMaxTurnBackRad, 2.0 * std::numbers::pi);
      step[parameters.angle(i)] = kMaxStepRad;
      if (i > 0) step[parameters.rotation(i)] = kMaxStepRad;
      const int radius = parameters.bend_radius(i);
      bound(radius,
            std::clamp(parameters.Initial()[radius], kTightest * pipe_radius_mm, pipe_radius_mm),
            kWidestBend * pipe_radius_mm);
    }
    if (parameters.pipe_radius() >= 0) {
      bound(parameters.pipe_radius(), 0.5 * pipe_radius_mm, 2.0 * pipe_radius_mm);
    }
    for (int i = parameters.flattened() ? parameters.flattening(0) : parameters.size();
         i < parameters.size(); ++i) {
      bound(i, -kMaxFlattening, kMaxFlattening);
    }
  }
  Eigen::VectorXd Inside(const Eigen::VectorXd& x) const { return x.cwiseMax(low).cwiseMin(high); }

  double Lowest(Eigen::Index i, double at) const { return std::max(low[i], at - step[i]); }
  double Highest(Eigen::Index i, double at) const { return std::min(high[i], at + step[i]); }

  Eigen::VectorXd low, high;
  Eigen::VectorXd step;  // the longest at a time
};

// The damped Gauss-Newton step within bounds: what would leave them goes as far as they are, and
// the others are solved for again.
Eigen::VectorXd BoundedStep(const NormalEquations& equations, const Bounds& bounds,
                            double damping) {
  const Eigen::Index size = equations.right.size();
  Eigen::VectorXd step = Eigen::VectorXd::Zero(size);  // in units of `scale`
  std::vector<bool> held(static_cast<std::size_t>(size), false);
  const auto is_held = [&held](Eigen::Index i) { return held[static_cast<std::size_t>(i)]; };
  Eigen::MatrixXd matrix;
  Eigen::VectorXd right;
  for (Eigen::Index round = 0; round < size; ++round) {
    matrix = equations.scaled;
    matrix.diagonal().array() += damping;
    right = equations.scale.asDiagonal() * equations.right;
    for (Eigen::Index i = 0; i < size; ++i) {
      if (!is_held(i)) continue;
      right -= step[i] * matrix.col(i);
    }
    for (Eigen::Index i = 0; i < size; ++i) {
      if (!is_held(i)) continue;
      matrix.row(i).setZero();
      matrix.col(i).setZero();
      matrix(i, i) = 1.0;
      right[i] = step[i];
    }
    const Eigen::VectorXd solved = matrix.ldlt().solve(right);
    if (!solved.allFinite()) return Eigen::VectorXd::Zero(size);
    bool again = false;
    for (Eigen::Index i = 0; i < size; ++i) {
      if (is_held(i)) continue;
      step[i] = solved[i];
      if (equations.scale[i] <= 0) continue;
      const double at = equations.at[i];
      const double to = at + equations.scale[i] * step[i];
      const double low = bounds.Lowest(i, at), high = bounds.Highest(i, at);
      if (to >= low && to <= high) continue;
      step[i] = (std::clamp(to, low, high) - at) / equations.scale[i];
      held[static_cast<std::size_t>(i)] = true;
      again = true;
    }
    if (!again) break;
  }
  return equations.scale.asDiagonal() * step;
}

// sigma^2 (J^T J)^-1. What the points do not tell (the radius of a bend that nobody sees) is as
// vague as before they were looked at; what moves no point at all (a straight's roll) is left out.
Eigen::MatrixXd Covariance(const NormalEquations& equations, const TubeParameters& parameters,
                           const hal::Tube& tube, double design_effect) {
  const Eigen::Index size = equations.right.size();
  const double variance = design_effect * equations.Variance();
  Eigen::VectorXd range = ExpectedRange(parameters, tube.pipe_radius_mm);
  for (std::size_t bend = 0; bend < parameters.bends(); ++bend) {
    double& of_radius = range[parameters.bend_radius(bend)];
    of_radius = std::hypot(of_radius, equations.at[parameters.bend_radius(bend)]);
  }
  Eigen::MatrixXd matrix = equations.scaled;
  matrix.diagonal() += variance * equations.scale.cwiseQuotient(range).cwiseAbs2();
  const Eigen::MatrixXd inverse = matrix.ldlt().solve(Eigen::MatrixXd::Identity(size, size));
  return variance * equations.scale.asDiagonal() * inverse * equations.scale.asDiagonal();
}

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

void Report(const TubeParameters& parameters, const NormalEquations& equations, SurfaceFit& fit) {
  const double variance_mm2 = equations.Variance() * fit.design_effect;
  fit.learnt = fit.priors.Learnt(parameters, fit.tube, equations.matrix, variance_mm2);
  fit.used = static_cast<std::size_t>(equations.weight + 0.5);
  fit.covariance = Covariance(equations, parameters, fit.tube, fit.design_effect);
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
// every step.
SurfaceFit FitFew(const hal::Tube& start, std::span<const PointBlock> blocks,
                  const SurfaceFitOptions& options) {
  SurfaceFit fit;
  fit.tube = start;
  fit.priors = options.priors;
  State state, next;
  state.tube = start;
  if (options.flattened) state.flattening.resize(start.program.bend_count());
  const TubeParameters first = state.Parameters(options);
  const Bounds bounds(first, start.pipe_radius_mm, options.max_length_mm);
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
  design_effect.Add(state.assignment, state.Frames(), state.tube.pipe_radius_mm,
                    kNoWeight * state.sigma_mm);
  fit.design_effect = design_effect.Value();
  SetMeanSquares(state.assignment.segment_sum_mm2, state.assignment.segment_count, fit);
  const TubeParameters parameters = state.Parameters(options);
  if (!equations)
    equations.emplace(parameters, state.segments, state.Sums(), options.priors, state.sigma_mm);
  Report(parameters, *equations, fit);
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
  return after.ChiSquare(sigma_mm, options) < before.ChiSquare(sigma_mm, options) + kLittle;
}

}  // namespace

// A part of many points leads so near to the solution that all of them hardly need more than one
// step.
SurfaceFit FitSurface(const hal::Tube& start, std::span<const PointBlock> blocks,
                      const SurfaceFitOptions& options) {
  const std::size_t points = CountPoints(blocks);
  if (points <= kPointsAtOnce) return FitFew(start, blocks, options);
  const OwnedBlocks coarse = Thinned(blocks, points / kCoarsePoints);
  SurfaceFit fit = FitFew(start, coarse, options);
  fit.distances_mm.clear();
  fit.converged = false;
  const Bounds bounds(TubeParameters(fit.tube, options.free_pipe_radius, fit.flattening),
                      start.pipe_radius_mm, options.max_length_mm);
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
      Report(parameters, *equations, fit);
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
  return fit;
}

}  // namespace bendloop::pipeline
