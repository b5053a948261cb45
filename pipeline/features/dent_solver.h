// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <iterator>
#include <span>
#include <vector>

#include "pipeline/features/dent_fit.h"
#include "pipeline/features/dent_shapes.h"
#include "pipeline/math/dense_solve.h"
#include "pipeline/math/product_sums.h"

namespace bendloop::pipeline {

struct DentSolverSettings {
  // [sigma] Points that the first fit leaves so far off are left out of the second.
  double flier = 5.0;
  // 1 sigma before the scan of the logarithm of either half axis about the cells', [of r_P] of the
  // wall's own form at the edge of what is looked at, and [of the cells'] of the depth; its place
  // is in what is looked at, and its shape's own numbers have theirs (dent_shapes.h). They decide
  // only where points leave it open: where no point lies on a flank, none of them tells place and
  // area.
  double half_axis = 0.7, wall = 0.05, depth = 3.0;
  // The form that ends soonest falls to its edge hardly more steeply than a straight line.
  double least_tail = -1.1;
  int most_steps = 40;
  int most_rounds = 4;  // in which points are taken again that may be of it, as it proves deeper
  // Of chi square: a step that makes it less by no more, a thirtieth of a sigma long, is the last.
  double hardly = 1e-3;
  // Of what is looked at the fit explains no less, or it is none of this wall.
  double least_kept = 0.6;
};
inline constexpr DentSolverSettings kDentSolver;

// The numbers of the fit: of its size L = (e^kAxisU 0; kLean e^kAxisV), with which a place from its
// middle is L^T (along, around). Those of its shape follow, and then five of the wall: its radius,
// its axis aside in two directions, and how that grows along.
enum DentUnknown : Eigen::Index { kDepth, kU, kV, kAxisU, kLean, kAxisV, kShape };
constexpr int kWallNumbers = 5;

// Points side by side, for sums that take some of them at once: as many as a batch.
constexpr std::size_t kDentBatch = 64;
template <int kUnknowns>
using DentSums = ProductSums<kUnknowns + 1, kDentBatch>;
template <class Shape>
constexpr int kDentUnknowns = static_cast<int>(kShape) +
                              static_cast<int>(Shape::kNumbers) + kWallNumbers;
void AddDentRows(DentSums<kDentUnknowns<RoundDent>>& sums);
void AddDentRows(DentSums<kDentUnknowns<FlatDent>>& sums);

// A point with what does not change while the numbers do.
struct DentPoint {
  double along_mm, around_mm, off_mm;
  double cosine, sine, reach;  // of its place around; its place along, of what is looked at
};

// Least squares of a dent of one shape on the points about it.
template <class Shape>
class DentSolver {
 public:
  static constexpr int kUnknowns = kDentUnknowns<Shape>, kWall = kUnknowns - kWallNumbers;
  static constexpr int kOff = kUnknowns;  // what the numbers leave, after their derivatives
  using Unknowns = Eigen::Matrix<double, kUnknowns, 1>;
  using Square = Eigen::Matrix<double, kUnknowns, kUnknowns>;
  using Row = std::array<double, kUnknowns + 1>;

  // `depth_mm`, `size_mm`: as cells show it.
  DentSolver(std::span<const WallPoint> points, double reach_mm, double depth_mm, double size_mm,
             double pipe_radius_mm, double noise_mm)
      : noise_mm_(noise_mm), off_mm_(MostOffWallMm(depth_mm, noise_mm)) {
    all_.reserve(points.size());
    for (const WallPoint& point : points) {
      const double around = point.around_mm / pipe_radius_mm;
      all_.push_back({point.along_mm, point.around_mm, point.off_mm, std::cos(around),
                      std::sin(around), point.along_mm / reach_mm});
    }
    Take();
    at_[kDepth] = depth_mm;
    at_[kAxisU] = at_[kAxisV] = -std::log(0.5 * size_mm);
    certainty_[kDepth] = 1.0 / (kDentSolver.depth * depth_mm);
    certainty_[kU] = certainty_[kV] = 1.0 / reach_mm;
    certainty_[kAxisU] = certainty_[kAxisV] = 1.0 / kDentSolver.half_axis;
    certainty_[kLean] = 0.5 * size_mm / kDentSolver.half_axis;
    for (int k = 0; k < Shape::kNumbers; ++k) {
      at_[kShape + k] = Shape::kExpected[static_cast<std::size_t>(k)];
      certainty_[kShape + k] = 1.0 / Shape::kSigma[static_cast<std::size_t>(k)];
    }
    certainty_.template tail<kWallNumbers>().setConstant(1.0 / (kDentSolver.wall * pipe_radius_mm));
    about_ = at_;
  }

