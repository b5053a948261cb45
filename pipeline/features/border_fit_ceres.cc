// SPDX-License-Identifier: Apache-2.0
#include "pipeline/features/border_fit_ceres.h"

#include <ceres/ceres.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "pipeline/features/border_corners.h"
#include "pipeline/features/border_sketch.h"
#include "pipeline/features/border_unknowns.h"
#include "pipeline/math/dense_product.h"
#include "pipeline/math/dense_solve.h"

namespace bendloop::pipeline {
namespace {

using Eigen::Vector3d;

struct CeresFitSettings {
  // Weights between this and its inverse: beyond, a control point is hardly seen.
  double least_weight = 0.1;
  // [mean length of a piece] Handles.
  double least_handle = 1e-3, most_handle = 2;
  // [points' rms off the start] Held that weakly: the slide of a joint along the curve in mean
  // lengths of a piece, and the difference of a piece's two weights, which no conic needs.
  double holding = 1e-3;
  // Rounds of points to pieces, and steps of each: of the final fit, and of those that only choose.
  int rounds = 4, rounds_of_search = 2;
  int iterations = 60, iterations_of_search = 12;
  double settled = 1e-12;
  // [length of the curve] Less is asked of no curve: 0.1 um on 100 mm.
  double least_noise = 1e-6;
  // Numbers of pieces without gain after which no more are tried.
  int patience = 2;
  double points_of_parameter = 1.0;
  int stations = 16;  // a piece, where its sigma is asked for
};
constexpr CeresFitSettings kFit;

// One point: Q - C(u). Blocks: start, start tangent, shape, end, end tangent, u.
class PointCost final : public ceres::SizedCostFunction<3, 3, 3, 4, 3, 3, 1> {
 public:
  PointCost(const Vector3d& point_mm, double unit_mm) : point_mm_(point_mm), unit_mm_(unit_mm) {}

  bool Evaluate(double const* const* x, double* residuals, double** jacobians) const override {
    const Eigen::Map<const Vector3d> start(x[0]), from(x[1]), end(x[3]), to(x[4]);
    const double a = unit_mm_ * std::exp(x[2][0]), b = unit_mm_ * std::exp(x[2][1]);
    const RationalCubic piece{{start, start + a * from, end - b * to, end},
                              {1, std::exp(x[2][2]), std::exp(x[2][3]), 1}};
    const double u = x[5][0];
    const Eigen::Vector4d s = piece.SharesAt(u);
    const Vector3d at = piece.At(u);
    Eigen::Map<Vector3d>(residuals, 3) = point_mm_ - at;
    if (!jacobians) return true;
    const auto put = [&](int block, double factor) {
      if (!jacobians[block]) return;
      Eigen::Map<Eigen::Matrix3d> J(jacobians[block]);  // symmetric: its order does not matter
      J = factor * Eigen::Matrix3d::Identity();
    };
    put(0, -(s[0] + s[1]));
    put(1, -s[1] * a);
    if (jacobians[2]) {
      Eigen::Map<Eigen::Matrix<double, 3, 4, Eigen::RowMajor>> J(jacobians[2]);
      J.col(0) = -s[1] * a * from;
      J.col(1) = s[2] * b * to;
      J.col(2) = -s[1] * (piece.control_mm[1] - at);
      J.col(3) = -s[2] * (piece.control_mm[2] - at);
    }
    put(3, -(s[2] + s[3]));
    put(4, s[2] * b);
    if (jacobians[5]) Eigen::Map<Vector3d>(jacobians[5], 3) = -piece.DerivativeAt(u);
    return true;
  }

 private:
  Vector3d point_mm_;
  double unit_mm_;
};

// Holds a smooth joint along its tangent.
class SlideCost final : public ceres::SizedCostFunction<1, 3> {
 public:
  SlideCost(const Vector3d& row, const Vector3d& place_mm) : row_(row), place_mm_(place_mm) {}
  bool Evaluate(double const* const* x, double* residuals, double** jacobians) const override {
    residuals[0] = row_.dot(Eigen::Map<const Vector3d>(x[0]) - place_mm_);
    if (jacobians && jacobians[0]) Eigen::Map<Vector3d>(jacobians[0], 3) = row_;
    return true;
  }

 private:
  Vector3d row_, place_mm_;
};

// Holds a piece's two weights together.
class WeightsCost final : public ceres::SizedCostFunction<1, 4> {
 public:
  explicit WeightsCost(double root_weight) : root_weight_(root_weight) {}
  bool Evaluate(double const* const* x, double* residuals, double** jacobians) const override {
    residuals[0] = root_weight_ * (x[0][2] - x[0][3]);
    if (jacobians && jacobians[0]) {
      Eigen::Map<Eigen::Vector4d>(jacobians[0], 4) = root_weight_ * Eigen::Vector4d(0, 0, 1, -1);
    }
    return true;
  }

