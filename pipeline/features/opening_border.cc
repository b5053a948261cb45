// SPDX-License-Identifier: Apache-2.0
#include "pipeline/features/opening_border.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>
#include <vector>

#include "pipeline/features/posterior.h"
#include "pipeline/math/dense_solve.h"

namespace bendloop::pipeline {
namespace {

struct BorderSettings {
  // [sigma] A slot is longer than wide by so much, and by this part of its width.
  double slot_sigmas = 5.0, slot_part = 0.08;
  // [sigma] From radial; drills that are closer are taken for it.
  double lean_sigmas = 5.0;
  // 1 sigma of a lean before the scan, and its most: drills are radial, or lean by tens of degrees.
  double usual_lean = 0.35, most_lean = 1.2;
  // [1 sigma of the place] So far a lean of 1 moves the border at least, or nothing tells of it.
  double least_sag = 6.0;
  double flier = 1e-3;  // part of the samples that may lie anywhere
  // [of its width] Samples further outside tell nothing.
  double near = 0.35;
  // Steps of the walk, and of one that says whether a hole may lean at all, from so many sigma on.
  int walk = 2500, short_walk = 600;
  double may_lean = 2.5;
};
constexpr BorderSettings kBorder;

double LogCovered(double distance_mm, double smear_mm) {
  const double covered = 0.5 * std::erfc(-distance_mm / smear_mm * std::numbers::sqrt2 / 2.0);
  return std::log(kBorder.flier + (1.0 - kBorder.flier) * covered);
}

enum class Shape { kHole, kLeaningHole, kSlot };

// Numbers of a border in the walk: place, half width; of a slot half of what it is longer and the
// axis, of a leaning hole its lean.
OpeningBorder BorderOf(const Eigen::VectorXd& x, Shape shape, double pipe_radius_mm) {
  OpeningBorder border;
  border.pipe_radius_mm = pipe_radius_mm;
  border.middle_mm = x.head<2>();
  border.width_mm = 2.0 * x[2];
  border.length_mm = border.width_mm + (shape == Shape::kSlot ? 2.0 * x[3] : 0.0);
  border.axis_rad = shape == Shape::kSlot ? x[4] : 0.0;
  if (shape == Shape::kLeaningHole) border.lean = x.tail<2>();
  return border;
}

// A border of one shape with the logarithm of its density.
struct ShapeFit {
  FittedOpening fitted;
  double log_density = 0;
  double leans_sigmas = 0;  // how many sigma the drill is from radial
};

class BorderFit {
 public:
  BorderFit(std::span<const Eigen::Vector2d> samples, const OpeningBorder& about, Shape shape,
            double smear_mm)
      : about_(about), shape_(shape), smear_mm_(smear_mm), density_(DensityBeside(about, samples)) {
    for (const Eigen::Vector2d& sample : samples) {
      if (about.DistanceMm(sample) < kBorder.near * about.width_mm) near_.push_back(sample);
    }
    for (const Eigen::Vector2d& sample : near_) near_up_.push_back(HeightMm(sample.y()));
  }

  double LogDensity(const Eigen::VectorXd& x) const {
    constexpr double kNever = -1e300;
    if (x[2] < 0.25 * about_.width_mm || x[2] > about_.width_mm) return kNever;
    double log = 0;
    if (shape_ == Shape::kSlot &&
        (x[3] < 0 || std::abs(x[4] - about_.axis_rad) > 0.5 * std::numbers::pi)) {
      return kNever;
    }
    if (shape_ == Shape::kLeaningHole) {
      const double lean = std::hypot(x[3], x[4]);
      if (lean > kBorder.most_lean) return kNever;
      log -= 0.5 * std::pow(lean / kBorder.usual_lean, 2);
    }
    const OpeningBorder border = BorderOf(x, shape_, about_.pipe_radius_mm);
    log += density_.Missing(border, about_.middle_mm);
    return log + (shape_ == Shape::kLeaningHole ? LogLeaning(border) : LogFlat(border));
  }

  ShapeFit Fit(int walk) const {
    const int numbers = shape_ == Shape::kHole ? 3 : 5;
    Eigen::VectorXd start(numbers), scale(numbers);
    const double scale_mm = 0.02 * about_.width_mm;
    start.head<3>() << about_.middle_mm, 0.48 * about_.width_mm;
    scale.head<3>().setConstant(scale_mm);
    if (shape_ == Shape::kSlot) {
      start.tail<2>() << 0.5 * (about_.length_mm - about_.width_mm), about_.axis_rad;
      scale.tail<2>() << scale_mm, scale_mm / about_.length_mm;
    } else if (shape_ == Shape::kLeaningHole) {
      start.tail<2>() = about_.lean;
      scale.tail<2>().setConstant(0.1);
    }
    const Posterior posterior = SamplePosterior(
        start, scale, walk, [this](const Eigen::VectorXd& x) { return LogDensity(x); });
    return Taken(posterior);
  }

