// SPDX-License-Identifier: Apache-2.0
#include "pipeline/features/end_border.h"

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <tuple>

#include "pipeline/features/band_columns.h"
#include "pipeline/features/even_table.h"
#include "pipeline/features/weighed_draws.h"
#include "pipeline/fit/surface_points.h"
#include "pipeline/math/dense_solve.h"

namespace bendloop::pipeline {
namespace {

struct EndBorderSettings {
  // The border lies within so many sigma of noise and of the rough plane.
  double smears = 6.0, spreads = 5.0;
  // Samples behind it that tell how dense they are, and [of r_P] how far they are taken from.
  double of_density = 20'000.0, deepest = 1.5;
  std::size_t of_cloud = 8000;  // of the samples about an end of a cloud so many tell enough
  // Part of the samples that may lie anywhere.
  double flier = 1e-3;
  // Samples within 2 sigma of noise of the plane: from so many on the likelihood is as a normal
  // density is. Fewer are asked by so many draws.
  double enough_about = 50.0;
  int draws = 400;
  // Of a cloud: draws, so that all together look at about so many samples.
  int least_of_cloud = 300, most_of_cloud = 600;
  double cloud_looked_at = 0.6e6;
  int places = 10;  // where such draws may begin, on either side
  // The noise is thought to be what is said but for this part of it; anything else is rarer, but
  // not so rare that samples could not say it (Cauchy).
  double sure_noise = 0.15;
  int most_steps = 30;
  // The noise may be so many times what was thought, or so many times less.
  double other_noise = 10.0;
  // Where rays are not known: of what was thought, noises that the likeliest is sought from, and
  // the least that is told from none. That it is what was thought is as likely as all others
  // together; half the width of that.
  std::array<double, 4> noises = {1.0, 0.5, 0.25, 0.1};
  double least_noise = 0.03, as_thought = 0.15;
  // Of the noise: how far an error of a part of the density moves the border.
  double by_density = 1.1;
};
constexpr EndBorderSettings kEndBorder;

using Numbers = Eigen::Vector4d;  // the plane, and the logarithm of the noise over what was thought

// The likelihood of planes, for samples about the border.
class BorderLikelihood {
 public:
  // `about_mm`: no plane leaves the band about this one, of which all samples are known.
  BorderLikelihood(std::vector<BorderSample> samples, const Eigen::Vector3d& missing,
                   double smear_mm, double slope_mm, const Eigen::Vector3d& about_mm,
                   double band_mm)
      : samples_(std::move(samples)),
        missing_(missing),
        about_mm_(about_mm),
        smear_mm_(smear_mm),
        band_mm_(band_mm) {
    certainty_ << 0.0, 1.0 / (slope_mm * slope_mm), 1.0 / (slope_mm * slope_mm);
    CountFrom(about_mm);
  }

  // Counts from this plane: the nearer the planes that are asked for lie to it, the fewer samples
  // are looked at.
  void CountFrom(const Eigen::Vector3d& plane) {
    from_mm_ = plane;
    const auto deep = [&](const BorderSample& sample) {
      return sample.row.dot(plane) - sample.at_mm;
    };
    std::sort(samples_.begin(), samples_.end(),
              [&](const BorderSample& a, const BorderSample& b) { return deep(a) < deep(b); });
    deep_mm_.clear();
    lanes_ = PlaneLanes(samples_.size());
    for (const BorderSample& sample : samples_) {
      deep_mm_.push_back(deep(sample));
      lanes_.Add(sample.row[1], sample.row[2], sample.at_mm, 1.0, 0);
    }
  }

  double samples() const { return static_cast<double>(samples_.size()); }

  bool KnowsSamplesAt(const Numbers& x) const {
    const Eigen::Vector3d off_mm = x.head<3>() - about_mm_;
    return std::abs(off_mm[0]) + off_mm.tail<2>().norm() < band_mm_;
  }