  // The same place, size and form, whatever the points say.
  void Hold() {
    constexpr double kHeld = 1e6;  // [1 / mm, and of what has no unit]
    certainty_.template segment<kWall - kU>(kU).setConstant(kHeld);
    is_held_ = true;
  }
  bool is_held() const { return is_held_; }

  // False: fewer points than `least` tell of it, or the fit explains too few of them.
  bool Fit(std::size_t least) {
    if (points_.size() < least) return false;
    Solve();
    // Cells have the mean of its middle and its flanks, down to a quarter of its depth: without the
    // points of its middle it would be too shallow, and too large.
    for (int round = 0; !is_held_ && round < kDentSolver.most_rounds; ++round) {
      const double off_mm = MostOffWallMm(at_[kDepth], noise_mm_);
      if (!(off_mm > off_mm_)) break;
      off_mm_ = off_mm;
      Take();
      Solve();
    }
    const auto all = static_cast<double>(points_.size());
    const Size size(at_);
    std::erase_if(points_, [&](const DentPoint& point) {
      return std::abs(OffOf(point, size).off_mm) > kDentSolver.flier * noise_mm_;
    });
    if (points_.size() < least) return false;
    normal_ = Solve();
    return static_cast<double>(points_.size()) > kDentSolver.least_kept * all;
  }

  // Sum of squares in sigmas, and the normal equations.
  struct Normal {
    double cost = 0;
    Square matrix;
    Unknowns right;
  };

  // After Fit().
  const Unknowns& at() const { return at_; }
  const Unknowns& certainty() const { return certainty_; }
  const Normal& normal() const { return normal_; }
  const std::vector<DentPoint>& all() const { return all_; }
  const std::vector<DentPoint>& points() const { return points_; }
  double noise_mm() const { return noise_mm_; }

  // What all points have in common of the numbers.
  static Shape ShapeOf(const Unknowns& x) {
    typename Shape::Numbers numbers;
    for (int k = 0; k < Shape::kNumbers; ++k) numbers[static_cast<std::size_t>(k)] = x[kShape + k];
    return Shape(numbers);
  }
  static DentScale ScaleOf(const Unknowns& x) {
    return {std::exp(x[kAxisU]), x[kLean], std::exp(x[kAxisV])};
  }
  struct Size {
    explicit Size(const Unknowns& x) : scale(ScaleOf(x)), shape(ShapeOf(x)) {}
    DentScale scale;
    Shape shape;
  };

  // How far the point lies out of what the numbers say, and its derivatives to them.
  template <class Put>
  static void FindRow(const DentPoint& point, const Unknowns& x, const Size& size, Put row) {
    const double u = point.along_mm - x[kU], v = point.around_mm - x[kV];
    const DentScale& scale = size.scale;
    const auto of = size.shape.At(scale.of_u * u + scale.lean * v, scale.of_v * v);
    const double by_along = -x[kDepth] * of.by_along, by_around = -x[kDepth] * of.by_around;
    row(kDepth) = -of.f;
    row(kU) = -by_along * scale.of_u;
    row(kV) = -by_along * scale.lean - by_around * scale.of_v;
    row(kAxisU) = by_along * scale.of_u * u;
    row(kLean) = by_along * v;
    row(kAxisV) = by_around * scale.of_v * v;
    for (int k = 0; k < Shape::kNumbers; ++k) {
      row(kShape + k) = -x[kDepth] * of.by[static_cast<std::size_t>(k)];
    }
    row(kWall) = 1.0;
    row(kWall + 1) = point.cosine;
    row(kWall + 2) = point.sine;
    row(kWall + 3) = point.reach * point.cosine;
    row(kWall + 4) = point.reach * point.sine;
    const double wall = x[kWall] + (x[kWall + 1] + x[kWall + 3] * point.reach) * point.cosine +
                        (x[kWall + 2] + x[kWall + 4] * point.reach) * point.sine;
    row(kOff) = point.off_mm - (wall - x[kDepth] * of.f);
  }
  Row RowOf(const DentPoint& point, const Size& size) const {
    Row row;
    FindRow(point, at_, size,
            [&row](Eigen::Index k) -> double& { return row[static_cast<std::size_t>(k)]; });
    return row;
  }