 private:
  // What the samples say; most of them lie nowhere near the border.
  double LogFlat(const OpeningBorder& border) const {
    const double c = std::cos(border.axis_rad), s = std::sin(border.axis_rad);
    const double half_mm = 0.5 * border.width_mm, free_mm = half_mm + 5.0 * smear_mm_;
    const double half_line_mm = 0.5 * (border.length_mm - border.width_mm);
    double log = 0;
    for (const Eigen::Vector2d& sample : near_) {
      const Eigen::Vector2d from = sample - border.middle_mm;
      const double along = std::max(0.0, std::abs(c * from.x() + s * from.y()) - half_line_mm);
      const double across = c * from.y() - s * from.x();
      const double square = along * along + across * across;
      if (square > free_mm * free_mm) continue;
      log += LogCovered(std::sqrt(square) - half_mm, smear_mm_);
    }
    return log;
  }
  double LogLeaning(const OpeningBorder& border) const {
    const double half_mm = 0.5 * border.width_mm, free_mm = half_mm + 5.0 * smear_mm_;
    const double middle_up = HeightMm(border.middle_mm.y());
    const double per_square = 1.0 / (1.0 + border.lean.squaredNorm());
    double log = 0;
    for (std::size_t i = 0; i < near_.size(); ++i) {
      const double x = near_[i].x() - border.middle_mm.x();
      const double y = near_[i].y() - border.middle_mm.y();
      const double up = near_up_[i] - middle_up;
      const double out = x * border.lean.x() + y * border.lean.y() + up;
      const double square = x * x + y * y + up * up - out * out * per_square;
      if (square > free_mm * free_mm) continue;
      log += LogCovered(std::sqrt(std::max(0.0, square)) - half_mm, smear_mm_);
    }
    return log;
  }
  double HeightMm(double y_mm) const {
    return std::sqrt(std::max(0.0, about_.pipe_radius_mm * about_.pipe_radius_mm - y_mm * y_mm));
  }

  ShapeFit Taken(const Posterior& posterior) const {
    ShapeFit fit;
    FittedOpening& fitted = fit.fitted;
    fitted.border = BorderOf(posterior.mean, shape_, about_.pipe_radius_mm);
    fitted.sigma.middle_mm = {posterior.Sigma(0), posterior.Sigma(1)};
    fitted.sigma.width_mm = 2.0 * posterior.Sigma(2);
    fitted.sigma.length_mm = fitted.sigma.width_mm;
    const Eigen::MatrixXd& c = posterior.covariance;
    if (shape_ == Shape::kSlot) {
      fitted.sigma.length_mm = 2.0 * std::sqrt(std::max(0.0, c(2, 2) + c(3, 3) + 2.0 * c(2, 3)));
      fitted.sigma.axis_rad = posterior.Sigma(4);
    } else if (shape_ == Shape::kLeaningHole) {
      fitted.sigma.lean = {posterior.Sigma(3), posterior.Sigma(4)};
      const Eigen::Vector2d lean = posterior.mean.tail<2>();
      const Eigen::Vector2d solved = SolveSymmetric(c.bottomRightCorner<2, 2>(), lean);
      fit.leans_sigmas = std::sqrt(std::max(0.0, lean.dot(solved)));
    }
    fit.log_density = LogDensity(posterior.mean);
    return fit;
  }

