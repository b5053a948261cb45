// SPDX-License-Identifier: Apache-2.0
#include "pipeline/canal/canal_fit.h"

#include <Eigen/Dense>
#include <Eigen/Sparse>
#include <Eigen/SparseCholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>

#include "pipeline/math/quantiles.h"
#include "pipeline/points/point_index.h"

namespace bendloop::pipeline {
namespace {

using Sparse = Eigen::SparseMatrix<double>;
using Solver = Eigen::SimplicialLDLT<Sparse>;

constexpr std::array<double, 5> kKnotSpacing = {8, 4, 2, 1, 0.5};  // of the pipe radius
constexpr double kReach = 0.3;      // of the radius: further points say nothing
constexpr double kWideReach = 0.5;  // in the first rounds
constexpr double kFade = 5.0;       // sigma, Tukey's cut-off
constexpr double kMinSigma = 1e-5;  // of the radius: noise-free points are points too
constexpr double kSmooth = 1e-3;    // of the points' weight, on third differences
constexpr double kDamping = 1e-3;   // of the points' weight, on steps
constexpr double kSliding = 0.02;  // the same along the spine, where steps change nothing but knots
constexpr int kRounds = 20;
constexpr int kMaxSpans = 4000;
constexpr std::size_t kEnoughPoints = 10'000;  // for the choice of the knots
constexpr double kPointsOfParameter = 1.5;     // fewer points would be followed, not averaged

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

// Sum of w * outer(row) over the points, span by span.
struct Equations {
  std::vector<Eigen::Matrix<double, 16, 16>> blocks;
  std::vector<Eigen::Matrix<double, 16, 1>> right;
  double weight = 0;
};

// `damped`: where steps are damped; nothing: covariances are asked for.
Sparse Matrix(const Equations& equations, const Layout& layout, const CanalSurface* damped) {
  std::vector<Eigen::Triplet<double>> entries;
  const double per_control = equations.weight / layout.controls;
  for (std::size_t s = 0; s < equations.blocks.size(); ++s) {
    for (int i = 0; i < 16; ++i) {
      for (int j = 0; j < 16; ++j) {
        entries.emplace_back(layout(static_cast<int>(s) + i / 4, i % 4),
                             layout(static_cast<int>(s) + j / 4, j % 4), equations.blocks[s](i, j));
      }
    }
  }
  const Eigen::Vector4d third(-1, 3, -3, 1);
  for (int c = 0; c + 3 < layout.controls; ++c) {
    for (int k = 0; k < (layout.varying ? 4 : 3); ++k) {
      for (int a = 0; a < 4; ++a) {
        for (int b = 0; b < 4; ++b) {
          entries.emplace_back(layout(c + a, k), layout(c + b, k),
                               kSmooth * per_control * third[a] * third[b]);
        }
      }
    }
  }
  for (int i = 0; i < layout.size(); ++i) {
    entries.emplace_back(i, i, ((damped ? kDamping : 0.0) + 1e-9) * per_control + 1e-12);
  }
  for (int c = 0; damped && c < layout.controls; ++c) {
    // A control point weighs most in the middle of its four spans, at c - 1.
    const double t = std::clamp(c - 1.0, 0.0, static_cast<double>(damped->spans()));
    const Eigen::Vector3d tangent = damped->DerivativeAt(t).head<3>().normalized();
    if (!tangent.allFinite()) continue;
    for (int a = 0; a < 3; ++a) {
      for (int b = 0; b < 3; ++b) {
        entries.emplace_back(layout(c, a), layout(c, b),
                             kSliding * per_control * tangent[a] * tangent[b]);
      }
    }
  }
  Sparse matrix(layout.size(), layout.size());
  matrix.setFromTriplets(entries.begin(), entries.end());
  return matrix;
}

// Gradient of the third differences' share.
void AddSmoothing(const CanalSurface& surface, const Layout& layout, double weight,
                  Eigen::VectorXd& right) {
  const Eigen::Vector4d third(-1, 3, -3, 1);
  const auto& control = surface.control();
  for (int c = 0; c + 3 < layout.controls; ++c) {
    Eigen::Vector4d difference = Eigen::Vector4d::Zero();
    for (int a = 0; a < 4; ++a) difference += third[a] * control[static_cast<std::size_t>(c + a)];
    for (int k = 0; k < (layout.varying ? 4 : 3); ++k) {
      for (int a = 0; a < 4; ++a) right[layout(c + a, k)] -= weight * third[a] * difference[k];
    }
  }
}

class Fitter {
 public:
  Fitter(CanalSurface start, std::span<const Eigen::Vector3d> points,
         const CanalFitOptions& options)
      : surface_(std::move(start)),
        points_(points),
        options_(options),
        layout_{static_cast<int>(surface_.control().size()), options.varying_radius} {
    if (!options.varying_radius) {
      double mean = 0;
      for (const Eigen::Vector4d& c : surface_.control()) mean += c[3];
      mean /= layout_.controls;
      for (Eigen::Vector4d& c : surface_.control()) c[3] = mean;
    }
  }

