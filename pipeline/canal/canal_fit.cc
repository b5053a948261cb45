// SPDX-License-Identifier: Apache-2.0
#include "pipeline/canal/canal_fit.h"

#include <ceres/ceres.h>

#include <Eigen/Dense>
#include <Eigen/Sparse>
#include <Eigen/SparseCholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "pipeline/canal/canal_cost.h"
#include "pipeline/canal/canal_feet.h"
#include "pipeline/canal/span_sums.h"
#include "pipeline/math/quantiles.h"

namespace bendloop::pipeline {
namespace {

using Sparse = Eigen::SparseMatrix<double>;
using Cholesky = Eigen::SimplicialLDLT<Sparse>;

// What the fit goes by. Lengths are parts of the pipe radius; weights are parts of the points' own,
// so that they mean the same for any number of points.
struct CanalFitSettings {
  // Knot spacings that are tried, from coarse to fine; a half resolves the ripple of one radius.
  std::array<double, 5> knot_spacings = {8, 4, 2, 1, 0.5};
  int most_spans = 4000;
  // Fewer points for each unknown would be followed, not averaged.
  double points_of_unknown = 1.5;
  // So many points choose the knots; the last fit takes all.
  std::size_t points_for_knots = 10'000;
  // Further points say nothing; further still while the surface is not yet in its place.
  double reach = 0.3, wide_reach = 0.5;
  // [sigma] Tukey's cut-off: 4.685 has 95 % of the efficiency on normal noise; a little more.
  double cut_sigmas = 5.0;
  // The least sigma that is believed: noise-free points are points too.
  double least_sigma = 1e-5;
  // Of third differences: enough for spans without points, nothing that spans with points feel.
  double smoothing = 1e-3;
  // Of moves along the spine, where they change nothing but the knots.
  double holding_along = 5e-3;
  // Times that sigma, and with it the weights, is worked out again; of these with the wide reach.
  int rounds = 10, wide_rounds = 2;
  // Levenberg-Marquardt's steps between.
  int steps_of_round = 4;
  // The part of it that sigma changes in the last round.
  double settled = 1e-4;
  int stations = 40;  // along the spine, where sigmas are asked for
};
constexpr CanalFitSettings kFit;

// Positions of the unknowns: x, y, z of each control point, and its radius or one for all.
struct Layout {
  int controls;
  bool varying;
  int size() const { return varying ? 4 * controls : 3 * controls + 1; }
  int operator()(int control, int k) const {
    if (varying) return 4 * control + k;
    return k < 3 ? 3 * control + k : 3 * controls;
  }
  bool IsRadius(int unknown) const { return varying ? unknown % 4 == 3 : unknown == 3 * controls; }
};

// The information on all unknowns, for covariances.
Sparse InformationOf(const CanalDistances& distances, const Layout& layout) {
  std::vector<Eigen::Triplet<double>> entries;
  const double per_control = distances.weight() / layout.controls;
  for (std::size_t s = 0; s < distances.spans().size(); ++s) {
    for (int i = 0; i < SpanSums::kUnknowns; ++i) {
      for (int j = 0; j < SpanSums::kUnknowns; ++j) {
        entries.emplace_back(layout(static_cast<int>(s) + i / 4, i % 4),
                             layout(static_cast<int>(s) + j / 4, j % 4),
                             distances.spans()[s].matrix(i, j));
      }
    }
  }
  const Eigen::Vector4d third(-1, 3, -3, 1);
  const Eigen::Matrix4d smoothing = kFit.smoothing * per_control * third * third.transpose();
  for (int c = 0; c + 3 < layout.controls; ++c) {
    for (int k = 0; k < (layout.varying ? 4 : 3); ++k) {
      for (int a = 0; a < 4; ++a) {
        for (int b = 0; b < 4; ++b) {
          entries.emplace_back(layout(c + a, k), layout(c + b, k), smoothing(a, b));
        }
      }
    }
  }
  // Solvable, whatever the points leave open.
  for (int i = 0; i < layout.size(); ++i) entries.emplace_back(i, i, 1e-9 * per_control + 1e-12);
  Sparse matrix(layout.size(), layout.size());
  matrix.setFromTriplets(entries.begin(), entries.end());
  return matrix;
}

// Least squares with Ceres. The points' feet follow the surface at every step, so that Ceres sees
// the true distances and their sums.
class Fitter final : public ceres::EvaluationCallback {
 public:
  Fitter(CanalSurface start, std::span<const Eigen::Vector3d> points,
         const CanalFitOptions& options)
      : surface_(std::move(start)),
        options_(options),
        layout_{static_cast<int>(surface_.control().size()), options.varying_radius},
        distances_(points, {}) {
    if (!options.varying_radius) {
      double mean_mm = 0;
      for (const Eigen::Vector4d& c : surface_.control()) mean_mm += c[3] / layout_.controls;
      surface_.control().front()[3] = mean_mm;
      ShareRadius();
    }
    distances_ =
        CanalDistances(points, FindFeet(surface_, points, options.radius_mm, kFit.wide_reach));
  }