 private:
  double root_weight_;
};

// The nearest place on a point's own piece and those beside it.
CurveFoot NearestBeside(const RationalBezier& curve, const Vector3d& point_mm,
                        const CurveFoot& last) {
  const std::size_t n = curve.pieces.size();
  CurveFoot best = last;
  best.distance_mm = std::numeric_limits<double>::infinity();
  const auto look = [&](std::size_t p, double u) {
    const double found = FootNear(curve.pieces[p], point_mm, u);
    const double distance_mm = (curve.pieces[p].At(found) - point_mm).norm();
    if (distance_mm < best.distance_mm) best = {p, found, distance_mm};
  };
  look(last.piece, last.u);
  if (last.u > 0.8 && (curve.closed || last.piece + 1 < n)) look((last.piece + 1) % n, 0.1);
  if (last.u < 0.2 && (curve.closed || last.piece > 0)) look((last.piece + n - 1) % n, 0.9);
  return best;
}

class Fitter {
 public:
  Fitter(const OrderedBorder& border, const RationalBezier& start)
      : border_(border), unknowns_(BorderUnknowns::Of(start)) {
    const RationalBezier curve = unknowns_.Curve();
    for (const Vector3d& point : border.points_mm) feet_.push_back(curve.NearestTo(point));
  }

  BorderFit Run(bool searching = false) {
    BorderFit fit;
    const int rounds = searching ? kFit.rounds_of_search : kFit.rounds;
    const int iterations = searching ? kFit.iterations_of_search : kFit.iterations;
    double before = std::numeric_limits<double>::infinity();
    for (int round = 0; round < rounds; ++round) {
      fit.iterations += Minimise(iterations);
      const RationalBezier curve = unknowns_.Curve();
      double sum = 0;
      bool moved = false;
      for (std::size_t i = 0; i < feet_.size(); ++i) {
        const CurveFoot foot = NearestBeside(curve, border_.points_mm[i], feet_[i]);
        moved = moved || foot.piece != feet_[i].piece;
        feet_[i] = foot;
        sum += foot.distance_mm * foot.distance_mm;
      }
      if (round > 0 && (!moved || sum > (1 - 1e-6) * before)) break;
      before = sum;
    }
    fit.curve = unknowns_.Curve();
    fit.feet = feet_;
    fit.parameters = unknowns_.Parameters();
    MeasureQuality(fit);
    const double left = 2.0 * static_cast<double>(feet_.size()) - fit.parameters;
    fit.noise_sigma_mm = std::sqrt(fit.SumMm2() / std::max(left, 1.0));
    return fit;
  }

 private:
  int Minimise(int iterations) {
    ceres::Problem problem;
    AddPoints(problem);
    if (problem.NumResidualBlocks() == 0) return 0;
    AddHolds(problem);
    ceres::Solver::Options options;
    options.linear_solver_type = ceres::DENSE_SCHUR;
    options.num_threads = 1;
    options.max_num_iterations = iterations;
    options.function_tolerance = kFit.settled;
    options.gradient_tolerance = kFit.settled;
    options.parameter_tolerance = 1e-13;
    options.logging_type = ceres::SILENT;
    options.linear_solver_ordering = std::make_shared<ceres::ParameterBlockOrdering>();
    for (CurveFoot& foot : feet_) options.linear_solver_ordering->AddElementToGroup(&foot.u, 0);
    // Each block a group of its own: within one, Ceres goes by addresses, which differ between
    // runs.
    int group = 0;
    const auto later = [&](double* block) {
      if (!problem.HasParameterBlock(block)) return;
      options.linear_solver_ordering->AddElementToGroup(block, ++group);
    };
    for (auto& joint : unknowns_.joints_mm) later(joint.data());
    for (auto& tangent : unknowns_.tangents) later(tangent.data());
    for (auto& piece : unknowns_.pieces) later(piece.shape.data());
    ceres::Solver::Summary summary;
    ceres::Solve(options, &problem, &summary);
    return static_cast<int>(summary.iterations.size());
  }