  CanalFit Run() {
    feet_ = FindFeet(surface_, points_, options_.radius_mm, kWideReach);
    for (int round = 0; round < kRounds; ++round) {
      if (!(Step(round < 2 ? kWideReach : kReach) > 1e-6 * options_.radius_mm) && round > 3) break;
    }
    Gather(kReach);
    CanalFit fit{.surface = surface_};
    fit.sigma_mm = sigma_mm_;
    fit.parameters = layout_.size();
    const double reach_mm = kReach * options_.radius_mm;
    for (const CanalFoot& foot : feet_) {
      const double d = foot.beyond ? reach_mm : std::min(std::abs(foot.distance_mm), reach_mm);
      fit.cost_mm2 += d * d;
      fit.used += d < reach_mm ? 1 : 0;
    }
    return fit;
  }

  // Standard deviations, at the surface that Run left.
  void Describe(CanalFit& fit) {
    const Sparse matrix = Matrix(equations_, layout_, nullptr);
    const Solver with_radius(matrix);
    // The same equations with the radius held.
    Sparse held = matrix;
    for (int k = 0; k < held.outerSize(); ++k) {
      for (Sparse::InnerIterator it(held, k); it; ++it) {
        if (it.row() != it.col() && (layout_.IsRadius(static_cast<int>(it.row())) ||
                                     layout_.IsRadius(static_cast<int>(it.col())))) {
          it.valueRef() = 0;
        }
      }
    }
    const Solver radius_known(held);
    if (with_radius.info() != Eigen::Success || radius_known.info() != Eigen::Success) return;
    const double variance = sigma_mm_ * sigma_mm_;
    std::vector<double> spine, inflation, radius;
    constexpr int kStations = 40;
    for (int i = 0; i < kStations; ++i) {
      const double t = (i + 0.5) / kStations * surface_.spans();
      Eigen::Vector4d w;
      const int span = CanalSurface::Span(t, surface_.spans(), w);
      // Places that no point speaks for say nothing of the rest.
      if (equations_.blocks[static_cast<std::size_t>(span)].trace() < 1.0) continue;
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

 private:
  void Gather(double reach) {
    std::vector<double> distances;
    const double reach_mm = reach * options_.radius_mm;
    for (std::size_t i = 0; i < points_.size(); ++i) {
      feet_[i] = surface_.FootNear(points_[i], feet_[i].t);
      if (!feet_[i].beyond && std::abs(feet_[i].distance_mm) < reach_mm) {
        distances.push_back(feet_[i].distance_mm);
      }
    }
    for (double& d : distances) d = std::abs(d);
    sigma_mm_ = std::max(1.4826 * Median(std::move(distances)), kMinSigma * options_.radius_mm);
    const double cut = std::min(kFade * sigma_mm_, reach_mm);
    equations_.blocks.assign(static_cast<std::size_t>(surface_.spans()),
                             Eigen::Matrix<double, 16, 16>::Zero());
    equations_.right.assign(static_cast<std::size_t>(surface_.spans()),
                            Eigen::Matrix<double, 16, 1>::Zero());
    equations_.weight = 0;
    for (std::size_t i = 0; i < points_.size(); ++i) {
      const CanalFoot& foot = feet_[i];
      const double u = foot.distance_mm / cut;
      if (foot.beyond || std::abs(u) >= 1) continue;
      const double weight = (1 - u * u) * (1 - u * u);
      Eigen::Vector4d w;
      const int span = CanalSurface::Span(foot.t, surface_.spans(), w);
      const Eigen::Vector3d out = (points_[i] - surface_.At(foot.t).head<3>()).normalized();
      // d grows when the centre moves away from the point or the radius shrinks.
      Eigen::Matrix<double, 16, 1> row;
      for (int a = 0; a < 4; ++a) row.segment<4>(4 * a) << w[a] * out, w[a];
      const auto s = static_cast<std::size_t>(span);
      equations_.blocks[s].noalias() += weight * row * row.transpose();
      equations_.right[s] += weight * foot.distance_mm * row;
      equations_.weight += weight;
    }
  }

  // One Gauss-Newton step; how far the control points moved.
  double Step(double reach) {
    Gather(reach);
    if (!(equations_.weight > 0)) return 0;
    Eigen::VectorXd right = Eigen::VectorXd::Zero(layout_.size());
    for (std::size_t s = 0; s < equations_.right.size(); ++s) {
      for (int i = 0; i < 16; ++i) {
        right[layout_(static_cast<int>(s) + i / 4, i % 4)] += equations_.right[s][i];
      }
    }
    AddSmoothing(surface_, layout_, kSmooth * equations_.weight / layout_.controls, right);
    const Solver solver(Matrix(equations_, layout_, &surface_));
    if (solver.info() != Eigen::Success) return 0;
    Eigen::VectorXd step = solver.solve(right);
    if (!step.allFinite()) return 0;
    const double limit_mm = 0.3 * options_.radius_mm;
    const double longest = step.cwiseAbs().maxCoeff();
    if (longest > limit_mm) step *= limit_mm / longest;
    auto& control = surface_.control();
    for (int c = 0; c < layout_.controls; ++c) {
      for (int k = 0; k < 4; ++k) control[static_cast<std::size_t>(c)][k] += step[layout_(c, k)];
    }
    return std::min(longest, limit_mm);
  }

  CanalSurface surface_;
  std::span<const Eigen::Vector3d> points_;
  CanalFitOptions options_;
  Layout layout_;
  std::vector<CanalFoot> feet_;
  Equations equations_;
  double sigma_mm_ = 0;
};

}  // namespace

std::vector<CanalFoot> FindFeet(const CanalSurface& surface,
                                std::span<const Eigen::Vector3d> points, double radius_mm,
                                double reach) {
  const double length_mm = surface.ArcLengths(8 * surface.spans()).back();
  const int steps = static_cast<int>(std::clamp(4 * length_mm / radius_mm, 8.0, 40'000.0));
  std::vector<Eigen::Vector3d> centers;
  std::vector<double> radii;
  double widest = 0;
  for (int i = 0; i <= steps; ++i) {
    const Eigen::Vector4d c = surface.At(static_cast<double>(surface.spans()) * i / steps);
    centers.emplace_back(c.head<3>());
    radii.push_back(c[3]);
    widest = std::max(widest, c[3]);
  }
  const double far_mm = widest * (1 + reach);
  // Points of one cell share their candidates.
  const double cell_mm = 0.5 * radius_mm;
  std::unordered_map<std::uint64_t, std::vector<std::size_t>> cells;
  std::vector<std::uint64_t> order;
  for (std::size_t i = 0; i < points.size(); ++i) {
    auto [place, created] = cells.try_emplace(CellKey(CellOf(points[i], cell_mm)));
    if (created) order.push_back(place->first);
    place->second.push_back(i);
  }
  const PointIndex index(centers, std::max(0.5 * far_mm, radius_mm));
  std::vector<CanalFoot> feet(points.size(), CanalFoot{0, 0, true});
  std::vector<std::size_t> near;
  for (const std::uint64_t key : order) {
    const std::vector<std::size_t>& members = cells[key];
    near.clear();
    const Eigen::Vector3d middle =
        (CellOf(points[members.front()], cell_mm).cast<double>() + Eigen::Vector3d::Constant(0.5)) *
        cell_mm;
    index.Visit(middle, far_mm + cell_mm, [&](std::size_t j) { near.push_back(j); });
    std::sort(near.begin(), near.end());
    for (const std::size_t i : members) {
      double best = std::numeric_limits<double>::infinity();
      std::size_t at = 0;
      for (const std::size_t j : near) {
        const double d = (points[i] - centers[j]).norm() - radii[j];
        if (d < best) {
          best = d;
          at = j;
        }
      }
      if (!std::isfinite(best)) continue;
      feet[i] = surface.FootNear(
          points[i], static_cast<double>(surface.spans() * static_cast<int>(at)) / steps);
      if (std::abs(feet[i].distance_mm) > reach * radii[at]) feet[i].beyond = true;
    }
  }
  return feet;
}

CanalFit FitCanal(std::span<const Eigen::Vector4d> spine, std::span<const Eigen::Vector3d> points,
                  const CanalFitOptions& options) {
  double length_mm = 0;
  for (std::size_t i = 1; i < spine.size(); ++i) {
    length_mm += (spine[i] - spine[i - 1]).head<3>().norm();
  }
  std::vector<Eigen::Vector3d> few;
  const std::size_t stride = points.size() / kEnoughPoints + 1;
  for (std::size_t i = 0; i < points.size(); i += stride) few.push_back(points[i]);

  std::vector<CanalFit> fits;
  int last_spans = 0;
  for (const double spacing : kKnotSpacing) {
    const int spans = std::clamp(
        static_cast<int>(std::lround(length_mm / (spacing * options.radius_mm))), 1, kMaxSpans);
    if (spans == last_spans) continue;
    if (!fits.empty() && static_cast<double>(few.size()) < kPointsOfParameter * 4 * (spans + 3)) {
      break;
    }
    last_spans = spans;
    fits.push_back(Fitter(CanalSurface::Through(spine, spans), few, options).Run());
  }
  double sigma_mm = std::numeric_limits<double>::infinity();
  for (const CanalFit& fit : fits) sigma_mm = std::min(sigma_mm, fit.sigma_mm);
  const auto criterion = [&](const CanalFit& fit) {
    return fit.cost_mm2 / (sigma_mm * sigma_mm) +
           fit.parameters * std::log(static_cast<double>(few.size()));
  };
  auto best = fits.begin();
  for (auto it = fits.begin(); it != fits.end(); ++it) {
    if (criterion(*it) < criterion(*best)) best = it;
  }
  const auto n = static_cast<double>(few.size());
  const double chosen =
      n * std::log(std::max(best->cost_mm2 / n, 1e-12)) + best->parameters * std::log(n);
  Fitter fitter(best->surface, points, options);
  CanalFit fit = fitter.Run();
  fit.criterion = chosen;
  fitter.Describe(fit);
  return fit;
}

}  // namespace bendloop::pipeline