  CanalFit Run() {
    for (int round = 0; round < kFit.rounds; ++round) {
      const double before_mm = sigma_mm_;
      Weigh(round < kFit.wide_rounds ? kFit.wide_reach : kFit.reach);
      if (round > kFit.wide_rounds && std::abs(sigma_mm_ - before_mm) < kFit.settled * sigma_mm_) {
        break;
      }
      if (distances_.weight() > 0) Minimise();
    }
    Weigh(kFit.reach);
    return Result();
  }

  // Standard deviations, at the surface that Run left.
  void Describe(CanalFit& fit) const;

  void PrepareForEvaluation(bool /*evaluate_jacobians*/, bool new_evaluation_point) override {
    if (!new_evaluation_point) return;
    ShareRadius();
    if (surface_.control() == summed_) return;
    distances_.Follow(surface_);
    Sum();
  }

 private:
  // One radius for all control points: the first has the unknown.
  void ShareRadius() {
    if (options_.varying_radius) return;
    for (Eigen::Vector4d& c : surface_.control()) c[3] = surface_.control().front()[3];
  }

  void Weigh(double reach) {
    const double reach_mm = reach * options_.radius_mm;
    sigma_mm_ = std::max(distances_.SigmaMm(reach_mm), kFit.least_sigma * options_.radius_mm);
    cut_mm_ = std::min(kFit.cut_sigmas * sigma_mm_, reach_mm);
    Sum();
  }

  void Sum() {
    distances_.Sum(surface_, cut_mm_);
    summed_ = surface_.control();
  }

  void Minimise() {
    ceres::Problem::Options problem_options;
    problem_options.evaluation_callback = this;
    ceres::Problem problem(problem_options);
    AddSpans(problem);
    AddSmoothing(problem);
    ceres::Solver::Options options;
    options.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
    // CHOLMOD would bring the threads of its BLAS.
    options.sparse_linear_algebra_library_type = ceres::EIGEN_SPARSE;
    options.num_threads = 1;
    options.max_num_iterations = kFit.steps_of_round;
    options.function_tolerance = kFit.settled;
    options.logging_type = ceres::SILENT;
    ceres::Solver::Summary summary;
    ceres::Solve(options, &problem, &summary);
    // Ceres leaves the best unknowns, which need not be those it asked about last.
    PrepareForEvaluation(false, true);
  }

  void AddSpans(ceres::Problem& problem) {
    auto& control = surface_.control();
    for (std::size_t s = 0; s < distances_.spans().size(); ++s) {
      std::vector<double*> unknowns;
      for (std::size_t a = 0; a < 4; ++a) unknowns.push_back(control[s + a].data());
      for (std::size_t a = 0; a < 4 && layout_.varying; ++a) {
        unknowns.push_back(control[s + a].data() + 3);
      }
      if (!layout_.varying) unknowns.push_back(control.front().data() + 3);
      problem.AddResidualBlock(new SpanCost(distances_.spans(), s, layout_.varying), nullptr,
                               unknowns);
    }
  }

