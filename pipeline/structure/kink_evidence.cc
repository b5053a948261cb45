// SPDX-License-Identifier: Apache-2.0
#include "pipeline/structure/kink_evidence.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "hal/spine.h"
#include "pipeline/fit/surface_sums.h"
#include "pipeline/structure/lateral_profile.h"

namespace bendloop::pipeline {
namespace {

// By trial where nothing else is said.
struct KinkSettings {
  // [of r_P] A shorter straight does not tell where it goes.
  double shortest = 2.5;
  // Fewer samples of a place tell nothing of it.
  double few_samples = 3;
  // Left out beside the next bends, where these ease in: [of r_P], and at most [of the straight].
  double trimmed = 1.0, trimmed_part = 0.15;
  // [of a bow's height] Bows that change sides are half as high as others, as a rule.
  double of_bow = 0.5;
  // One view says nothing across itself: one part in so many of a place's information is added in
  // every direction, so that the matrix can be inverted.
  double vague = 1e6;
  // [1/mm^2] Of a shape that is not there: it stays 0.
  double absent = 1e12;
};
constexpr KinkSettings kKinks;

// Offset, slope, bow and bow that changes sides of the whole; the kink; bows before and after it.
enum Shape { kOffset, kSlope, kBow, kSides, kKink, kBefore, kAfter, kShapes };
using Shapes = Eigen::Matrix<double, kShapes, 1>;

// The bend and the two straights beside it.
struct Stretch {
  double before_mm = 0, arc_mm = 0, after_mm = 0;  // lengths
  double bend_radius_mm = 0;
  double from_mm() const { return -before_mm - 0.5 * arc_mm; }
  double to_mm() const { return after_mm + 0.5 * arc_mm; }
  // How far inward the bent spine lies, from the tangent in the bend's middle.
  double BentMm(double along_mm) const {
    const double half_rad = 0.5 * arc_mm / bend_radius_mm;
    const double beyond_mm = std::max(0.0, std::abs(along_mm) - 0.5 * arc_mm);
    const double on_arc_mm = std::min(std::abs(along_mm), 0.5 * arc_mm);
    return bend_radius_mm * (1.0 - std::cos(on_arc_mm / bend_radius_mm)) +
           beyond_mm * std::sin(half_rad);
  }
};

// A bow's height by the part of its length; 1 in the middle.
double Bow(double part) { return part <= 0 || part >= 1 ? 0.0 : 4.0 * part * (1.0 - part); }

// `made`: the same bend as a machine would have made it.
Shapes ShapesAt(double along_mm, const Stretch& stretch, const Stretch& made) {
  const double long_mm = stretch.to_mm() - stretch.from_mm();
  const double part = (along_mm - stretch.from_mm()) / long_mm;
  Shapes shapes;
  shapes[kOffset] = 1;
  shapes[kSlope] = part - 0.5;
  shapes[kBow] = Bow(part);
  shapes[kSides] = 10.4 * part * (1.0 - part) * (1.0 - 2.0 * part);           // 1 at most
  shapes[kKink] = made.BentMm(along_mm) / made.arc_mm * made.bend_radius_mm;  // a rad of it
  shapes[kBefore] = Bow((along_mm - stretch.from_mm()) / -stretch.from_mm());
  shapes[kAfter] = Bow(along_mm / stretch.to_mm());
  return shapes;
}

// Least squares of the spine's places by these shapes, each with its own 1 sigma beforehand.
class Regression {
 public:
  explicit Regression(const Shapes& range_mm) {
    matrix_.setZero();
    right_.setZero();
    for (int i = 0; i < kShapes; ++i) {
      for (int direction = 0; direction < 2; ++direction) {
        const int k = 2 * i + direction;
        matrix_(k, k) = range_mm[i] > 0 ? 1.0 / (range_mm[i] * range_mm[i]) : kKinks.absent;
      }
    }
  }
  void Add(const Shapes& shapes, const Eigen::Vector2d& at_mm, const Eigen::Matrix2d& weight) {
    for (int i = 0; i < kShapes; ++i) {
      right_.segment<2>(2 * i) += shapes[i] * (weight * at_mm);
      for (int j = 0; j < kShapes; ++j) {
        matrix_.block<2, 2>(2 * i, 2 * j) += shapes[i] * shapes[j] * weight;
      }
    }
    squares_ += at_mm.dot(weight * at_mm);
  }
  double ChiSquare() const { return squares_ - right_.dot(matrix_.ldlt().solve(right_)); }

