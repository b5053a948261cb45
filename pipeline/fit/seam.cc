// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/seam.h"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <memory>
#include <numbers>
#include <numeric>
#include <utility>
#include <vector>

#include "hal/angles.h"
#include "hal/spine.h"
#include "pipeline/fit/place_sums.h"
#include "pipeline/fit/seam_fit.h"
#include "pipeline/fit/surface_pass.h"
#include "pipeline/math/quantiles.h"

namespace bendloop::pipeline {
namespace {

constexpr double kWholeTurn = 2.0 * std::numbers::pi;
constexpr double kFullWidth = 2.3548200450309493;  // [sigma] where a Gaussian is half as high
// Of the turn, a third as wide as the narrowest ridge; and of the spine's length.
constexpr int kBins = 720, kParts = 8;

// By trial where nothing else is said.
struct SeamSettings {
  // Points that tell of one. Without a seam of a noise's height their design effect is less, and so
  // is, [of the points], what a narrow one that is many noises high leaves out of the fit.
  std::size_t enough_points = 40'000;
  double design_effect = 1.15, left_out = 0.004;
  // And that tell its numbers.
  std::size_t many_points = 400'000;
  // [rad] 1 sigma of a Gaussian across: flash of two to six tenths of a wall.
  std::array<double, 7> widths = {0.025, 0.035, 0.05, 0.075, 0.11, 0.15, 0.2};
  // [rad] A narrower one is told where its samples agree: bins that hold a sensor's few angles look
  // like one.
  double narrow = 0.05;
  // [of its width] Between places where one is looked for.
  double step = 0.35;
  // [of the bins] Of either flank's outer half that tell of it.
  double flank_bins = 0.1;
  // [sigma] So far below the wall lies what is none of it, as the inner wall seen through an
  // opening.
  double below = 5.0;
  // [sigma] From which on there is a ridge, and from which on a part of the tube can tell of it.
  double insist = 8.0, tells = 3.0;
  // [of the noise] A lower one may be where the edges of passes meet that drift.
  double least = 0.75;
  // [of the tube's parts] That can tell: so many, and so many of them see it about as high: to so
  // much of its height beside noise.
  int least_parts = 4;
  double agree = 0.75, about = 0.35, noise_sigmas = 3.0;
  // [of its height] Half of them see more: what one alone sees raises the height of all.
  double usual = 0.6;
  // [of r_P] Of a piece of the tube that has its own wall beside it.
  double piece = 3.0;
  // [of the square of noise over width] Noise of a flank's points is along the wall, too, and blurs
  // the ridge: by so much it is lower and wider, as noise is along the normal (1) or along rays (a
  // half at most), and 1 sigma of that.
  double blurs = 0.7, blurs_sigma = 0.4;
  // [of its height] 1 sigma of what a seam may be like that a Gaussian is not.
  double of_form = 0.004;
  // [of r_P] From the spine: what is further away is in no fit.
  double reach = 1.5;
  // [of the noise] So high the ridge may still be where points begin to count.
  double rim = 0.15;
};
constexpr SeamSettings kSeam;

// An angle around that stays the same all along a tube which is not twisted, counted from a
// direction across its first segment, right-handed about the feed. Segment by segment.
class Untwisted {
 public:
  Untwisted(const std::vector<hal::SpineSegment>& segments, Eigen::Vector3d zero) {
    for (const hal::SpineSegment& segment : segments) {
      zero_.push_back(segment.axes().transpose() * zero);
      if (segment.is_arc()) zero = Eigen::AngleAxisd(segment.angle_rad(), segment.normal) * zero;
    }
  }
  // `x`, `y`, `z`: in the segment's frame; a bend's, whose y counts from its centre.
  double At(std::size_t segment, const hal::SpineSegment& of, double x, double y, double z) const {
    // Carried back to the segment's start, where it begins at -y.
    const double inward = of.is_arc() ? of.bend_radius_mm - std::hypot(x, y) : y;
    const Eigen::Vector3d& zero = zero_[segment];
    return std::atan2(zero.y() * z - zero.z() * inward, zero.y() * inward + zero.z() * z);
  }