  void AddSmoothing(ceres::Problem& problem) {
    auto& control = surface_.control();
    const double per_control = distances_.weight() / layout_.controls;
    const double root = std::sqrt(kFit.smoothing * per_control);
    for (std::size_t c = 0; c + 3 < control.size(); ++c) {
      double* const p[] = {control[c].data(), control[c + 1].data(), control[c + 2].data(),
                           control[c + 3].data()};
      problem.AddResidualBlock(new ThirdDifference<3>(root), nullptr, p[0], p[1], p[2], p[3]);
      if (!layout_.varying) continue;
      problem.AddResidualBlock(new ThirdDifference<1>(root), nullptr, p[0] + 3, p[1] + 3, p[2] + 3,
                               p[3] + 3);
    }
    for (std::size_t c = 0; c < control.size(); ++c) {
      // A control point weighs most in the middle of its four spans, at c - 1.
      const double t =
          std::clamp(static_cast<double>(c) - 1.0, 0.0, static_cast<double>(surface_.spans()));
      const Eigen::Vector3d tangent = surface_.DerivativeAt(t).head<3>().normalized();
      if (!tangent.allFinite()) continue;
      problem.AddResidualBlock(new AlongSpine(std::sqrt(kFit.holding_along * per_control), tangent,
                                              control[c].head<3>()),
                               nullptr, control[c].data());
    }
  }

  CanalFit Result() const {
    CanalFit fit{.surface = surface_};
    fit.sigma_mm = sigma_mm_;
    fit.parameters = layout_.size();
    const double reach_mm = kFit.reach * options_.radius_mm;
    for (const CanalFoot& foot : distances_.feet()) {
      const double d = foot.beyond ? reach_mm : std::min(std::abs(foot.distance_mm), reach_mm);
      fit.cost_mm2 += d * d;
      fit.used += d < reach_mm ? 1 : 0;
    }
    return fit;
  }

