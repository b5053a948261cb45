// SPDX-License-Identifier: Apache-2.0
#include "pipeline/features/opening_likelihood.h"

#include <algorithm>
#include <cmath>

namespace bendloop::pipeline {
namespace {

struct LikelihoodSettings {
  double flier = 1e-3;  // part of the samples that may lie anywhere
  // Part of the rays that meet the wall and return nothing: beside a border a tenth does, whose
  // spot lies on both sides of it.
  double lost = 0.12;
  // Of the smear: samples of laser lines lie where their rays met the wall (opening_surroundings.h)
  // but for how well the wall is known.
  double of_lines = 0.2;
  double sure = 5.0;  // [sigma] From the border: certainly outside, or inside
  // [of its width, and of its length] Samples further outside tell nothing, nor is it there. What
  // is roughly the border of a slot may be too short.
  double near = 0.35, near_along = 0.25;
};
constexpr LikelihoodSettings kLikelihood;

// What of samples or rays lies on the wrong side.
struct Otherwise {
  double part, log_part = std::log(part);
};
const Otherwise kFliers{kLikelihood.flier}, kLost{kLikelihood.lost};

double LogCovered(double distance_mm, double variance_mm2, const Otherwise& otherwise) {
  if (distance_mm * distance_mm > kLikelihood.sure * kLikelihood.sure * variance_mm2) {
    return distance_mm > 0 ? 0.0 : otherwise.log_part;
  }
  const double covered = 0.5 * std::erfc(-distance_mm / std::sqrt(2.0 * variance_mm2));
  return std::log(otherwise.part + (1.0 - otherwise.part) * covered);
}

// Of a place so far off, whose ray is unsure sideways as well.
double VarianceMm2(double smear_mm, double sideways_sigma_mm, double sideways_mm,
                   double square_mm2) {
  const double moved_mm = sideways_sigma_mm * sideways_mm;
  return smear_mm * smear_mm + moved_mm * moved_mm / std::max(square_mm2, 1e-18);
}

}  // namespace

OpeningLikelihood::OpeningLikelihood(std::span<const Eigen::Vector2d> samples,
                                     std::span<const MissedPlace> missed,
                                     std::span<const Eigen::Vector2d> scattered,
                                     const OpeningBorder& about, double smear_mm)
    : zone_(about),
      smear_mm_(missed.empty() ? smear_mm : kLikelihood.of_lines * smear_mm),
      density_(DensityBeside(about, scattered)) {
  zone_.length_mm *= 1.0 + 2.0 * kLikelihood.near_along;
  for (const Eigen::Vector2d& sample : samples) {
    if (IsInZone(sample)) near_.push_back(sample);
  }
  // The nearest first: most others lie nowhere near any border that is walked over.
  std::sort(near_.begin(), near_.end(), [&](const Eigen::Vector2d& a, const Eigen::Vector2d& b) {
    return (a - zone_.middle_mm).squaredNorm() < (b - zone_.middle_mm).squaredNorm();
  });
  for (const Eigen::Vector2d& sample : near_) {
    near_far_mm_.push_back((sample - zone_.middle_mm).norm());
    near_up_.push_back(HeightMm(sample.y()));
  }
  const auto [low, high] = std::minmax_element(near_up_.begin(), near_up_.end());
  if (!near_up_.empty()) lowest_up_ = *low, highest_up_ = *high;
  for (const MissedPlace& place : missed) {
    sideways_smear_mm_ += place.sideways_sigma_mm / static_cast<double>(missed.size());
    if (!IsInZone(place.place_mm)) continue;
    missed_.push_back(place);
    missed_up_.push_back(HeightMm(place.place_mm.y()));
  }
}

bool OpeningLikelihood::IsInZone(const Eigen::Vector2d& place_mm) const {
  return zone_.DistanceMm(place_mm) < kLikelihood.near * zone_.width_mm;
}

bool OpeningLikelihood::HasSampleBeyond(const Eigen::Vector2d& place_mm,
                                        const Eigen::Vector2d& direction) const {
  return std::any_of(near_.begin(), near_.end(), [&](const Eigen::Vector2d& sample) {
    return (sample - place_mm).dot(direction) > 0;
  });
}

double OpeningLikelihood::Log(const OpeningBorder& border, double blur) const {
  return density_.Missing(border, zone_.middle_mm) +
         (border.lean.isZero() ? LogFlat(border, blur) : LogLeaning(border, blur));
}

// Most samples and rays lie nowhere near the border.
double OpeningLikelihood::LogFlat(const OpeningBorder& border, double blur) const {
  const double c = std::cos(border.axis_rad), s = std::sin(border.axis_rad);
  const double half_line_mm = 0.5 * (border.length_mm - border.width_mm);
  // From the line about which it is cut.
  const auto off = [&](const Eigen::Vector2d& place) {
    const Eigen::Vector2d from = place - border.middle_mm;
    const double along = c * from.x() + s * from.y();
    const double beyond = std::copysign(std::max(0.0, std::abs(along) - half_line_mm), along);
    const double across = c * from.y() - s * from.x();
    return Eigen::Vector2d(c * beyond - s * across, s * beyond + c * across);
  };
  double log = 0;
  const std::size_t reached = Reached(border, half_line_mm + FreeMm(border.width_mm, blur));
  for (std::size_t i = 0; i < reached; ++i) {
    const Eigen::Vector2d from = off(near_[i]);
    log += LogHit(from.squaredNorm(), border.width_mm, from.y(), blur);
  }
  for (const MissedPlace& missed : missed_) {
    const Eigen::Vector2d from = off(missed.place_mm);
    log += LogMissed(from.squaredNorm(), border.width_mm, from.y(), missed.sideways_sigma_mm, blur);
  }
  return log;
}

double OpeningLikelihood::LogLeaning(const OpeningBorder& border, double blur) const {
  const double middle_up = HeightMm(border.middle_mm.y());
  const double per_square = 1.0 / (1.0 + border.lean.squaredNorm());
  const auto square = [&](const Eigen::Vector2d& from, double place_up) {
    const double up = place_up - middle_up;
    const double out = from.dot(border.lean) + up;
    return std::max(0.0, from.squaredNorm() + up * up - out * out * per_square);
  };
  // A place that so much of the wall's height moves aside, on an oval that is so much longer.
  const double moved_mm =
      border.lean.norm() * std::max(highest_up_ - middle_up, middle_up - lowest_up_);
  const double longer = std::sqrt(1.0 + border.lean.squaredNorm());
  const std::size_t reached = Reached(border, moved_mm + longer * FreeMm(border.width_mm, blur));
  double log = 0;
  for (std::size_t i = 0; i < reached; ++i) {
    const Eigen::Vector2d from = near_[i] - border.middle_mm;
    log += LogHit(square(from, near_up_[i]), border.width_mm, from.y(), blur);
  }
  for (std::size_t i = 0; i < missed_.size(); ++i) {
    const Eigen::Vector2d from = missed_[i].place_mm - border.middle_mm;
    log += LogMissed(square(from, missed_up_[i]), border.width_mm, from.y(),
                     missed_[i].sideways_sigma_mm, blur);
  }
  return log;
}

// Of a place by its squared distance from the opening's middle line.
double OpeningLikelihood::LogHit(double square_mm2, double width_mm, double sideways_mm,
                                 double blur) const {
  const double half_mm = 0.5 * width_mm;
  const double free_mm = FreeMm(width_mm, blur);
  if (square_mm2 > free_mm * free_mm) return 0;
  return LogCovered(
      std::sqrt(square_mm2) - half_mm,
      blur * blur * VarianceMm2(smear_mm_, sideways_smear_mm_, sideways_mm, square_mm2), kFliers);
}

double OpeningLikelihood::LogMissed(double square_mm2, double width_mm, double sideways_mm,
                                    double sideways_sigma_mm, double blur) const {
  const double half_mm = 0.5 * width_mm;
  const double sure_mm = half_mm - blur * kLikelihood.sure * (smear_mm_ + sideways_sigma_mm);
  if (sure_mm > 0 && square_mm2 < sure_mm * sure_mm) return 0;
  return LogCovered(
      half_mm - std::sqrt(square_mm2),
      blur * blur * VarianceMm2(smear_mm_, sideways_sigma_mm, sideways_mm, square_mm2), kLost);
}

double OpeningLikelihood::HeightMm(double y_mm) const {
  return std::sqrt(std::max(0.0, zone_.pipe_radius_mm * zone_.pipe_radius_mm - y_mm * y_mm));
}

// As many samples as lie no further than this from the border's middle, and a few more.
std::size_t OpeningLikelihood::Reached(const OpeningBorder& border, double reach_mm) const {
  const double to_mm = reach_mm + (border.middle_mm - zone_.middle_mm).norm();
  const auto end = std::upper_bound(near_far_mm_.begin(), near_far_mm_.end(), to_mm);
  return static_cast<std::size_t>(end - near_far_mm_.begin());
}

double OpeningLikelihood::FreeMm(double width_mm, double blur) const {
  return 0.5 * width_mm + blur * kLikelihood.sure * (smear_mm_ + sideways_smear_mm_);
}

}  // namespace bendloop::pipeline