  void AddPoints(ceres::Problem& problem) {
    for (std::size_t i = 0; i < feet_.size(); ++i) {
      BorderUnknowns::Piece& piece = unknowns_.pieces[feet_[i].piece];
      problem.AddResidualBlock(
          new PointCost(border_.points_mm[i], unknowns_.unit_mm), nullptr,
          {unknowns_.joints_mm[piece.start].data(), unknowns_.tangents[piece.start_tangent].data(),
           piece.shape.data(), unknowns_.joints_mm[piece.end].data(),
           unknowns_.tangents[piece.end_tangent].data(), &feet_[i].u});
      problem.SetParameterLowerBound(&feet_[i].u, 0, 0);
      problem.SetParameterUpperBound(&feet_[i].u, 0, 1);
    }
    if (border_.closed) return;
    // The curve ends where the points do.
    feet_.front() = {0, 0, 0};
    feet_.back() = {unknowns_.pieces.size() - 1, 1, 0};
    problem.SetParameterBlockConstant(&feet_.front().u);
    problem.SetParameterBlockConstant(&feet_.back().u);
  }

  void AddHolds(ceres::Problem& problem) {
    double sum = 0;
    for (const CurveFoot& foot : feet_) sum += foot.distance_mm * foot.distance_mm;
    const double root = kFit.holding * std::sqrt(sum / static_cast<double>(feet_.size())) + 1e-12;
    const double count = std::sqrt(static_cast<double>(feet_.size()));
    for (BorderUnknowns::Piece& piece : unknowns_.pieces) {
      if (!problem.HasParameterBlock(piece.shape.data())) continue;
      problem.AddResidualBlock(new WeightsCost(root * count), nullptr, piece.shape.data());
      for (int k = 0; k < 4; ++k) {
        const double most = k < 2 ? std::log(kFit.most_handle) : -std::log(kFit.least_weight);
        problem.SetParameterLowerBound(piece.shape.data(), k,
                                       k < 2 ? std::log(kFit.least_handle) : -most);
        problem.SetParameterUpperBound(piece.shape.data(), k, most);
        const auto place = static_cast<std::size_t>(k);
        piece.shape[place] =
            std::clamp(piece.shape[place], k < 2 ? std::log(kFit.least_handle) : -most, most);
      }
      if (unknowns_.corner[piece.start]) continue;
      const Vector3d row =
          root * count / unknowns_.unit_mm * unknowns_.tangents[piece.start_tangent];
      problem.AddResidualBlock(new SlideCost(row, unknowns_.joints_mm[piece.start]), nullptr,
                               unknowns_.joints_mm[piece.start].data());
    }
    for (Vector3d& tangent : unknowns_.tangents) {
      if (!problem.HasParameterBlock(tangent.data())) continue;
      problem.SetManifold(tangent.data(), new ceres::SphereManifold<3>());
    }
  }

