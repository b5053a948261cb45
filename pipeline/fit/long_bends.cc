// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/long_bends.h"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>

#include "pipeline/math/dense_solve.h"
#include "pipeline/math/product_sums.h"
#include "pipeline/math/simd.h"

namespace bendloop::pipeline {
namespace {

struct LongBendSettings {
  // [sigma] and [of r_P] Together: further off is a dent or a flier and tells of no bow.
  double bow_sigmas = 4.0, most_bow = 0.04;
  // [of r_P] 1 sigma of what bows are expected to be: keeps apart what one side does not tell.
  double usual_bow = 0.1;
};
constexpr LongBendSettings kLongBends;

// Legendre polynomials of the straight's length: place, direction, bow and S of its spine.
constexpr int kModes = 4;
constexpr int kAcross = 2 * kModes;  // in y and z

std::array<double, kModes> Modes(double t) {
  return {1.0, t, 1.5 * t * t - 0.5, (2.5 * t * t - 1.5) * t};
}
BendNumbers RowOf(double t, double oy, double oz) {
  BendNumbers row;
  const auto modes = Modes(t);
  for (int k = 0; k < kModes; ++k) {
    row[2 * k] = modes[static_cast<std::size_t>(k)] * oy;
    row[2 * k + 1] = modes[static_cast<std::size_t>(k)] * oz;
  }
  row[kAcross] = 1.0;
  row[kAcross + 1] = oy * oy - oz * oz;
  row[kAcross + 2] = 2.0 * oy * oz;
  return row;
}

// A batch of a straight's points: their rows, and how far off the pipe's radius they are.
using BendSums = ProductSums<kBendNumbers + 1, kBatch>;
constexpr int kOff = kBendNumbers;

struct BendPoints {
  const double *x, *y, *z, *distance;
};
// Which points tell of the long bends. [mm]
struct BendLimits {
  double middle_mm = 0, half_mm = 1, pipe_radius_mm = 0;
  double distance_mm = 0;  // from the tube
  double left_mm = 0;      // from what `numbers` say
  std::array<double, kBendNumbers> numbers{};
};

BENDLOOP_LOOP void AddBendsBody(const BendPoints& p, const BendLimits& limits, BendSums& sums) {
  auto& f = sums.functions;
  const double middle_mm = limits.middle_mm, inverse_half = 1.0 / limits.half_mm;
  const double r_mm = limits.pipe_radius_mm, distance_mm = limits.distance_mm;
  for (std::size_t l = 0; l < kBatch; ++l) {
    const double t = (p.x[l] - middle_mm) * inverse_half;
    const double distance = std::sqrt(p.y[l] * p.y[l] + p.z[l] * p.z[l]);
    const double rho = distance > 1e-9 ? distance : 1e-9;
    const double oy = p.y[l] / rho, oz = p.z[l] / rho;
    const double bow = 1.5 * t * t - 0.5, s = (2.5 * t * t - 1.5) * t;
    f[0][l] = oy;
    f[1][l] = oz;
    f[2][l] = t * oy;
    f[3][l] = t * oz;
    f[4][l] = bow * oy;
    f[5][l] = bow * oz;
    f[6][l] = s * oy;
    f[7][l] = s * oz;
    f[kAcross][l] = 1.0;
    f[kAcross + 1][l] = oy * oy - oz * oz;
    f[kAcross + 2][l] = 2.0 * oy * oz;
    f[kOff][l] = rho - r_mm;
    const double on_straight = std::abs(t) <= 1.0 ? 1.0 : 0.0;
    sums.weight[l] = std::abs(p.distance[l]) <= distance_mm ? on_straight : 0.0;
  }
  for (std::size_t l = 0; l < kBatch; ++l) {
    double left = f[kOff][l];
    for (int k = 0; k < kBendNumbers; ++k)
      left -= limits.numbers[static_cast<std::size_t>(k)] * f[k][l];
    sums.weight[l] = std::abs(left) <= limits.left_mm ? sums.weight[l] : 0.0;
  }
  AddProducts(sums);
}
BENDLOOP_MULTIVERSION(void, AddBends,
                      (const BendPoints& p, const BendLimits& limits, BendSums& sums),
                      (p, limits, sums))

void AddBends(const SegmentPoints& points, const BendLimits& limits, BendSums& sums) {
  std::size_t first = 0;
  for (; first + kBatch <= points.size; first += kBatch) {
    AddBends(BendPoints{points.x.data() + first, points.y.data() + first, points.z.data() + first,
                        points.distance.data() + first},
             limits, sums);
  }
  // Those that are missing are too far off.
  LocalLanes rest;
  rest.x.fill(0.0);
  rest.y.fill(0.0);
  rest.z.fill(0.0);
  rest.distance.fill(std::numeric_limits<double>::max());
  const std::size_t left = points.size - first;
  std::copy_n(points.x.data() + first, left, rest.x.begin());
  std::copy_n(points.y.data() + first, left, rest.y.begin());
  std::copy_n(points.z.data() + first, left, rest.z.begin());
  std::copy_n(points.distance.data() + first, left, rest.distance.begin());
  AddBends(BendPoints{rest.x.data(), rest.y.data(), rest.z.data(), rest.distance.data()}, limits,
           sums);
}

}  // namespace

LongBends::LongBends(const SegmentPoints& points, double low_mm, double high_mm,
                     double pipe_radius_mm, double noise_mm)
    : middle_mm_(0.5 * (low_mm + high_mm)), half_mm_(0.5 * (high_mm - low_mm)) {
  const double prior = std::pow(noise_mm / (kLongBends.usual_bow * pipe_radius_mm), 2);
  BendLimits limits{middle_mm_, half_mm_, pipe_radius_mm};
  // A bow of L/300 of a straight of 40 pipe radii is within it.
  limits.distance_mm = kLongBends.bow_sigmas * noise_mm +
                       std::max(kLongBends.most_bow * pipe_radius_mm, (high_mm - low_mm) / 300.0);
  // The second time without what the bends do not explain.
  for (const bool again : {false, true}) {
    limits.left_mm =
        again ? kLongBends.bow_sigmas * noise_mm : std::numeric_limits<double>::infinity();
    BendSums sums;
    AddBends(points, limits, sums);
    Matrix matrix = Matrix::Identity() * prior;
    BendNumbers right;
    for (int k = 0; k < kBendNumbers; ++k) {
      right[k] = sums.sum[kOff][k];
      matrix(k, k) += sums.sum[k][k];
      for (int i = k + 1; i < kBendNumbers; ++i) matrix(i, k) = matrix(k, i) = sums.sum[i][k];
    }
    covariance_ = Inverse(matrix) * noise_mm * noise_mm;
    numbers_ = SolveSymmetric(matrix, right);
    std::copy(numbers_.begin(), numbers_.end(), limits.numbers.begin());
  }
}

double LongBends::OffMm(double along_mm, double oy, double oz) const {
  return RowOf(std::clamp((along_mm - middle_mm_) / half_mm_, -1.0, 1.0), oy, oz).dot(numbers_);
}

StraightForm LongBends::Form(double design_effect) const {
  constexpr int kPlaces = 33;
  const auto at = [](int i) { return Modes(2.0 * i / (kPlaces - 1) - 1.0); };
  Eigen::Matrix2d spread = Eigen::Matrix2d::Zero();
  for (int i = 0; i < kPlaces; ++i) {
    const Eigen::Vector2d off =
        at(i)[2] * numbers_.segment<2>(4) + at(i)[3] * numbers_.segment<2>(6);
    spread += off * off.transpose();
  }
  Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> eigen;
  eigen.computeDirect(spread);
  const Eigen::Vector2d direction = eigen.eigenvectors().col(1);
  Eigen::Vector4d low = Eigen::Vector4d::Zero(), high = Eigen::Vector4d::Zero();
  double lowest = 1e300, highest = -1e300;
  for (int i = 0; i < kPlaces; ++i) {
    Eigen::Vector4d weights;
    weights << at(i)[2] * direction, at(i)[3] * direction;
    const double off = weights.dot(numbers_.segment<4>(4));
    if (off < lowest) low = weights, lowest = off;
    if (off > highest) high = weights, highest = off;
  }
  const Eigen::Vector4d weights = high - low;
  const double variance = weights.dot(covariance_.block<4, 4>(4, 4) * weights);
  return {highest - lowest, std::sqrt(design_effect * variance), 2.0 * half_mm_};
}

}  // namespace bendloop::pipeline
