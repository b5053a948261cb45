// SPDX-License-Identifier: Apache-2.0
#include "pipeline/surface_fit.h"

#include <ceres/ceres.h>

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "pipeline/statistics.h"
#include "pipeline/surface_sums.h"
#include "pipeline/tube_parameters.h"

namespace bendloop::pipeline {
namespace {

constexpr double kDegrees = 180.0 / std::numbers::pi;
// Full weight up to 3.5 sigma, none beyond 5: keeps 99.9 % of the efficiency under normal noise.
constexpr double kFullWeight = 3.5;
constexpr double kNoWeight = 5.0;
constexpr int kLocal = kLocalState;
constexpr int kCondensed = kCondensedRow;
constexpr double kMinAngleRad = 1e-4;
constexpr double kHardly = 0.04;  // of a variance
constexpr std::size_t kCoarsePoints = 10'000;

using Augmented = CondensedSum;
using Row = Eigen::Matrix<double, kCondensed, 1>;

// The points of one segment.
using SegmentPoints = std::vector<WeightedPoint>;

// All residuals at once. The rows of one segment depend on the parameters through the segment's
// eight local coordinates only, so their sum of outer products (9 x 9) says all that least squares
// needs: its root has the same cost, gradient and Gauss-Newton matrix as the many rows.
class SurfaceCost final : public ceres::CostFunction {
 public:
  SurfaceCost(const TubeParameters& parameters, const std::vector<SegmentPoints>& points)
      : parameters_(parameters), points_(points) {
    set_num_residuals(static_cast<int>(points.size()) * kCondensed);
    mutable_parameter_block_sizes()->push_back(parameters.size());
  }

  bool Evaluate(double const* const* blocks, double* residuals, double** jacobians) const override {
    const Eigen::VectorXd at = Eigen::Map<const Eigen::VectorXd>(blocks[0], parameters_.size());
    const hal::Tube tube = parameters_.TubeAt(at);
    const auto segments = hal::SpineSegments(tube.program, tube.X_WT);
    const bool wants_jacobian = jacobians != nullptr && jacobians[0] != nullptr;
    if (!wants_jacobian) {
      // A step is tried: only the cost is asked for, and one residual a segment holds it.
      std::fill_n(residuals, num_residuals(), 0.0);
      for (std::size_t k = 0; k < segments.size(); ++k) {
        residuals[k * kCondensed] =
            std::sqrt(SumOfSquares(points_[k], segments[k], tube.pipe_radius_mm));
      }
      return true;
    }
    const std::vector<Eigen::MatrixXd> derivatives = parameters_.FrameDerivatives(at, segments);
    for (std::size_t k = 0; k < segments.size(); ++k) {
      const Augmented sum = SumOfRows(points_[k], segments[k], tube.pipe_radius_mm);
      // Pivoting, because a line does not feel its own direction and the sum is singular.
      const Eigen::LDLT<Augmented> ldlt(sum);
      Augmented root = ldlt.transpositionsP() * Augmented::Identity();
      root = (ldlt.matrixU() * root).eval();
      root = ldlt.vectorD().cwiseMax(0.0).cwiseSqrt().asDiagonal() * root.eval();
      const auto first = static_cast<Eigen::Index>(k) * kCondensed;
      Eigen::Map<Row>(residuals + first) = root.col(kLocal);
      using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
      Eigen::Map<RowMajor> jacobian(jacobians[0], num_residuals(), parameters_.size());
      jacobian.middleRows<kCondensed>(first) = root.leftCols<kLocal>() * derivatives[k];
    }
    return true;
  }