  struct Off {
    double off_mm, part;  // of the depth, that the dent has there
  };
  Off OffOf(const DentPoint& point, const Size& size) const {
    const Row row = RowOf(point, size);
    return {row[kOff], -row[kDepth]};
  }

 private:
  // The points that may be of the dent or of the wall about it.
  void Take() {
    points_.clear();
    std::copy_if(all_.begin(), all_.end(), std::back_inserter(points_),
                 [this](const DentPoint& point) { return std::abs(point.off_mm) <= off_mm_; });
  }

  Normal NormalAt(const Unknowns& x) const {
    const Size size(x);
    DentSums<kUnknowns> sums;
    for (std::size_t first = 0; first < points_.size(); first += kDentBatch) {
      const std::size_t count = std::min(kDentBatch, points_.size() - first);
      for (std::size_t l = 0; l < kDentBatch; ++l) {
        sums.weight[l] = l < count ? 1.0 : 0.0;
        // What fills the last batch has no weight; any point will do.
        const DentPoint& point = points_[l < count ? first + l : first];
        FindRow(point, x, size,
                [&sums, l](Eigen::Index k) -> double& { return sums.functions[k][l]; });
      }
      AddDentRows(sums);
    }
    const double weight = 1.0 / (noise_mm_ * noise_mm_);
    Normal normal;
    normal.cost =
        (x - about_).cwiseProduct(certainty_).squaredNorm() + weight * sums.sum[kOff][kOff];
    normal.right = certainty_.cwiseAbs2().cwiseProduct(about_ - x);
    for (int k = 0; k < kUnknowns; ++k) {
      normal.right[k] += weight * sums.sum[kOff][k];
      for (int i = k; i < kUnknowns; ++i) {
        normal.matrix(i, k) = normal.matrix(k, i) = weight * sums.sum[i][k];
      }
    }
    normal.matrix.diagonal() += certainty_.cwiseAbs2();
    return normal;
  }

  static bool IsForm(const Unknowns& x) {
    return x.allFinite() && std::all_of(Shape::kTails.begin(), Shape::kTails.end(), [&](int tail) {
             return x[kShape + tail] > kDentSolver.least_tail;
           });
  }

  // Levenberg and Marquardt, to `at_`. The equations are summed with the cost, as most steps lead
  // on. Returns those of where it came to.
  Normal Solve() {
    Normal here = NormalAt(at_);
    double damping = 1e-3;
    for (int step = 0; step < kDentSolver.most_steps && damping < 1e8; ++step) {
      Square damped = here.matrix;
      damped.diagonal() *= 1.0 + damping;
      const Unknowns to = at_ + Unknowns(SolveSymmetric(damped, here.right));
      const Normal there = IsForm(to) ? NormalAt(to) : Normal{here.cost + 1.0, {}, {}};
      if (!(there.cost < here.cost)) {
        damping *= 8.0;
        continue;
      }
      const bool is_done = here.cost - there.cost < kDentSolver.hardly;
      at_ = to;
      here = there;
      damping *= 0.2;
      if (is_done) break;
    }
    return here;
  }

  std::vector<DentPoint> all_, points_;
  double noise_mm_, off_mm_;
  bool is_held_ = false;
  Normal normal_;
  Unknowns at_ = Unknowns::Zero(), about_ = Unknowns::Zero(), certainty_ = Unknowns::Zero();
};

}  // namespace bendloop::pipeline