 private:
  Eigen::Matrix<double, 2 * kShapes, 2 * kShapes> matrix_;
  Eigen::Matrix<double, 2 * kShapes, 1> right_;
  double squares_ = 0;
};

// A place of the profile in the frame of the bend, (inward, normal).
struct Turned {
  double along_mm = 0;  // from the bend's middle
  Eigen::Matrix2d information;
  Eigen::Vector2d pull;
};

// The places of the bend and of the straights beside it, but for where the next bends ease in.
std::vector<Turned> PlacesAround(const std::vector<hal::SpineSegment>& segments, std::size_t arc,
                                 const Stretch& stretch,
                                 const std::vector<std::vector<LateralPlace>>& profile,
                                 double pipe_radius_mm) {
  const auto off_mm = [pipe_radius_mm](double length_mm) {
    return std::min(kKinks.trimmed * pipe_radius_mm, kKinks.trimmed_part * length_mm);
  };
  const double from_mm = stretch.from_mm() + off_mm(stretch.before_mm);
  const double to_mm = stretch.to_mm() - off_mm(stretch.after_mm);
  const Eigen::Vector3d normal = segments[arc].normal;
  std::vector<Turned> list;
  double begins_mm = stretch.from_mm();
  for (std::size_t k = arc - 1; k <= arc + 1; ++k) {
    const hal::SpineSegment& segment = segments[k];
    Eigen::Matrix2d turn = Eigen::Matrix2d::Identity();
    if (!segment.is_arc()) {
      const Eigen::Vector3d across = segment.normal.cross(segment.tangent);
      const Eigen::Vector3d inward = normal.cross(segment.tangent);
      turn << inward.dot(across), inward.dot(segment.normal), normal.dot(across),
          normal.dot(segment.normal);
    }
    for (const LateralPlace& place : profile[k]) {
      const double along_mm = begins_mm + place.along_mm;
      if (place.samples < kKinks.few_samples || along_mm < from_mm || along_mm > to_mm) continue;
      list.push_back({along_mm, turn * place.information * turn.transpose(), turn * place.pull});
    }
    begins_mm += segment.length_mm;
  }
  return list;
}

}  // namespace

double KinkEvidence(const SurfaceFit& fit, std::size_t bend, double widest_mm,
                    std::span<const PointBlock> blocks, double reach_mm,
                    const FormDeviation& form) {
  const auto segments = hal::SpineSegments(fit.tube.program, fit.tube.X_WT);
  const std::size_t k = 2 * bend + 1;
  const double r_mm = fit.tube.pipe_radius_mm;
  const Stretch stretch{segments[k - 1].length_mm, segments[k].length_mm, segments[k + 1].length_mm,
                        segments[k].bend_radius_mm};
  if (!(stretch.arc_mm > 0)) return 0.0;
  Stretch made = stretch;
  made.bend_radius_mm = std::min(made.bend_radius_mm, widest_mm);
  made.arc_mm *= made.bend_radius_mm / stretch.bend_radius_mm;
  if (std::min(-stretch.from_mm(), stretch.to_mm()) < kKinks.shortest * r_mm) {
    return std::numeric_limits<double>::infinity();
  }
  const double limit_mm = kNoWeight * std::hypot(fit.sigma_mm, fit.form_mm);
  const auto profile = LateralProfile(fit, blocks, reach_mm, limit_mm);
  const double long_mm = stretch.to_mm() - stretch.from_mm();
  Shapes bowed = Shapes::Zero();  // 1 sigma of each, 0: it is not there
  bowed[kOffset] = bowed[kSlope] = long_mm;
  Shapes bent = bowed;
  bowed[kBow] = form.bow * long_mm;
  bowed[kSides] = kKinks.of_bow * form.bow * long_mm;
  bent[kKink] = 1.0;
  bent[kBefore] = form.bow * -stretch.from_mm();
  bent[kAfter] = form.bow * stretch.to_mm();
  Regression as_bow(bowed), as_bend(bent);
  const double noise_mm2 = fit.sigma_mm * fit.sigma_mm * fit.design_effect;
  const double form_mm2 = std::pow(form.AcrossMm(r_mm), 2);  // of a place, a pipe radius long
  for (const Turned& place : PlacesAround(segments, k, stretch, profile, r_mm)) {
    Eigen::Matrix2d information = place.information;
    information.diagonal().array() += information.trace() / kKinks.vague;
    const Eigen::Matrix2d inverse = information.inverse();
    const Eigen::Matrix2d covariance = noise_mm2 * inverse + form_mm2 * Eigen::Matrix2d::Identity();
    const Eigen::Vector2d bent_mm(stretch.BentMm(place.along_mm), 0);
    const Eigen::Vector2d at_mm = inverse * place.pull + bent_mm;
    const Shapes shapes = ShapesAt(place.along_mm, stretch, made);
    const Eigen::Matrix2d weight = covariance.inverse();
    as_bow.Add(shapes, at_mm, weight);
    as_bend.Add(shapes, at_mm, weight);
  }
  return as_bow.ChiSquare() - as_bend.ChiSquare();
}

}  // namespace bendloop::pipeline
