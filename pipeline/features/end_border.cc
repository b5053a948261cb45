// SPDX-License-Identifier: Apache-2.0
#include "pipeline/features/end_border.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "pipeline/math/arc_tangents.h"
#include "pipeline/math/dense_solve.h"

namespace bendloop::pipeline {
namespace {

struct EndBorderSettings {
  // The border lies within so many sigma of noise and of the rough plane.
  double smears = 6.0, spreads = 5.0;
  // Samples behind it that tell how dense they are, and [of r_P] how far they are taken from.
  double of_density = 20'000.0, deepest = 1.5;
  std::size_t columns = 48;
  // Columns that hold so many sigma more or fewer samples than the rough plane says are hidden, or
  // something lies on them; no more than this part of all.
  double odd = 6.0, most_odd = 0.25;
  // Samples of a cell in the test whether they are scattered, sectors of the turn in it, and the
  // variance of cells over their mean: 1 of scattered samples, far more of lines, less of grids.
  double in_cell = 8.0;
  std::size_t sectors = 8;
  double least_scatter = 0.6, most_scatter = 1.5;
  // Part of the samples that may lie anywhere.
  double flier = 1e-3;
  // Samples within 2 sigma of noise of the plane: from so many on the likelihood is as a normal
  // density is. Fewer are asked by a walk.
  double enough_about = 50.0;
  int walk = 1200;
  // The noise is thought to be what is said but for this part of it; anything else is rarer, but
  // not so rare that samples could not say it (Cauchy).
  double sure_noise = 0.15;
  int most_steps = 30;
  // The noise may be so many times what was thought, or so many times less.
  double other_noise = 10.0;
};
constexpr EndBorderSettings kEndBorder;

// A row of the plane at a place around the end.
Eigen::Vector3d RowAt(double around_rad) {
  return {1.0, std::cos(around_rad), std::sin(around_rad)};
}

using Numbers = Eigen::Vector4d;  // the plane, and the logarithm of the noise over what was thought

// A sample about the border: 1, cosine and sine of its place around.
struct BorderSample {
  Eigen::Vector3d row = Eigen::Vector3d::UnitX();
  double at_mm = 0;
};

// The likelihood of planes, for samples about the border.
class BorderLikelihood {
 public:
  BorderLikelihood(std::vector<BorderSample> samples, const Eigen::Vector3d& missing,
                   double smear_mm, double slope_mm)
      : samples_(std::move(samples)), missing_(missing), smear_mm_(smear_mm) {
    certainty_ << 0.0, 1.0 / (slope_mm * slope_mm), 1.0 / (slope_mm * slope_mm);
  }

  // Of the logarithm of the likelihood, its slope and, negative, its curvature.
  double Log(const Numbers& x, Numbers* slope = nullptr,
             Eigen::Matrix4d* curvature = nullptr) const {
    const double s = smear_mm_ * std::exp(x[3]);
    const Eigen::Vector3d plane = x.head<3>();
    double log = -missing_.dot(plane) - 0.5 * certainty_.dot(plane.cwiseAbs2());
    if (slope) {
      slope->setZero();
      slope->head<3>() = -missing_ - certainty_.cwiseProduct(plane);
      curvature->setZero();
      curvature->diagonal().head<3>() = certainty_;
    }
    for (const BorderSample& sample : samples_) {
      const double z = (sample.row.dot(plane) - sample.at_mm) / s;
      if (z > 6.0) continue;
      const double covered = kEndBorder.flier + (1.0 - kEndBorder.flier) * 0.5 *
                                                    std::erfc(-z * std::numbers::sqrt2 / 2.0);
      log += std::log(covered);
      if (!slope) continue;
      const double g = (1.0 - kEndBorder.flier) * std::exp(-0.5 * z * z) /
                       std::sqrt(2.0 * std::numbers::pi) / covered;
      Numbers row;  // of z
      row << sample.row / s, -z;
      // d2 z: of the plane and the noise -1 / s, of the noise twice z.
      const double bend = g * (z + g);
      *slope += g * row;
      *curvature += bend * row * row.transpose();
      curvature->topRightCorner<3, 1>() += g / s * sample.row;
      curvature->bottomLeftCorner<1, 3>() += g / s * sample.row.transpose();
      (*curvature)(3, 3) -= g * z;
    }
    return log;
  }