  OpeningBorder about_;
  Shape shape_;
  double smear_mm_;
  SampleDensity density_;
  std::vector<Eigen::Vector2d> near_;
  std::vector<double> near_up_;  // how high the wall is at each
};

// The leaning hole, if it certainly leans.
std::optional<ShapeFit> FitLean(std::span<const Eigen::Vector2d> samples, OpeningBorder about,
                                double smear_mm) {
  about.length_mm = about.width_mm;
  const BorderFit leaning(samples, about, Shape::kLeaningHole, smear_mm);
  ShapeFit fit = leaning.Fit(kBorder.short_walk);
  if (fit.leans_sigmas < kBorder.may_lean) return std::nullopt;
  fit = leaning.Fit(kBorder.walk);
  if (fit.leans_sigmas < kBorder.lean_sigmas) return std::nullopt;
  return fit;
}

// How far a lean of 1 moves the border of a round hole, at most.
double SagMm(const OpeningBorder& border) {
  return border.pipe_radius_mm > 0
             ? border.width_mm * border.width_mm / (8.0 * border.pipe_radius_mm)
             : 0.0;
}

}  // namespace

double OpeningBorder::DistanceMm(const Eigen::Vector2d& place_mm) const {
  const Eigen::Vector2d from = place_mm - middle_mm;
  if (!lean.isZero()) {
    const auto height = [this](double y) {
      return std::sqrt(std::max(0.0, pipe_radius_mm * pipe_radius_mm - y * y));
    };
    const double up = height(place_mm.y()) - height(middle_mm.y());
    // Across the drill's axis (lean, 1).
    const double square = from.squaredNorm() + up * up;
    const double out = (from.dot(lean) + up) / std::sqrt(1.0 + lean.squaredNorm());
    return std::sqrt(std::max(0.0, square - out * out)) - 0.5 * width_mm;
  }
  if (is_hole()) return from.norm() - 0.5 * width_mm;
  const double c = std::cos(axis_rad), s = std::sin(axis_rad);
  const double along = std::abs(c * from.x() + s * from.y()) - 0.5 * (length_mm - width_mm);
  const double across = c * from.y() - s * from.x();
  return std::hypot(std::max(0.0, along), across) - 0.5 * width_mm;
}

double OpeningBorder::AreaMm2() const {
  return (0.25 * std::numbers::pi * width_mm * width_mm + (length_mm - width_mm) * width_mm) *
         std::sqrt(1.0 + lean.squaredNorm());
}

SampleDensity DensityBeside(const OpeningBorder& border, std::span<const Eigen::Vector2d> wall) {
  const double to_mm = 0.4 * border.width_mm;
  double count = 0;
  Eigen::Vector2d mean = Eigen::Vector2d::Zero();
  Eigen::Matrix2d square = Eigen::Matrix2d::Zero();
  for (const Eigen::Vector2d& place : wall) {
    const double off_mm = border.DistanceMm(place);
    if (!(off_mm > 0 && off_mm < to_mm)) continue;
    const Eigen::Vector2d from = place - border.middle_mm;
    count += 1;
    mean += from;
    square += from * from.transpose();
  }
  OpeningBorder wider = border;
  wider.width_mm += 2.0 * to_mm;
  wider.length_mm += 2.0 * to_mm;
  SampleDensity density;
  density.per_mm2 = count / (wider.AreaMm2() - border.AreaMm2());
  if (square(0, 0) * square(1, 1) > square(0, 1) * square(1, 0)) {
    density.slope = SolveSymmetric(square, mean);
  }
  // No side has fewer than none.
  const double most = 1.8 / border.length_mm;
  if (density.slope.norm() > most) density.slope *= most / density.slope.norm();
  return density;
}

FittedOpening FitOpening(std::span<const Eigen::Vector2d> samples, const OpeningBorder& about,
                         double smear_mm) {
  const ShapeFit slot = BorderFit(samples, about, Shape::kSlot, smear_mm).Fit(kBorder.walk);
  const OpeningBorder& long_one = slot.fitted.border;
  const double longer_mm = long_one.length_mm - long_one.width_mm;
  const double sigma_mm = std::hypot(slot.fitted.sigma.length_mm, slot.fitted.sigma.width_mm);
  const bool is_long = longer_mm > kBorder.slot_sigmas * sigma_mm &&
                       longer_mm > kBorder.slot_part * long_one.width_mm;
  OpeningBorder round = long_one;
  round.width_mm = round.length_mm = std::sqrt(long_one.AreaMm2() * 4.0 / std::numbers::pi);
  if (is_long) {
    // A drill that leans along the long axis leaves an oval, too, no longer than leans allow.
    const double lean = std::sqrt(std::pow(long_one.length_mm / long_one.width_mm, 2) - 1.0);
    if (lean > kBorder.most_lean || !(about.pipe_radius_mm > 0)) return slot.fitted;
    round.width_mm = round.length_mm = long_one.width_mm;
    std::optional<ShapeFit> best;
    for (const double side : {-1.0, 1.0}) {
      round.lean =
          side * lean * Eigen::Vector2d(std::cos(long_one.axis_rad), std::sin(long_one.axis_rad));
      const auto leaning = FitLean(samples, round, smear_mm);
      if (leaning && (!best || leaning->log_density > best->log_density)) best = leaning;
    }
    return best && best->log_density > slot.log_density ? best->fitted : slot.fitted;
  }
  const ShapeFit hole = BorderFit(samples, round, Shape::kHole, smear_mm).Fit(kBorder.walk);
  if (SagMm(hole.fitted.border) > kBorder.least_sag * hole.fitted.sigma.middle_mm.norm()) {
    if (const auto leaning = FitLean(samples, hole.fitted.border, smear_mm)) return leaning->fitted;
  }
  return hole.fitted;
}

}  // namespace bendloop::pipeline