 private:
  std::vector<Eigen::Vector3d> zero_;
};

// `zero`: whose first bend's normal angles count from.
std::vector<SeamSample> SamplesOf(const BowedTubeState& state, const hal::Tube& zero,
                                  std::span<const PointBlock> blocks, double reach_mm) {
  const EasedSpine spine = SpineOf(state);
  const SurfaceAssignment points = PointsOf(state, spine, 0.0, blocks, reach_mm);
  const Untwisted untwisted(spine.segments,
                            hal::SpineSegments(zero.program, zero.X_WT).front().normal);
  std::vector<SeamSample> samples;
  samples.reserve(points.distances_mm.size());
  for (std::size_t k = 0; k < spine.segments.size(); ++k) {
    const SegmentPoints& of = points.segments[k];
    const hal::SpineSegment& segment = spine.segments[k];
    for (Eigen::Index i = 0; i < static_cast<Eigen::Index>(of.size); ++i) {
      const double weight = of.weighted ? of.weight[i] : 1.0;
      samples.push_back({segment.from_start_mm + AlongOf(of, i, segment),
                         untwisted.At(k, segment, of.x[i], of.y[i], of.z[i]),
                         of.distance[i] / std::sqrt(weight), weight});
    }
  }
  return samples;
}

// Distances from the surface by place around.
struct Turn {
  std::array<double, kBins> count{}, sum_mm{};

  static std::size_t BinOf(double around_rad) {
    const double turns = around_rad / kWholeTurn;
    return static_cast<std::size_t>((turns - std::floor(turns)) * kBins) % kBins;
  }
  static double MiddleRad(std::size_t bin) {
    return (static_cast<double>(bin) + 0.5) * kWholeTurn / kBins;
  }
};

// Heights of Gaussian ridges of one width on a wall that curves evenly beside them, as one does
// that the tube's fit left off: least squares of the bins there.
class RidgesSoWide {
 public:
  explicit RidgesSoWide(double width_rad)
      : width_rad_(width_rad),
        half_(static_cast<int>(LookedAtBeside(width_rad) / kWholeTurn * kBins)) {
    for (int k = -half_; k <= half_; ++k) {
      const double x = static_cast<double>(k) / half_;
      const double beside = k * kWholeTurn / kBins / width_rad;
      shapes_.emplace_back(1.0, x, x * x, std::exp(-0.5 * beside * beside));
    }
  }

  // `bin`: the ridge's middle.
  Ridge At(const Turn& turn, std::size_t bin, double noise_mm) const {
    Eigen::Matrix4d matrix = Eigen::Matrix4d::Zero();
    Eigen::Vector4d right = Eigen::Vector4d::Zero();
    std::array<int, 2> flank{};
    for (int k = -half_; k <= half_; ++k) {
      const auto at = (bin + static_cast<std::size_t>(k + kBins)) % kBins;
      if (!(turn.count[at] > 0)) continue;
      if (2 * std::abs(k) > half_) ++flank[k > 0 ? 1 : 0];
      const Eigen::Vector4d& shapes = shapes_[static_cast<std::size_t>(k + half_)];
      matrix += turn.count[at] * shapes * shapes.transpose();
      right += turn.sum_mm[at] * shapes;
    }
    Ridge ridge{Turn::MiddleRad(bin), width_rad_};
    if (std::min(flank[0], flank[1]) < kSeam.flank_bins * 0.5 * half_) return ridge;
    const Eigen::Matrix4d inverse = matrix.inverse();
    if (!inverse.allFinite() || !(inverse(3, 3) > 0)) return ridge;
    ridge.height_mm = (inverse * right)[3];
    ridge.height_sigma_mm = noise_mm * std::sqrt(inverse(3, 3));
    return ridge;
  }