 private:
  std::vector<BorderSample> samples_;
  Eigen::Vector3d missing_;  // samples that each mm of the plane's numbers takes away
  double smear_mm_;
  Eigen::Vector3d certainty_ = Eigen::Vector3d::Zero();  // before the scan
};

struct BorderFitted {
  Numbers x = Numbers::Zero();
  Eigen::Matrix4d covariance = Eigen::Matrix4d::Zero();
  double log = 0;
};

// The likeliest numbers, the first `n` of them; none: the steps do not settle.
std::optional<BorderFitted> Likeliest(const BorderLikelihood& likelihood, const Numbers& from,
                                      Eigen::Index n) {
  BorderFitted fit;
  fit.x = from;
  Numbers slope;
  Eigen::Matrix4d curvature;
  fit.log = likelihood.Log(fit.x, &slope, &curvature);
  double damping = 1e-3;
  for (int i = 0; i < kEndBorder.most_steps && damping < 1e6; ++i) {
    Eigen::MatrixXd damped = curvature.topLeftCorner(n, n);
    damped.diagonal() += damping * damped.diagonal().cwiseAbs();
    Numbers to = fit.x;
    to.head(n) += SolveSymmetric(damped, slope.head(n));
    const bool is_near = to.allFinite() && std::abs(to[3]) < std::log(2.0 * kEndBorder.other_noise);
    const double there = is_near ? likelihood.Log(to) : fit.log - 1.0;
    if (!(there > fit.log)) {
      if (is_near && fit.log - there < 1e-9) break;
      damping = std::max(1e-3, damping * 8.0);
      continue;
    }
    const bool is_done = there - fit.log < 1e-6;
    fit.x = to;
    fit.log = likelihood.Log(fit.x, &slope, &curvature);
    damping *= 0.1;
    if (is_done) break;
  }
  const Eigen::MatrixXd inverse = Inverse(curvature.topLeftCorner(n, n));
  if (!inverse.allFinite() || !(inverse.diagonal().minCoeff() > 0)) return std::nullopt;
  fit.covariance.topLeftCorner(n, n) = inverse;
  return fit;
}

// Where the likelihood is found from: samples far beyond a plane count as fliers, so they are taken
// for as uncertain as the rough plane is at first, and for ever surer then. `spread`: of it, in
// sigmas of the noise.
Numbers StartOf(const BorderLikelihood& likelihood, const Eigen::Vector3d& from, double spread) {
  Numbers start;
  start << from, 0.0;
  for (double wider = std::min(spread, kEndBorder.other_noise); wider > 1.2; wider *= 0.5) {
    start[3] = std::log(wider);
    if (const auto fit = Likeliest(likelihood, start, 3)) start = fit->x;
  }
  start[3] = 0.0;
  return start;
}

// Of what was thought of the noise, and of what the samples say of it, by how likely they are.
std::optional<Posterior> Together(const BorderLikelihood& likelihood, const Numbers& start) {
  const auto thought = Likeliest(likelihood, start, 3);
  if (!thought) return std::nullopt;
  Posterior result{thought->x.head<3>(), thought->covariance.topLeftCorner<3, 3>()};
  const auto free = Likeliest(likelihood, thought->x, 4);
  if (!free) return result;
  if (std::abs(free->x[3]) > std::log(kEndBorder.other_noise)) {
    // Nothing like what was thought: as near to what they say as it may be.
    Numbers most = free->x;
    most[3] = std::copysign(std::log(kEndBorder.other_noise), most[3]);
    const auto other = Likeliest(likelihood, most, 3);
    if (!other || !(other->log > thought->log)) return result;
    return Posterior{other->x.head<3>(), other->covariance.topLeftCorner<3, 3>(), 0.0};
  }
  // Laplace's volume of one more number, of its prior's.
  const double volume = std::sqrt(2.0 * std::numbers::pi * free->covariance.determinant() /
                                  thought->covariance.topLeftCorner<3, 3>().determinant()) /
                        (2.0 * std::log(kEndBorder.other_noise));
  const double odds = std::exp(std::min(50.0, free->log - thought->log)) * volume;
  const double part = std::isfinite(odds) ? odds / (1.0 + odds) : 0.0;
  const Eigen::Vector3d apart = free->x.head<3>() - thought->x.head<3>();
  result.mean += part * apart;
  result.covariance *= 1.0 - part;
  result.covariance += part * free->covariance.topLeftCorner<3, 3>();
  result.covariance += part * (1.0 - part) * apart * apart.transpose();
  return result;
}

// The same where few samples lie about the border, so that its likelihood has edges.
Posterior Walked(const BorderLikelihood& likelihood, const Posterior& rough) {
  Posterior from{Eigen::VectorXd::Zero(4), Eigen::MatrixXd::Zero(4, 4)};
  from.mean.head<3>() = rough.mean;
  from.covariance.topLeftCorner<3, 3>() = rough.covariance;
  from.covariance(3, 3) = kEndBorder.sure_noise * kEndBorder.sure_noise;
  const Posterior all = SamplePosterior(from, kEndBorder.walk, [&](const Eigen::VectorXd& x) {
    if (std::abs(x[3]) > std::log(kEndBorder.other_noise)) return -1e300;
    return likelihood.Log(x) - std::log1p(std::pow(x[3] / kEndBorder.sure_noise, 2));
  });
  return {all.mean.head<3>(), all.covariance.topLeftCorner<3, 3>()};
}

// The samples about an end, in columns of the turn.
class BandColumns {
 public:
  BandColumns(std::span<const BandSample> samples, const Eigen::Vector3d& plane_mm, double band_mm,
              double deep_mm)
      : band_mm_(band_mm), deep_mm_(deep_mm), deep_(kEndBorder.columns), near_(kEndBorder.columns) {
    std::vector<double> cosine, sine, around_rad(samples.size());
    cosine.reserve(samples.size()), sine.reserve(samples.size());
    for (const BandSample& sample : samples) {
      cosine.push_back(sample.cosine);
      sine.push_back(sample.sine);
    }
    ArcTangents(sine, cosine, around_rad);
    for (std::size_t i = 0; i < samples.size(); ++i) {
      const BorderSample own{{1.0, cosine[i], sine[i]}, samples[i].beyond_mm};
      const double level_mm = own.at_mm - own.row.dot(plane_mm);
      const double turn = around_rad[i] / (2.0 * std::numbers::pi);
      const double part = (turn - std::floor(turn)) * static_cast<double>(kEndBorder.columns);
      const auto k = std::min(kEndBorder.columns - 1, static_cast<std::size_t>(part));
      if (level_mm < -band_mm_) {
        deep_[k].push_back(-band_mm_ - level_mm);
      } else {
        near_[k].push_back(own);
      }
    }
  }

