// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/seam.h"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <vector>

#include "hal/angles.h"
#include "hal/spine.h"
#include "pipeline/fit/place_sums.h"
#include "pipeline/fit/surface_pass.h"

namespace bendloop::pipeline {
namespace {

constexpr double kWholeTurn = 2.0 * std::numbers::pi;
constexpr double kFullWidth = 2.3548200450309493;  // [sigma] where a Gaussian is half as high
constexpr int kBins = 144, kParts = 8;             // of the turn, and of the spine's length

// By trial where nothing else is said.
struct SeamSettings {
  // Points that tell of one; their design effect without a seam of a noise's height is less.
  std::size_t enough_points = 40'000;
  double design_effect = 1.3;
  // [rad] 1 sigma of a Gaussian across: flash of two to six tenths of a wall.
  std::array<double, 5> widths = {0.05, 0.08, 0.12, 0.16, 0.2};
  // [rad] To both sides of its middle: the wall beside it that is looked at.
  double beside = 1.0;
  // Points of a bin that tell of it, and bins of either flank's outer half that do.
  double few = 3;
  int flank_bins = 3;
  // [sigma] From which on there is a ridge, and from which on a part of the tube can tell of it.
  double insist = 8.0, tells = 3.0;
  // [of the noise] A lower one may be where the edges of passes meet that drift.
  double least = 0.75;
  // [of the tube's parts] That can tell: so many, and so many of them see it about as high: to so
  // much of its height beside noise.
  int least_parts = 4;
  double agree = 0.75, about = 0.35, noise_sigmas = 3.0;
  int steps = 6;  // of the fit of its place and width
  // [of r_P] From the spine: what is further away is in no fit.
  double reach = 1.5;
  // [of the noise] So high the ridge may still be where points begin to count.
  double rim = 0.15;
};
constexpr SeamSettings kSeam;

// An angle around that stays the same all along a tube which is not twisted, counted from the first
// bend's normal, right-handed about the feed. Segment by segment.
class Untwisted {
 public:
  explicit Untwisted(const std::vector<hal::SpineSegment>& segments) {
    Eigen::Vector3d zero = segments.front().normal;
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

// Distances from the surface by place around and part of the tube.
struct Turn {
  std::array<std::array<double, kBins>, kParts> count{}, sum_mm{};

  void Add(double around_rad, double part, double distance_mm) {
    const double turns = around_rad / kWholeTurn;
    const auto bin = static_cast<std::size_t>((turns - std::floor(turns)) * kBins) % kBins;
    const auto of = static_cast<std::size_t>(std::clamp(part * kParts, 0.0, kParts - 1.0));
    count[of][bin] += 1;
    sum_mm[of][bin] += distance_mm;
  }
};

struct Ridge {
  double around_rad = 0, width_rad = 0, height_mm = 0, sigma_mm = 0;
  double Sigmas() const { return sigma_mm > 0 ? height_mm / sigma_mm : 0; }
};

// Height of a Gaussian ridge on a wall that curves evenly beside it, as one does that the tube's
// fit left off: least squares of the bins there. `parts`: from the first to the last.
Ridge FitRidge(const Turn& turn, int first, int last, double around_rad, double width_rad,
               double noise_mm) {
  Ridge ridge{around_rad, width_rad, 0, 0};
  Eigen::Matrix4d matrix = Eigen::Matrix4d::Zero();
  Eigen::Vector4d right = Eigen::Vector4d::Zero();
  std::array<int, 2> flank{};
  for (std::size_t bin = 0; bin < kBins; ++bin) {
    const double middle = (static_cast<double>(bin) + 0.5) * kWholeTurn / kBins;
    const double x = std::remainder(middle - around_rad, kWholeTurn) / kSeam.beside;
    if (std::abs(x) > 1.0) continue;
    double count = 0, sum_mm = 0;
    for (int part = first; part <= last; ++part) {
      count += turn.count[static_cast<std::size_t>(part)][bin];
      sum_mm += turn.sum_mm[static_cast<std::size_t>(part)][bin];
    }
    if (count < kSeam.few) continue;
    if (std::abs(x) > 0.5) ++flank[x > 0 ? 1 : 0];
    const double beside = x * kSeam.beside / width_rad;
    const Eigen::Vector4d shapes(1.0, x, x * x, std::exp(-0.5 * beside * beside));
    matrix += count * shapes * shapes.transpose();
    right += sum_mm * shapes;
  }
  if (flank[0] < kSeam.flank_bins || flank[1] < kSeam.flank_bins) return ridge;
  const Eigen::Matrix4d inverse = matrix.inverse();
  if (!inverse.allFinite() || !(inverse(3, 3) > 0)) return ridge;
  ridge.height_mm = (inverse * right)[3];
  ridge.sigma_mm = noise_mm * std::sqrt(inverse(3, 3));
  return ridge;
}

// The one that most points speak for.
Ridge HighestRidge(const Turn& turn, double noise_mm) {
  Ridge best;
  for (const double width_rad : kSeam.widths) {
    for (int step = 0; step < kBins; ++step) {
      const Ridge ridge =
          FitRidge(turn, 0, kParts - 1, step * kWholeTurn / kBins, width_rad, noise_mm);
      if (ridge.Sigmas() > best.Sigmas()) best = ridge;
    }
  }
  return best;
}

// The same with its place and width by least squares of the bins (Gauss-Newton), and 1 sigma of
// both. As it was where that leads away.
struct FittedRidge {
  Ridge ridge;
  double around_sigma_rad = 0;
};
FittedRidge Refined(const Turn& turn, const Ridge& start, double noise_mm) {
  const FittedRidge as_it_was{start, start.width_rad / start.Sigmas()};
  FittedRidge fitted = as_it_was;
  for (int i = 0; i < kSeam.steps; ++i) {
    Eigen::Matrix<double, 6, 6> matrix = Eigen::Matrix<double, 6, 6>::Zero();
    Eigen::Matrix<double, 6, 1> right = Eigen::Matrix<double, 6, 1>::Zero();
    const Ridge& now = fitted.ridge;
    for (std::size_t bin = 0; bin < kBins; ++bin) {
      const double middle = (static_cast<double>(bin) + 0.5) * kWholeTurn / kBins;
      const double off = std::remainder(middle - now.around_rad, kWholeTurn);
      const double x = off / kSeam.beside, beside = off / now.width_rad;
      if (std::abs(x) > 1.0) continue;
      const double high = std::exp(-0.5 * beside * beside);
      Eigen::Matrix<double, 6, 1> shapes;
      shapes << 1.0, x, x * x, high, now.height_mm * high * beside / now.width_rad,
          now.height_mm * high * beside * beside / now.width_rad;
      for (std::size_t part = 0; part < kParts; ++part) {
        const double count = turn.count[part][bin];
        matrix += count * shapes * shapes.transpose();
        right += (turn.sum_mm[part][bin] - count * now.height_mm * high) * shapes;
      }
    }
    const Eigen::Matrix<double, 6, 6> inverse = matrix.inverse();
    const Eigen::Matrix<double, 6, 1> step = inverse * right;
    Ridge next = now;
    next.height_mm += step[3];
    next.around_rad += step[4];
    next.width_rad += step[5];
    next.sigma_mm = noise_mm * std::sqrt(inverse(3, 3));
    const bool is_near = step.allFinite() && next.height_mm > 0.5 * start.height_mm &&
                         next.width_rad > 0.5 * kSeam.widths.front() &&
                         next.width_rad < 1.5 * kSeam.widths.back();
    if (!is_near) return as_it_was;
    fitted = {next, noise_mm * std::sqrt(inverse(4, 4))};
  }
  return fitted;
}

// Whether it is there in all parts of the tube that can tell: a dent or what lies beside it is not.
bool GoesAllAlong(const Turn& turn, const Ridge& ridge, double noise_mm) {
  int tell = 0, see = 0;
  for (int part = 0; part < kParts; ++part) {
    const Ridge here = FitRidge(turn, part, part, ridge.around_rad, ridge.width_rad, noise_mm);
    if (!(here.sigma_mm > 0) || ridge.height_mm < kSeam.tells * here.sigma_mm) continue;
    ++tell;
    see += std::abs(here.height_mm - ridge.height_mm) <
                   kSeam.about * ridge.height_mm + kSeam.noise_sigmas * here.sigma_mm
               ? 1
               : 0;
  }
  return tell >= kSeam.least_parts && see >= kSeam.agree * tell;
}

}  // namespace

std::optional<SeamFound> FindSeam(const SurfaceFit& fit, std::span<const PointBlock> blocks,
                                  double reach_mm) {
  if (fit.design_effect < kSeam.design_effect) return std::nullopt;
  const auto segments = hal::SpineSegments(fit.tube.program, fit.tube.X_WT);
  const double long_mm = segments.back().from_start_mm + segments.back().length_mm;
  const Untwisted untwisted(segments);
  const OwnedBlocks few = Thinned(blocks, StrideTo(CountPoints(blocks), kSeam.enough_points));
  SurfaceAssignment points;
  AssignPoints(SegmentFrames(segments, 0.0, fit.flattening), fit.tube.pipe_radius_mm, few, reach_mm,
               points);
  Turn turn;
  for (std::size_t k = 0; k < segments.size(); ++k) {
    const SegmentPoints& of = points.segments[k];
    for (Eigen::Index i = 0; i < static_cast<Eigen::Index>(of.size); ++i) {
      const double along_mm = segments[k].from_start_mm + AlongOf(of, i, segments[k]);
      turn.Add(untwisted.At(k, segments[k], of.x[i], of.y[i], of.z[i]), along_mm / long_mm,
               of.distance[i]);
    }
  }
  const Ridge ridge = HighestRidge(turn, fit.sigma_mm);
  if (!(ridge.Sigmas() > kSeam.insist) || ridge.height_mm < kSeam.least * fit.sigma_mm ||
      !GoesAllAlong(turn, ridge, fit.sigma_mm)) {
    return std::nullopt;
  }
  const auto [fitted, around_sigma_rad] = Refined(turn, ridge, fit.sigma_mm);
  SeamFound seam;
  seam.around_deg = std::remainder(fitted.around_rad, kWholeTurn) / hal::kRadiansPerDegree;
  seam.around_sigma_deg = around_sigma_rad / hal::kRadiansPerDegree;
  seam.height_mm = fitted.height_mm;
  seam.sigma_mm = fitted.sigma_mm;
  seam.width_mm = kFullWidth * fitted.width_rad * fit.tube.pipe_radius_mm;
  return seam;
}

OwnedBlocks WithoutSeam(const SurfaceFit& fit, const SeamFound& seam,
                        std::span<const PointBlock> blocks) {
  const auto segments = hal::SpineSegments(fit.tube.program, fit.tube.X_WT);
  const double r_mm = fit.tube.pipe_radius_mm;
  const auto frames = SegmentFrames(segments, kBeyond * r_mm, fit.flattening);
  const Untwisted untwisted(segments);
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