 private:
  double width_rad_;
  int half_;  // [bins]
  std::vector<Eigen::Vector4d> shapes_;
};

// The tube's samples, part by part of its length and all together.
class RidgeSearch {
 public:
  RidgeSearch(std::span<const SeamSample> samples, double long_mm, double noise_mm)
      : noise_mm_(noise_mm) {
    for (const SeamSample& sample : samples) {
      if (sample.off_mm * std::sqrt(sample.weight) < -kSeam.below * noise_mm) continue;
      const auto part = static_cast<std::size_t>(
          std::clamp(sample.along_mm / long_mm * kParts, 0.0, kParts - 1.0));
      const std::size_t bin = Turn::BinOf(sample.around_rad);
      for (Turn* turn : {&parts_[part], &all_}) {
        turn->count[bin] += sample.weight;
        turn->sum_mm[bin] += sample.weight * sample.off_mm;
      }
    }
  }

  // The one that most samples speak for.
  Ridge Highest() const {
    Ridge best;
    for (const double width_rad : kSeam.widths) {
      const RidgesSoWide ridges(width_rad);
      const auto step =
          static_cast<std::size_t>(std::max(1.0, kSeam.step * width_rad / kWholeTurn * kBins));
      for (std::size_t bin = 0; bin < kBins; bin += step) {
        const Ridge ridge = ridges.At(all_, bin, noise_mm_);
        if (ridge.Sigmas() > best.Sigmas()) best = ridge;
      }
    }
    return best;
  }

  // Whether it is there in all parts of the tube that can tell: a dent or what lies beside it is
  // not.
  bool GoesAllAlong(const Ridge& ridge) const {
    const RidgesSoWide ridges(ridge.width_rad);
    int tell = 0, see = 0;
    std::vector<double> heights_mm;
    for (const Turn& part : parts_) {
      const Ridge here = ridges.At(part, Turn::BinOf(ridge.around_rad), noise_mm_);
      const double sigma_mm = here.height_sigma_mm;
      if (!(sigma_mm > 0) || ridge.height_mm < kSeam.tells * sigma_mm) continue;
      ++tell;
      heights_mm.push_back(here.height_mm);
      see += std::abs(here.height_mm - ridge.height_mm) <
                     kSeam.about * ridge.height_mm + kSeam.noise_sigmas * sigma_mm
                 ? 1
                 : 0;
    }
    return tell >= kSeam.least_parts && see >= kSeam.agree * tell &&
           Median(std::move(heights_mm)) > kSeam.usual * ridge.height_mm;
  }