  // The logarithm of the likelihood.
  double Log(const Numbers& x) const {
    if (!KnowsSamplesAt(x)) return -1e300;
    static const EvenTable table = LogNormalCdf(kEndBorder.flier);
    return LogOfNumbers(x) + table.SumFirst(lanes_, CountNear(x), x.data(), 1.0 / SmearMm(x));
  }

  // The same, its slope and, negative, its curvature.
  double Log(const Numbers& x, Numbers* slope, Eigen::Matrix4d* curvature) const {
    const double s = SmearMm(x);
    const Eigen::Vector3d plane = x.head<3>();
    double log = LogOfNumbers(x);
    slope->setZero();
    slope->head<3>() = -missing_ - certainty_.cwiseProduct(plane);
    curvature->setZero();
    curvature->diagonal().head<3>() = certainty_;
    const std::size_t near = CountNear(x);
    for (std::size_t i = 0; i < near; ++i) {
      const BorderSample& sample = samples_[i];
      const double z = (sample.row.dot(plane) - sample.at_mm) / s;
      if (z > kFar) continue;
      const double covered = kEndBorder.flier + (1.0 - kEndBorder.flier) * 0.5 *
                                                    std::erfc(-z * std::numbers::sqrt2 / 2.0);
      log += std::log(covered);
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
  static constexpr double kFar = 6.0;  // [sigma] Behind a plane: certainly seen

  double SmearMm(const Numbers& x) const { return smear_mm_ * std::exp(x[3]); }
  // The first so many samples hold all that a plane may not cover.
  std::size_t CountNear(const Numbers& x) const {
    const Eigen::Vector3d moved_mm = x.head<3>() - from_mm_;
    const double far_mm = kFar * SmearMm(x) + std::abs(moved_mm[0]) + moved_mm.tail<2>().norm();
    return static_cast<std::size_t>(std::lower_bound(deep_mm_.begin(), deep_mm_.end(), far_mm) -
                                    deep_mm_.begin());
  }
  // What is expected of the plane, and what is missing beyond it.
  double LogOfNumbers(const Numbers& x) const {
    return -missing_.dot(x.head<3>()) - 0.5 * certainty_.dot(x.head<3>().cwiseAbs2());
  }

  std::vector<BorderSample> samples_;
  Eigen::Vector3d missing_;  // samples that each mm of the plane's numbers takes away
  Eigen::Vector3d about_mm_;
  Eigen::Vector3d from_mm_ = Eigen::Vector3d::Zero();
  std::vector<double> deep_mm_;  // of each sample, behind that plane; the least first
  double smear_mm_, band_mm_;
  Eigen::Vector3d certainty_ = Eigen::Vector3d::Zero();  // before the scan
  PlaneLanes lanes_;                                     // the samples, in their order
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
    const bool is_near = to.allFinite() && likelihood.KnowsSamplesAt(to) &&
                         std::abs(to[3]) < std::log(2.0 * kEndBorder.other_noise);
    Numbers slope_there;
    Eigen::Matrix4d curvature_there;
    const double there =
        is_near ? likelihood.Log(to, &slope_there, &curvature_there) : fit.log - 1.0;
    if (!(there > fit.log)) {
      if (is_near && fit.log - there < 1e-9) break;
      damping = std::max(1e-3, damping * 8.0);
      continue;
    }
    const bool is_done = there - fit.log < 1e-6;
    std::tie(fit.x, fit.log, slope, curvature) = std::tie(to, there, slope_there, curvature_there);
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

// The likeliest noise of all, sought from what was thought, and from less where that says nothing.
std::optional<BorderFitted> WithLikeliestNoise(const BorderLikelihood& likelihood,
                                               const Numbers& thought, bool knows_rays) {
  std::optional<BorderFitted> best;
  for (const double noise : kEndBorder.noises) {
    Numbers from = thought;
    from[3] = std::log(noise);
    const auto fit = Likeliest(likelihood, from, 4);
    if (fit && (!best || fit->log > best->log)) best = fit;
    if (knows_rays) break;
  }
  return best;
}

// Of what was thought of the noise (`thought`), and of what the samples say of it (`free`), by how
// likely they are.
Posterior Together(const BorderLikelihood& likelihood, const BorderFitted& thought,
                   const std::optional<BorderFitted>& free) {
  Posterior result{thought.x.head<3>(), thought.covariance.topLeftCorner<3, 3>()};
  if (!free) return result;
  if (std::abs(free->x[3]) > std::log(kEndBorder.other_noise)) {
    // Nothing like what was thought: as near to what they say as it may be.
    Numbers most = free->x;
    most[3] = std::copysign(std::log(kEndBorder.other_noise), most[3]);
    const auto other = Likeliest(likelihood, most, 3);
    if (!other || !(other->log > thought.log)) return result;
    return Posterior{other->x.head<3>(), other->covariance.topLeftCorner<3, 3>(), 0.0};
  }
  // Laplace's volume of one more number, of its prior's.
  const double volume = std::sqrt(2.0 * std::numbers::pi * free->covariance.determinant() /
                                  thought.covariance.topLeftCorner<3, 3>().determinant()) /
                        (2.0 * std::log(kEndBorder.other_noise));
  const double odds = std::exp(std::min(50.0, free->log - thought.log)) * volume;
  const double part = std::isfinite(odds) ? odds / (1.0 + odds) : 0.0;
  const Eigen::Vector3d apart = free->x.head<3>() - thought.x.head<3>();
  result.mean += part * apart;
  result.covariance *= 1.0 - part;
  result.covariance += part * free->covariance.topLeftCorner<3, 3>();
  result.covariance += part * (1.0 - part) * apart * apart.transpose();
  return result;
}

// [1/mm2] By how much surer the rise of an end is before the scan that is to be square.
double SurerOfSquare(const RoughEnd& rough) {
  return std::max(
      0.0, 1.0 / (rough.square_mm * rough.square_mm) - 1.0 / (rough.slope_mm * rough.slope_mm));
}

// What it would be of an end that is to be square.
Posterior OfSquare(const Posterior& any, const RoughEnd& rough) {
  Eigen::MatrixXd certainty = Inverse(any.covariance);
  const Eigen::VectorXd weighed = certainty * any.mean;
  certainty.diagonal().segment<2>(1).array() += SurerOfSquare(rough);
  const Eigen::MatrixXd covariance = Inverse(certainty);
  return {covariance * weighed, covariance, 0.0};
}

// Without the noise.
Posterior OfPlane(const Posterior& all) {
  return {all.mean.head<3>(), all.covariance.topLeftCorner<3, 3>(), 0.0};
}

// What was thought of the noise before, in logarithms: of its own over what was thought.
double LogOfNoise(double log_noise, bool knows_rays) {
  if (knows_rays) {
    return std::abs(log_noise) > std::log(kEndBorder.other_noise)
               ? -1e300
               : -std::log1p(std::pow(log_noise / kEndBorder.sure_noise, 2));
  }
  const double least = std::log(kEndBorder.least_noise);
  if (log_noise < least || log_noise > std::log(kEndBorder.other_noise)) return -1e300;
  const double off = log_noise / kEndBorder.as_thought;
  const double as_thought =
      std::exp(-0.5 * off * off) / (kEndBorder.as_thought * std::sqrt(2.0 * std::numbers::pi));
  const double less = (log_noise < 0 ? 1.0 : std::exp(-0.5 * off * off)) / -least;
  return std::log(as_thought + less);
}

// The same where few samples lie about the border, so that its likelihood has edges.
EndBorder Drawn(const BorderLikelihood& likelihood, const RoughEnd& rough, const Posterior& from,
                int draws, WalkDice& dice) {
  const auto log_of = [&](const Eigen::VectorXd& x) {
    const double log = LogOfNoise(x[3], rough.knows_rays);
    return log < -1e299 ? log : log + likelihood.Log(x);
  };
  const auto log_of_square = [&](const Eigen::VectorXd& x) {
    return -0.5 * SurerOfSquare(rough) * x.segment<2>(1).squaredNorm();
  };
  const WeighedDraws drawn = WeighPosterior(from, draws, dice, log_of);
  const Posterior any = drawn.Told();
  auto square = drawn.ToldTimes(log_of_square);
  if (!square) {
    const auto log_of_both = [&](const Eigen::VectorXd& x) { return log_of(x) + log_of_square(x); };
    square = WeighPosterior(OfSquare(any, rough), draws, dice, log_of_both).Told();
  }
  return {OfPlane(any), OfPlane(*square)};
}

// Of rays, whose noise is about what was thought.
EndBorder DrawnOfRays(const BorderLikelihood& likelihood, const RoughEnd& rough, WalkDice& dice) {
  Posterior from{Eigen::VectorXd::Zero(4), Eigen::MatrixXd::Zero(4, 4)};
  from.mean.head<3>() = rough.plane.mean.head<3>();
  from.covariance.topLeftCorner<3, 3>() = rough.plane.covariance;
  from.covariance(3, 3) = kEndBorder.sure_noise * kEndBorder.sure_noise;
  return Drawn(likelihood, rough, from, kEndBorder.draws, dice);
}

// The likeliest of many places and noises of a cloud. An edge is as unsure as samples lie apart,
// `gap_mm`.
Numbers LikeliestOfMany(BorderLikelihood& likelihood, const RoughEnd& rough, double gap_mm) {
  double most = -1e300;
  double wide_mm = 4.0 * std::hypot(rough.plane.Sigma(0), gap_mm, rough.smear_mm);
  Numbers likeliest = Numbers::Zero();
  likeliest.head<3>() = rough.plane.mean.head<3>();
  // From wide to narrow: of less noise the border lies near to where it does of more.
  for (const double noise : kEndBorder.noises) {
    const Eigen::Vector3d middle = likeliest.head<3>();
    likelihood.CountFrom(middle);
    for (int i = -kEndBorder.places; i <= kEndBorder.places; ++i) {
      Numbers x;
      x << middle, std::log(noise);
      x[0] += wide_mm * i / kEndBorder.places;
      const double log = likelihood.Log(x) + LogOfNoise(x[3], false);
      if (log > most) std::tie(most, likeliest) = std::make_tuple(log, x);
    }
    wide_mm = std::min(wide_mm, 4.0 * std::hypot(gap_mm, rough.smear_mm * noise));
  }
  return likeliest;
}

// Of a cloud, from there; closer draws would see one edge only.
EndBorder DrawnOfCloud(BorderLikelihood& likelihood, const RoughEnd& rough, double gap_mm,
                       const Numbers& likeliest, WalkDice& dice) {
  Posterior from{likeliest, Eigen::MatrixXd::Zero(4, 4), 0.0};
  const double edge_mm = std::hypot(gap_mm, 0.3 * rough.smear_mm * std::exp(likeliest[3]));
  const double slope_mm = std::min(rough.slope_mm, 1.5 * edge_mm);
  from.covariance.diagonal() << edge_mm * edge_mm, slope_mm * slope_mm, slope_mm * slope_mm, 0.1;
  likelihood.CountFrom(from.mean.head<3>());
  const double draws = std::clamp<double>(kEndBorder.cloud_looked_at / likelihood.samples(),
                                          kEndBorder.least_of_cloud, kEndBorder.most_of_cloud);
  return Drawn(likelihood, rough, from, static_cast<int>(draws), dice);
}

// The planes that the likelihood leaves. `about`: samples within 2 sigma of noise of it.
std::optional<EndBorder> Among(BorderLikelihood& likelihood, const RoughEnd& rough, double about,
                               double spread_mm, WalkDice& dice) {
  const double gap_mm = 2.0 * rough.smear_mm / about;
  const auto are_few = [about](double log_noise) {
    return about * std::exp(std::min(0.0, log_noise)) < kEndBorder.enough_about;
  };
  if (rough.knows_rays && are_few(0.0)) return DrawnOfRays(likelihood, rough, dice);
  if (!rough.knows_rays) {
    const Numbers likeliest = LikeliestOfMany(likelihood, rough, gap_mm);
    if (are_few(likeliest[3])) return DrawnOfCloud(likelihood, rough, gap_mm, likeliest, dice);
  }
  const Eigen::Vector3d plane_mm = rough.plane.mean.head<3>();
  const auto thought =
      Likeliest(likelihood, StartOf(likelihood, plane_mm, spread_mm / rough.smear_mm), 3);
  if (!thought) return std::nullopt;
  const auto free = WithLikeliestNoise(likelihood, thought->x, rough.knows_rays);
  if (!rough.knows_rays && free && are_few(free->x[3])) {
    return DrawnOfCloud(likelihood, rough, gap_mm, free->x, dice);
  }
  const Posterior plane = Together(likelihood, *thought, free);
  return EndBorder{plane, OfSquare(plane, rough)};
}

}  // namespace

std::optional<EndBorder> FitEndBorder(const RoughEnd& known, const EndBand& band, WalkDice& dice) {
  RoughEnd rough = known;
  const Eigen::Vector3d plane_mm = rough.plane.mean;
  const double r_mm = rough.pipe_radius_mm;
  // At the worst place around; the slopes' own are each as wide as that of the place, or wider.
  const double spread_mm = std::sqrt(std::max(0.0, rough.plane.covariance.trace()));
  const double band_mm = kEndBorder.smears * rough.smear_mm + kEndBorder.spreads * spread_mm;
  const double turn_mm = 2.0 * std::numbers::pi * r_mm;
  const double deep_mm = std::min(kEndBorder.deepest * r_mm,
                                  kEndBorder.of_density / std::max(1e-9, rough.per_mm2 * turn_mm));
  if (!(deep_mm > 0) || !(band_mm < r_mm)) return std::nullopt;
  double about = 2.0 * rough.per_mm2 * turn_mm * rough.smear_mm;
  if (about < kEndBorder.enough_about && !rough.is_thinned && rough.knows_rays) return std::nullopt;
  std::vector<BandSample> samples = band(plane_mm, band_mm + deep_mm, band_mm);
  const std::size_t stride = rough.knows_rays ? 1 : StrideTo(samples.size(), kEndBorder.of_cloud);
  if (stride > 1) {
    for (std::size_t i = 0; i * stride < samples.size(); ++i) samples[i] = samples[i * stride];
    samples.resize((samples.size() + stride - 1) / stride);
    rough.per_mm2 /= static_cast<double>(stride);
    about /= static_cast<double>(stride);
  }
  const BandColumns columns(samples, plane_mm, rough.hidden, band_mm, deep_mm);
  if (!columns.AreScattered(rough.smear_mm)) return std::nullopt;
  Eigen::Vector3d missing;
  const auto seen = columns.Seen(spread_mm, missing);
  if (!seen) return std::nullopt;
  BorderLikelihood likelihood(*seen, missing, rough.smear_mm, rough.slope_mm, plane_mm, band_mm);
  auto border = Among(likelihood, rough, about, spread_mm, dice);
  if (!border) return std::nullopt;
  // Where samples are of another density than behind the border it is elsewhere.
  const double gap_mm = 1.0 / (rough.per_mm2 * turn_mm);
  const double doubt_mm =
      columns.DensityDoubt() * std::max(kEndBorder.by_density * rough.smear_mm, gap_mm);
  border->plane.covariance(0, 0) += doubt_mm * doubt_mm;
  border->square.covariance(0, 0) += doubt_mm * doubt_mm;
  return border;
}

}  // namespace bendloop::pipeline