  const OrderedBorder& border_;
  BorderUnknowns unknowns_;
  std::vector<CurveFoot> feet_;
};

// The piece whose points lie together on one side most: neighbours' distances multiplied.
std::size_t WorstPiece(const OrderedBorder& border, const BorderFit& fit) {
  std::vector<double> together(fit.curve.pieces.size(), 0);
  const auto off = [&](std::size_t i) -> Vector3d {
    return border.points_mm[i] - fit.curve.At(fit.feet[i]);
  };
  for (std::size_t i = 0; i + 1 < fit.feet.size(); ++i) {
    together[fit.feet[i].piece] += off(i).dot(off(i + 1));
  }
  return static_cast<std::size_t>(std::max_element(together.begin(), together.end()) -
                                  together.begin());
}

RationalBezier WithPieceSplit(const RationalBezier& curve, std::size_t piece) {
  RationalBezier finer = curve;
  const auto parts = curve.pieces[piece].SplitAt(0.5);
  const auto at = static_cast<std::ptrdiff_t>(piece);
  finer.pieces[piece] = parts[0].InStandardForm();
  finer.pieces.insert(finer.pieces.begin() + at + 1, parts[1].InStandardForm());
  finer.corner.insert(finer.corner.begin() + at + 1, false);
  return finer;
}

double Criterion(const BorderFit& fit, double least_noise_mm, double points_of_independent) {
  const double all = 2.0 * static_cast<double>(fit.feet.size()), n = all / points_of_independent;
  const double variance = std::max(fit.SumMm2() / all, least_noise_mm * least_noise_mm);
  return n * std::log(variance) + fit.parameters * std::log(n);
}

BorderFit WithAsManyPiecesAsPay(const OrderedBorder& border, const CurveFitOptions& options) {
  BorderFit fit =
      Fitter(border, SketchBorder(border, EvenBreaks(border, FirstPieces(border)))).Run(true);
  const double least_mm = kFit.least_noise * fit.curve.LengthMm();
  BorderFit best = fit;
  const double together = std::max(1.0, options.points_of_independent);
  int without_gain = 0;
  while (without_gain < kFit.patience &&
         static_cast<int>(fit.curve.pieces.size()) < options.most_pieces) {
    if (fit.SumMm2() <= least_mm * least_mm * static_cast<double>(fit.feet.size())) break;
    const RationalBezier finer = WithPieceSplit(fit.curve, WorstPiece(border, fit));
    const int unknowns = BorderUnknowns::Of(finer).Parameters();
    if (together * kFit.points_of_parameter * unknowns >
        static_cast<double>(border.points_mm.size()))
      break;
    fit = Fitter(border, finer).Run(true);
    if (Criterion(fit, least_mm, together) < Criterion(best, least_mm, together)) {
      best = fit;
      without_gain = 0;
    } else {
      ++without_gain;
    }
  }
  return Fitter(border, best.curve).Run();
}

hal::Result<void> Check(const OrderedBorder& border) {
  const auto& points = border.points_mm;
  if (points.size() < 6) {
    return hal::Fail(hal::ErrorKind::kBadInput,
                     "a border of " + std::to_string(points.size()) +
                         " points is no curve: 6 are the least, scan it denser");
  }
  double most_mm = 0;
  for (const Vector3d& point : points) {
    if (!point.allFinite()) {
      return hal::Fail(hal::ErrorKind::kBadInput, "a border has points that are no numbers");
    }
    most_mm = std::max(most_mm, (point - points.front()).norm());
  }
  if (most_mm > 0) return {};
  return hal::Fail(hal::ErrorKind::kBadInput, "all points of a border are in one place");
}

// Every k-th point, corners kept.
OrderedBorder AtMost(const OrderedBorder& border, std::size_t most) {
  const std::size_t n = border.points_mm.size(), step = (n + most - 1) / most;
  if (step <= 1) return border;
  OrderedBorder few{{}, border.closed, {}};
  for (std::size_t i = 0; i < n; ++i) {
    const bool corner = std::binary_search(border.corners.begin(), border.corners.end(), i);
    if (corner) few.corners.push_back(few.points_mm.size());
    if (corner || i % step == 0 || i + 1 == n) few.points_mm.push_back(border.points_mm[i]);
  }
  return few;
}

void AddSigma(BorderFit& fit, double points_of_independent) {
  const double noise_mm = fit.noise_sigma_mm * std::sqrt(std::max(1.0, points_of_independent));
  const CurveSigma sigma = SigmaOfCurve(fit.curve, fit.feet, noise_mm);
  fit.curve_sigma_mm = sigma.mean_mm;
  fit.most_curve_sigma_mm = sigma.most_mm;
}

// Derivatives of the place at u by all unknowns of its piece, across the curve: 16 columns, those
// of PointCost without u.
Eigen::Matrix<double, 3, 16> Across(const BorderUnknowns& unknowns, const RationalBezier& curve,
                                    const CurveFoot& foot) {
  using Row = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;
  const BorderUnknowns::Piece& piece = unknowns.pieces[foot.piece];
  std::array<Row, 4> J;
  Eigen::Matrix<double, 3, 4, Eigen::RowMajor> of_shape;
  Vector3d residual;
  const double* blocks[] = {unknowns.joints_mm[piece.start].data(),
                            unknowns.tangents[piece.start_tangent].data(),
                            piece.shape.data(),
                            unknowns.joints_mm[piece.end].data(),
                            unknowns.tangents[piece.end_tangent].data(),
                            &foot.u};
  double* jacobians[] = {J[0].data(), J[1].data(), of_shape.data(),
                         J[2].data(), J[3].data(), nullptr};
  PointCost(Vector3d::Zero(), unknowns.unit_mm).Evaluate(blocks, residual.data(), jacobians);
  Eigen::Matrix<double, 3, 16> all;
  all << J[0], J[1], of_shape, J[2], J[3];
  const Vector3d t = curve.pieces[foot.piece].TangentAt(foot.u);
  return all - t * (t.transpose() * all);
}

}  // namespace

CurveSigma SigmaOfCurve(const RationalBezier& curve, const std::vector<CurveFoot>& feet,
                        double noise_mm) {
  if (curve.pieces.empty()) return {};
  const BorderUnknowns unknowns = BorderUnknowns::Of(curve);
  const std::size_t joints = unknowns.joints_mm.size(), tangents = unknowns.tangents.size();
  const auto size =
      static_cast<Eigen::Index>(3 * joints + 3 * tangents + 4 * unknowns.pieces.size());
  const auto columns = [&](std::size_t p) {
    const BorderUnknowns::Piece& piece = unknowns.pieces[p];
    std::array<Eigen::Index, 16> place{};
    const std::size_t first[] = {3 * piece.start, 3 * (joints + piece.start_tangent),
                                 3 * (joints + tangents) + 4 * p, 3 * piece.end,
                                 3 * (joints + piece.end_tangent)};
    std::size_t k = 0;
    for (int block = 0; block < 5; ++block) {
      for (std::size_t c = 0; c < (block == 2 ? 4 : 3); ++c) {
        place[k++] = static_cast<Eigen::Index>(first[block] + c);
      }
    }
    return place;
  };
  Eigen::MatrixXd information = Eigen::MatrixXd::Zero(size, size);
  for (const CurveFoot& foot : feet) {
    const Eigen::Matrix<double, 3, 16> J = Across(unknowns, curve, foot);
    const auto place = columns(foot.piece);
    for (std::size_t a = 0; a < 16; ++a) {
      for (std::size_t b = 0; b < 16; ++b) {
        information(place[a], place[b]) +=
            J.col(static_cast<Eigen::Index>(a)).dot(J.col(static_cast<Eigen::Index>(b)));
      }
    }
  }
  // What no point tells (slides, lengths of tangents, shapes that are one) moves no place either,
  // and is left out: the pseudo-inverse.
  const EigenSystem eigen = SymmetricEigen(information);
  Eigen::VectorXd inverse = eigen.values;
  const double least = 1e-10 * inverse.maxCoeff();
  for (double& value : inverse) value = value > least ? 1 / value : 0;
  CurveSigma sigma;
  double sum = 0;
  for (std::size_t p = 0; p < unknowns.pieces.size(); ++p) {
    for (int i = 0; i < kFit.stations; ++i) {
      const CurveFoot foot{p, (i + 0.5) / kFit.stations, 0};
      const Eigen::Matrix<double, 3, 16> J = Across(unknowns, curve, foot);
      const auto place = columns(p);
      Eigen::MatrixXd spread = Eigen::MatrixXd::Zero(size, 3);
      for (std::size_t a = 0; a < 16; ++a) {
        spread.row(place[a]) += J.col(static_cast<Eigen::Index>(a)).transpose();
      }
      const Eigen::MatrixXd turned = TransposeProduct(eigen.vectors, spread);
      const double variance = 0.5 * (inverse.asDiagonal() * turned).cwiseProduct(turned).sum();
      sum += variance;
      sigma.most_mm = std::max(sigma.most_mm, noise_mm * std::sqrt(variance));
    }
  }
  sigma.mean_mm =
      noise_mm * std::sqrt(sum / static_cast<double>(kFit.stations * unknowns.pieces.size()));
  return sigma;
}

hal::Result<BorderFit> FitBorderFrom(const OrderedBorder& border, const RationalBezier& start) {
  if (const auto good = Check(border); !good) return hal::Fail(good.error());
  if (start.pieces.empty() || (start.closed && start.pieces.size() < 2)) {
    return hal::Fail(hal::ErrorKind::kBadInput,
                     "a fit starts from a curve of one piece at least, closed from two");
  }
  BorderFit fit = Fitter(border, start).Run();
  AddSigma(fit, 1);
  return fit;
}

hal::Result<BorderFit> FitBorder(const OrderedBorder& border, const CurveFitOptions& options) {
  if (const auto good = Check(border); !good) return hal::Fail(good.error());
  OrderedBorder fitted = border;
  if (options.find_corners && fitted.corners.empty()) {
    fitted.corners = FindCorners(fitted, BorderNoiseMm(fitted));
  }
  fitted = AtMost(fitted, options.most_points);
  BorderFit fit;
  if (options.pieces > 0) {
    const std::size_t stretches =
        std::max<std::size_t>(1, fitted.corners.size() + (fitted.closed ? 0 : 1));
    const auto asked = static_cast<std::size_t>(options.pieces);
    const std::size_t least = fitted.closed && stretches == 1 ? 2 : 1;
    fit =
        Fitter(fitted, SketchBorder(fitted, EvenBreaks(fitted, std::max(least, asked / stretches))))
            .Run();
  } else {
    fit = WithAsManyPiecesAsPay(fitted, options);
  }
  AddSigma(fit, options.points_of_independent);
  if (fitted.points_mm.size() != border.points_mm.size()) {
    fit.feet.clear();
    for (const Vector3d& point : border.points_mm) fit.feet.push_back(fit.curve.NearestTo(point));
    MeasureQuality(fit);
  }
  return fit;
}

}  // namespace bendloop::pipeline