  // Whether their number in small cells differs as that of scattered ones does.
  bool AreScattered(double smear_mm) const {
    const std::size_t together = kEndBorder.columns / kEndBorder.sectors;
    double squares = 0, cells = 0;
    for (std::size_t sector = 0; sector < kEndBorder.sectors; ++sector) {
      double all = 0;
      for (std::size_t k = 0; k < together; ++k) all += Deep(sector * together + k);
      if (all < 10.0 * kEndBorder.in_cell) continue;
      const double rings =
          std::floor(std::min(all / kEndBorder.in_cell, deep_mm_ / (2.0 * smear_mm)));
      if (rings < 4) continue;
      std::vector<double> count(static_cast<std::size_t>(rings));
      for (std::size_t k = 0; k < together; ++k) {
        for (const double below_mm : deep_[sector * together + k]) {
          const auto ring = static_cast<std::size_t>(below_mm / deep_mm_ * rings);
          count[std::min(count.size() - 1, ring)] += 1;
        }
      }
      for (const double in_ring : count)
        squares += std::pow(in_ring - all / rings, 2) * rings / all;
      cells += rings - 1;
    }
    const double scatter = squares / std::max(1.0, cells);
    const double chance = 4.0 * std::sqrt(2.0 / std::max(1.0, cells));
    return cells > 20 && scatter < kEndBorder.most_scatter + chance &&
           scatter > kEndBorder.least_scatter - chance;
  }