 private:
  const TubeParameters& parameters_;
  const std::vector<SegmentPoints>& points_;
};

double WeightOf(double distance_mm, double sigma_mm) {
  const double u = std::abs(distance_mm) / sigma_mm;
  if (u <= kFullWeight) return 1.0;
  if (u >= kNoWeight) return 0.0;
  const double fade = (kNoWeight - u) / (kNoWeight - kFullWeight);
  return fade * fade * (3.0 - 2.0 * fade);
}

// Gives every point to the segment whose spine is nearest.
struct Assignment {
  std::vector<SegmentPoints> points;
  std::vector<double> distances_mm;     // of points within reach
  std::vector<std::size_t> block_ends;  // in these
  double cost_mm2 = 0;
  std::vector<double> segment_mean_square_mm2;
  std::size_t used = 0;
  std::size_t total = 0;
  double sigma_mm = 0;
  double design_effect = 1;
};

// How many times more the block means scatter than independent noise would have it: the ratio of
// the mean squares between and within blocks. Pose errors, ovality and dents move neighbours
// together, and n such samples tell less than n independent ones. `ends`: where each block's
// distances end.
double DesignEffect(std::span<const double> distances_mm, std::span<const std::size_t> ends,
                    double limit_mm) {
  double between = 0, within = 0, block_count = 0, freedom = 0;
  std::size_t i = 0;
  for (const std::size_t end : ends) {
    double n = 0, sum = 0, sum2 = 0;
    for (; i < end; ++i) {
      const double d = distances_mm[i];
      if (std::abs(d) > limit_mm) continue;
      n += 1;
      sum += d;
      sum2 += d * d;
    }
    if (n < 2) continue;
    between += sum * sum / n;
    within += sum2 - sum * sum / n;
    block_count += 1;
    freedom += n - 1;
  }
  if (freedom < 1 || within <= 0) return 1.0;
  return std::max(1.0, (between / block_count) / (within / freedom));
}

// Median of |d| for |d| < limit: sorted into drawers first, then within one of them.
double MedianMagnitude(std::span<const double> distances_mm, double limit_mm) {
  constexpr std::size_t kDrawers = 1024;
  const auto drawer_of = [scale = kDrawers / limit_mm](double d) {
    return std::min(kDrawers - 1, static_cast<std::size_t>(std::abs(d) * scale));
  };
  std::array<std::size_t, kDrawers> counts{};
  for (const double d : distances_mm) ++counts[drawer_of(d)];
  if (distances_mm.empty()) return 0.0;
  std::size_t below = 0, drawer = 0;
  const std::size_t middle = distances_mm.size() / 2;
  while (below + counts[drawer] <= middle) below += counts[drawer++];
  std::vector<double> within;
  within.reserve(counts[drawer]);
  for (const double d : distances_mm) {
    if (drawer_of(d) == drawer) within.push_back(std::abs(d));
  }
  const auto place = within.begin() + static_cast<std::ptrdiff_t>(middle - below);
  std::nth_element(within.begin(), place, within.end());
  return *place;
}

// Fills `result`, whose memory is used again from round to round.
void Assign(const hal::Tube& tube, std::span<const PointBlock> blocks, double reach_mm,
            double min_sigma_mm, Assignment& result) {
  const auto frames = SegmentFrames(hal::SpineSegments(tube.program, tube.X_WT));
  result.points.resize(frames.size());
  for (SegmentPoints& points : result.points) points.clear();
  result.distances_mm.clear();
  result.block_ends.clear();
  result.used = result.total = 0;
  std::vector<double> segment_count(frames.size(), 0.0);
  result.segment_mean_square_mm2.assign(frames.size(), 0.0);
  std::vector<std::int32_t> candidates;
  for (const PointBlock& block : blocks) {
    result.total += block.points.size();
    CandidateSegments(block, frames, tube.pipe_radius_mm + reach_mm, candidates);
    if (candidates.empty()) continue;
    for (const Eigen::Vector3d& point : block.points) {
      const NearSegment near = NearestSegment(point, frames, candidates);
      const double d = near.distance_mm - tube.pipe_radius_mm;
      const auto k = static_cast<std::size_t>(near.segment);
      segment_count[k] += 1.0;
      result.segment_mean_square_mm2[k] += std::min(d * d, reach_mm * reach_mm);
      if (std::abs(d) >= reach_mm) continue;
      result.distances_mm.push_back(d);
      result.points[k].push_back({point, d});  // the weight follows when sigma is known
    }
    result.block_ends.push_back(result.distances_mm.size());
  }
  for (std::size_t k = 0; k < frames.size(); ++k) {
    result.segment_mean_square_mm2[k] /= std::max(1.0, segment_count[k]);
  }
  result.sigma_mm = std::max(min_sigma_mm, 1.4826 * MedianMagnitude(result.distances_mm, reach_mm));
  result.design_effect =
      DesignEffect(result.distances_mm, result.block_ends, kNoWeight * result.sigma_mm);
  result.cost_mm2 =
      static_cast<double>(result.total - result.distances_mm.size()) * reach_mm * reach_mm;
  for (const double d : result.distances_mm) result.cost_mm2 += d * d;
  for (SegmentPoints& points : result.points) {
    std::size_t kept = 0;
    for (const WeightedPoint& p : points) {
      const double weight = WeightOf(p.weight, result.sigma_mm);
      if (weight > 0) points[kept++] = {p.point, weight};
    }
    points.resize(kept);
    result.used += kept;
  }
}

// Bounds keep the solution a tube: no negative straights, no angle of nothing, no bend tighter than
// the pipe.
void SetBounds(const TubeParameters& parameters, double pipe_radius_mm, double* x,
               ceres::Problem& problem) {
  const auto bound = [&](int index, double low, double high) {
    x[index] = std::clamp(x[index], low, high);
    problem.SetParameterLowerBound(x, index, low);
    problem.SetParameterUpperBound(x, index, high);
  };
  for (std::size_t i = 0; i < parameters.bends(); ++i) {
    bound(parameters.length(i), 0.0, 1e6);
    bound(parameters.angle(i), kMinAngleRad, 2.0 * std::numbers::pi);
    bound(parameters.bend_radius(i), pipe_radius_mm, 1e4 * pipe_radius_mm);
  }
  if (parameters.pipe_radius() >= 0) {
    bound(parameters.pipe_radius(), 0.5 * pipe_radius_mm, 2.0 * pipe_radius_mm);
  }
}

// sigma^2 (J^T J)^-1, with directions that no point feels (a straight's roll) left out.
Eigen::VectorXd StandardErrors(const TubeParameters& parameters, const Eigen::VectorXd& at,
                               const Assignment& assignment) {
  const hal::Tube tube = parameters.TubeAt(at);
  const auto segments = hal::SpineSegments(tube.program, tube.X_WT);
  const auto derivatives = parameters.FrameDerivatives(at, segments);
  Eigen::MatrixXd information = Eigen::MatrixXd::Zero(parameters.size(), parameters.size());
  double sum_d2 = 0;
  double sum_weight = 0;
  for (std::size_t k = 0; k < segments.size(); ++k) {
    const Augmented sum = SumOfRows(assignment.points[k], segments[k], tube.pipe_radius_mm);
    information.noalias() +=
        derivatives[k].transpose() * sum.topLeftCorner<kLocal, kLocal>() * derivatives[k];
    sum_d2 += sum(kLocal, kLocal);
    for (const auto& p : assignment.points[k]) sum_weight += p.weight;
  }
  const double freedom = std::max(1.0, sum_weight - parameters.size());
  const double variance = assignment.design_effect * sum_d2 / freedom;
  Eigen::VectorXd scale = information.diagonal().cwiseSqrt();
  for (double& s : scale) s = s > 0 ? 1.0 / s : 0.0;
  const Eigen::MatrixXd scaled = scale.asDiagonal() * information * scale.asDiagonal();
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(scaled);
  Eigen::VectorXd inverse = eigen.eigenvalues();
  for (double& value : inverse) value = value > 1e-14 ? 1.0 / value : 0.0;
  const Eigen::MatrixXd covariance =
      eigen.eigenvectors() * inverse.asDiagonal() * eigen.eigenvectors().transpose();
  return (scale.array().square() * covariance.diagonal().array() * variance).sqrt();
}

std::size_t CoarseStride(std::span<const PointBlock> blocks) {
  const std::size_t points = CountPoints(blocks);
  return points > 4 * kCoarsePoints ? points / kCoarsePoints : 1;
}

}  // namespace

SurfaceFit FitSurface(const hal::Tube& start, std::span<const PointBlock> blocks,
                      const SurfaceFitOptions& options) {
  SurfaceFit fit;
  fit.tube = start;
  if (const std::size_t stride = CoarseStride(blocks); stride > 1) {
    // A part of many points leads so near to the solution that all of them need few rounds.
    fit.tube = FitSurface(start, Thinned(blocks, stride), options).tube;
  }
  const double reach_mm = options.reach_mm;
  double last_cost = -1;
  Assignment assignment;
  bool fresh = false;
  for (int round = 0; round < options.max_rounds; ++round) {
    Assign(fit.tube, blocks, reach_mm, options.min_sigma_mm, assignment);
    if (assignment.used < 10) break;
    const bool settled =
        last_cost >= 0 && std::abs(assignment.cost_mm2 - last_cost) <= 1e-4 * last_cost;
    last_cost = assignment.cost_mm2;

    const TubeParameters parameters(fit.tube, options.free_pipe_radius);
    Eigen::VectorXd x = parameters.Initial();
    ceres::Problem problem;
    problem.AddParameterBlock(x.data(), parameters.size());
    SetBounds(parameters, fit.tube.pipe_radius_mm, x.data(), problem);
    problem.AddResidualBlock(new SurfaceCost(parameters, assignment.points), nullptr, x.data());
    ceres::Solver::Options solver;
    solver.linear_solver_type = ceres::DENSE_QR;
    solver.max_num_iterations = options.max_iterations;
    solver.function_tolerance = 1e-7;
    solver.parameter_tolerance = 1e-9;
    solver.logging_type = ceres::SILENT;
    solver.num_threads = 1;
    ceres::Solver::Summary summary;
    ceres::Solve(solver, &problem, &summary);
    if (!x.allFinite()) break;
    fit.tube = parameters.TubeAt(x);
    fit.converged = summary.termination_type == ceres::CONVERGENCE;
    // When twice the logarithm of the likelihood hardly grew, the tube moved by less than a fifth
    // of a standard error: the assignment is as good as a fresh one.
    const double gain = (summary.initial_cost - summary.final_cost) *
                        static_cast<double>(assignment.used) / summary.initial_cost;
    fresh = gain < kHardly;
    if (settled || fresh) break;
  }

  if (!fresh) Assign(fit.tube, blocks, options.reach_mm, options.min_sigma_mm, assignment);
  fit.sigma_mm = assignment.sigma_mm;
  fit.design_effect = assignment.design_effect;
  fit.distances_mm = assignment.distances_mm;
  fit.segment_mean_square_mm2 = assignment.segment_mean_square_mm2;
  fit.used = assignment.used;
  fit.points = assignment.total;
  const TubeParameters parameters(fit.tube, options.free_pipe_radius);
  fit.parameters = parameters.size();
  const Eigen::VectorXd sigma = StandardErrors(parameters, parameters.Initial(), assignment);
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
  return fit;
}

}  // namespace bendloop::pipeline