  CanalSurface surface_;
  CanalFitOptions options_;
  Layout layout_;
  CanalDistances distances_;
  std::vector<Eigen::Vector4d> summed_;  // the control points that the sums are of
  double sigma_mm_ = 0, cut_mm_ = 0;
};

// The same equations with the radius held.
Sparse WithRadiusHeld(Sparse information, const Layout& layout) {
  for (int k = 0; k < information.outerSize(); ++k) {
    for (Sparse::InnerIterator it(information, k); it; ++it) {
      if (it.row() != it.col() && (layout.IsRadius(static_cast<int>(it.row())) ||
                                   layout.IsRadius(static_cast<int>(it.col())))) {
        it.valueRef() = 0;
      }
    }
  }
  return information;
}

void Fitter::Describe(CanalFit& fit) const {
  const Sparse information = InformationOf(distances_, layout_);
  const Cholesky with_radius(information);
  const Cholesky radius_known(WithRadiusHeld(information, layout_));
  if (with_radius.info() != Eigen::Success || radius_known.info() != Eigen::Success) return;
  const double variance = sigma_mm_ * sigma_mm_;
  std::vector<double> spine, inflation, radius;
  for (int i = 0; i < kFit.stations; ++i) {
    const double t = (i + 0.5) / kFit.stations * surface_.spans();
    Eigen::Vector4d w;
    const int span = CanalSurface::Span(t, surface_.spans(), w);
    // Places that no point speaks for say nothing of the rest.
    if (distances_.spans()[static_cast<std::size_t>(span)].matrix.trace() < 1.0) continue;
    const Eigen::Vector3d tangent = surface_.DerivativeAt(t).head<3>().normalized();
    const Eigen::Vector3d e1 = tangent.unitOrthogonal();
    double free_sum = 0, held_sum = 0;
    for (const Eigen::Vector3d& e : {e1, Eigen::Vector3d(tangent.cross(e1))}) {
      Eigen::VectorXd row = Eigen::VectorXd::Zero(layout_.size());
      for (int a = 0; a < 4; ++a) {
        for (int k = 0; k < 3; ++k) row[layout_(span + a, k)] += w[a] * e[k];
      }
      free_sum += row.dot(with_radius.solve(row));
      held_sum += row.dot(radius_known.solve(row));
    }
    Eigen::VectorXd row = Eigen::VectorXd::Zero(layout_.size());
    // At a place, not at a parameter: sliding along the spine changes neither surface nor place.
    const Eigen::Vector4d d1 = surface_.DerivativeAt(t);
    const double slope = d1[3] / std::max(d1.head<3>().norm(), 1e-12);
    for (int a = 0; a < 4; ++a) {
      row[layout_(span + a, 3)] += w[a];
      for (int k = 0; k < 3; ++k) row[layout_(span + a, k)] -= w[a] * slope * tangent[k];
    }
    radius.push_back(row.dot(with_radius.solve(row)));
    spine.push_back(0.5 * free_sum);
    inflation.push_back(held_sum > 0 ? free_sum / held_sum : 1.0);
  }
  // Medians: the spline reaches beyond the ends of the pipe, where nothing holds it.
  fit.spine_sigma_mm = std::sqrt(variance * Median(std::move(spine)));
  fit.pipe_radius_sigma_mm = std::sqrt(variance * Median(std::move(radius)));
  fit.radius_inflation = std::max(1.0, Median(std::move(inflation)));
}

// Fits with denser and denser knots.
std::vector<CanalFit> FitsWithKnots(std::span<const Eigen::Vector4d> spine,
                                    std::span<const Eigen::Vector3d> points,
                                    const CanalFitOptions& options) {
  double length_mm = 0;
  for (std::size_t i = 1; i < spine.size(); ++i) {
    length_mm += (spine[i] - spine[i - 1]).head<3>().norm();
  }
  std::vector<CanalFit> fits;
  int last_spans = 0;
  for (const double spacing : kFit.knot_spacings) {
    const int spans =
        std::clamp(static_cast<int>(std::lround(length_mm / (spacing * options.radius_mm))), 1,
                   kFit.most_spans);
    if (spans == last_spans) continue;
    const double asked_for = kFit.points_of_unknown * 4 * (spans + 3);
    if (!fits.empty() && static_cast<double>(points.size()) < asked_for) break;
    last_spans = spans;
    fits.push_back(Fitter(CanalSurface::Through(spine, spans), points, options).Run());
  }
  return fits;
}

}  // namespace

CanalFit FitCanal(std::span<const Eigen::Vector4d> spine, std::span<const Eigen::Vector3d> points,
                  const CanalFitOptions& options) {
  std::vector<Eigen::Vector3d> few;
  const std::size_t stride = points.size() / kFit.points_for_knots + 1;
  for (std::size_t i = 0; i < points.size(); i += stride) few.push_back(points[i]);
  const std::vector<CanalFit> fits = FitsWithKnots(spine, few, options);

  // Bayesian information criterion, with the sigma of the closest fit.
  double sigma_mm = std::numeric_limits<double>::infinity();
  for (const CanalFit& fit : fits) sigma_mm = std::min(sigma_mm, fit.sigma_mm);
  const auto n = static_cast<double>(few.size());
  const auto criterion = [&](const CanalFit& fit) {
    return fit.cost_mm2 / (sigma_mm * sigma_mm) + fit.parameters * std::log(n);
  };
  const auto best = std::min_element(
      fits.begin(), fits.end(),
      [&](const CanalFit& a, const CanalFit& b) { return criterion(a) < criterion(b); });
  Fitter fitter(best->surface, points, options);
  CanalFit fit = fitter.Run();
  fit.criterion =
      n * std::log(std::max(best->cost_mm2 / n, 1e-12)) + best->parameters * std::log(n);
  fitter.Describe(fit);
  return fit;
}

}  // namespace bendloop::pipeline