  // The samples about the border, and what is missing beyond it. None: much of the turn is hidden.
  std::optional<std::vector<BorderSample>> Seen(double spread_mm, Eigen::Vector3d& missing) const {
    std::vector<BorderSample> seen;
    std::size_t odd = 0;
    missing.setZero();
    const double half_rad = std::numbers::pi / static_cast<double>(kEndBorder.columns);
    for (std::size_t k = 0; k < kEndBorder.columns; ++k) {
      const double per_mm = Deep(k) / deep_mm_;  // along the tube
      const double expected = per_mm * band_mm_;
      const double off = std::abs(static_cast<double>(near_[k].size()) - expected);
      if (Deep(k) < 1 ||
          off > kEndBorder.odd * std::sqrt(expected + 1.0) + per_mm * 4.0 * spread_mm) {
        ++odd;
        continue;
      }
      seen.insert(seen.end(), near_[k].begin(), near_[k].end());
      Eigen::Vector3d row = RowAt((2.0 * static_cast<double>(k) + 1.0) * half_rad);
      row.tail<2>() *= std::sin(half_rad) / half_rad;  // the mean over the column
      missing += per_mm * row;
    }
    if (static_cast<double>(odd) > kEndBorder.most_odd * static_cast<double>(kEndBorder.columns)) {
      return std::nullopt;
    }
    return seen;
  }

 private:
  double Deep(std::size_t k) const { return static_cast<double>(deep_[k].size()); }

  double band_mm_, deep_mm_;
  std::vector<std::vector<double>> deep_;  // [mm] before the band
  std::vector<std::vector<BorderSample>> near_;
};

}  // namespace

std::optional<Posterior> FitEndBorder(const RoughEnd& rough, const EndBand& band) {
  const Eigen::Vector3d plane_mm = rough.plane.mean;
  const double r_mm = rough.pipe_radius_mm;
  // At the worst place around; the slopes' own are each as wide as that of the place, or wider.
  const double spread_mm = std::sqrt(std::max(0.0, rough.plane.covariance.trace()));
  const double band_mm = kEndBorder.smears * rough.smear_mm + kEndBorder.spreads * spread_mm;
  const double turn_mm = 2.0 * std::numbers::pi * r_mm;
  const double deep_mm = std::min(kEndBorder.deepest * r_mm,
                                  kEndBorder.of_density / std::max(1e-9, rough.per_mm2 * turn_mm));
  if (!(deep_mm > 0) || !(band_mm < r_mm)) return std::nullopt;
  const double about = 2.0 * rough.per_mm2 * turn_mm * rough.smear_mm;
  if (about < kEndBorder.enough_about && !rough.is_thinned) return std::nullopt;
  const std::vector<BandSample> samples = band(plane_mm, band_mm + deep_mm, band_mm);
  const BandColumns columns(samples, plane_mm, band_mm, deep_mm);
  if (!columns.AreScattered(rough.smear_mm)) return std::nullopt;
  Eigen::Vector3d missing;
  const auto seen = columns.Seen(spread_mm, missing);
  if (!seen) return std::nullopt;
  const BorderLikelihood likelihood(*seen, missing, rough.smear_mm, rough.slope_mm);
  if (about >= kEndBorder.enough_about) {
    return Together(likelihood, StartOf(likelihood, plane_mm, spread_mm / rough.smear_mm));
  }
  return Walked(likelihood, rough.plane);
}

}  // namespace bendloop::pipeline