 private:
  double noise_mm_;
  std::array<Turn, kParts> parts_;
  Turn all_;
};

// [of the points near it] That have no say in the fit.
double LeftOutOf(const SurfaceFit& fit) {
  const double near = std::accumulate(fit.segment_samples.begin(), fit.segment_samples.end(), 0.0);
  const double used = std::accumulate(fit.segment_used.begin(), fit.segment_used.end(), 0.0);
  return near > 0 ? 1.0 - used / near : 0.0;
}

SeamFound FoundOf(const Ridge& ridge, double r_mm, double noise_mm) {
  const double blur = std::pow(noise_mm / (ridge.width_rad * r_mm), 2);
  SeamFound seam;
  seam.around_deg = std::remainder(ridge.around_rad, kWholeTurn) / hal::kRadiansPerDegree;
  seam.around_sigma_deg = ridge.around_sigma_rad / hal::kRadiansPerDegree;
  seam.height_mm = ridge.height_mm * (1.0 + kSeam.blurs * blur);
  seam.sigma_mm = std::hypot(ridge.height_sigma_mm, kSeam.blurs_sigma * blur * ridge.height_mm,
                             kSeam.of_form * ridge.height_mm);
  seam.width_mm = kFullWidth * ridge.width_rad * r_mm / (1.0 + kSeam.blurs * blur);
  return seam;
}

}  // namespace

std::optional<SeamFound> FindSeam(const SurfaceFit& fit, std::span<const PointBlock> blocks,
                                  double reach_mm) {
  if (fit.design_effect < kSeam.design_effect && LeftOutOf(fit) < kSeam.left_out) {
    return std::nullopt;
  }
  const double r_mm = fit.tube.pipe_radius_mm;
  const OwnedBlocks few = Thinned(blocks, StrideTo(CountPoints(blocks), kSeam.enough_points));
  const std::vector<SeamSample> samples =
      SamplesOf({fit.tube, fit.flattening, fit.easing, {}}, fit.tube, few, reach_mm);
  const auto search =
      std::make_unique<RidgeSearch>(samples, hal::SpineLength(fit.tube.program), fit.sigma_mm);
  const Ridge ridge = search->Highest();
  if (!(ridge.Sigmas() > kSeam.insist) || ridge.height_mm < kSeam.least * fit.sigma_mm ||
      !search->GoesAllAlong(ridge)) {
    return std::nullopt;
  }
  const auto fitted = FitRidge(samples, ridge, kSeam.piece * r_mm, fit.sigma_mm);
  if (!fitted && ridge.width_rad < kSeam.narrow) return std::nullopt;
  return FoundOf(fitted.value_or(ridge), r_mm, fit.sigma_mm);
}

SeamFound MeasureSeam(const SeamFound& found, const BowedTubeState& state, const hal::Tube& tube,
                      double noise_mm, std::span<const PointBlock> blocks, double reach_mm) {
  const double r_mm = tube.pipe_radius_mm;
  const OwnedBlocks few = Thinned(blocks, StrideTo(CountPoints(blocks), kSeam.many_points));
  const Ridge start{found.around_deg * hal::kRadiansPerDegree, found.width_mm / (kFullWidth * r_mm),
                    found.height_mm};
  const auto fitted =
      FitRidge(SamplesOf(state, tube, few, reach_mm), start, kSeam.piece * r_mm, noise_mm);
  return fitted ? FoundOf(*fitted, r_mm, noise_mm) : found;
}

OwnedBlocks WithoutSeam(const SurfaceFit& fit, const SeamFound& seam,
                        std::span<const PointBlock> blocks) {
  const auto segments = hal::SpineSegments(fit.tube.program, fit.tube.X_WT);
  const double r_mm = fit.tube.pipe_radius_mm;
  const auto frames = SegmentFrames(segments, kBeyond * r_mm, fit.flattening);
  const Untwisted untwisted(segments, segments.front().normal);
  const double middle_rad = seam.around_deg * hal::kRadiansPerDegree;
  const double sigma_rad = seam.width_mm / (kFullWidth * r_mm);
  const double rim = std::max(4.0, seam.height_mm / (kSeam.rim * fit.sigma_mm));
  const double half_rad = sigma_rad * std::sqrt(2.0 * std::log(rim));
  const PointBlock* of = nullptr;
  std::vector<std::int32_t> near;
  const auto is_on_seam = [&](const PointBlock& block, const Eigen::Vector3d& point) {
    if (of != &block) CandidateSegments(block, frames, kSeam.reach * r_mm, near);
    of = &block;
    const SpineFoot foot = NearestFoot(point, segments, frames, near);
    if (foot.segment < 0) return false;
    const auto k = static_cast<std::size_t>(foot.segment);
    const hal::SpineSegment& segment = segments[k];
    const Eigen::Vector3d from =
        segment.axes().transpose() *
        (point - (segment.is_arc() ? segment.center_mm() : segment.start_mm));
    const double around_rad = untwisted.At(k, segment, from.x(), from.y(), from.z());
    return std::abs(std::remainder(around_rad - middle_rad, kWholeTurn)) < half_rad;
  };
  return PointsWithout(blocks, is_on_seam);
}

}  // namespace bendloop::pipeline
