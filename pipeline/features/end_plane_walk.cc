// SPDX-License-Identifier: Apache-2.0
#include "pipeline/features/end_plane_walk.h"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

namespace bendloop::pipeline {
namespace {

struct EndWalkSettings {
  // Steps of the walk, and of one that says whether the end may be oblique at all, from so many
  // sigma on.
  int walk = 1500, short_walk = 500;
  // [of the mean gap] The walk's first steps.
  double first_step = 0.1;
  // [of the mean gap] Lines are blurred by so much, one after the other, before they are taken as
  // they are: what they leave free may be a needle, which a walk finds only by and by.
  std::array<double, 4> blurs = {0.3, 0.1, 0.03, 0.01};
  int blurred_walk = 250;
  double far = 6.0;  // [sigma]
  // [of the mean gap, and a pipe radius more] Planes lie about where sides roughly have them, 1
  // sigma.
  double within = 10.0;
  // Of the variance after the last blur: less is none.
  double least_moved = 1e-3;
  // [of the mean gap] and [sigma] Sides that are contradicted by more, and how many may be of all
  // that lie as near [of the mean gap]. Of passes that nobody knows the first, and of all.
  double wrong = 0.03, wrong_sigmas = 4.0, most_wrong = 0.15, near = 0.5;
  double wrong_unknown = 0.1;
  // [of its mean gap] A column that stops so far beyond a plane, or before it, contradicts it.
  double stops_beyond = 0.3, stops_before = 6.0;
  // All others contradict it together where they stop so much rarer before it than by chance: of
  // the mean, and [sigma].
  double rarer = 0.4, rarer_sigmas = 4.5;
};
constexpr EndWalkSettings kWalk;

// The logarithm of the likelihood of planes.
class PlaneLikelihood {
 public:
  // `blur_mm`: laser lines are as uncertain as this, at least.
  PlaneLikelihood(const EndEvidence& evidence, double blur_mm)
      : evidence_(evidence), sides_(evidence.sides.size()), stops_(evidence.columns.size()) {
    for (const EndSide& side : evidence.sides) {
      if (!side.is_told) AddSide(side, std::max(side.sigma_mm, blur_mm), sides_);
    }
    for (const EndStop& stop : evidence.columns) {
      stops_.Add(stop.cosine, stop.sine, stop.last_mm, 1.0 / stop.mean_gap_mm, 0);
    }
    sides_.Fill();
    stops_.Fill();
  }
  double Log(const Eigen::VectorXd& x) const {
    const double sum = LogOfSides(sides_, x.data(), evidence_.lines_greatest);
    return evidence_.stops ? sum + evidence_.stops->Sum(stops_, x.data()) : sum;
  }

 private:
  const EndEvidence& evidence_;
  PlaneLanes sides_, stops_;
};

// Without the sides that every plane of a density is far on the right side of: they say no more.
void Forget(const Posterior& planes, double blur_mm, EndEvidence& evidence) {
  std::erase_if(evidence.sides, [&](const EndSide& side) {
    const Eigen::Vector3d row(1.0, side.cosine, side.sine);
    const double spread_mm = std::sqrt(std::max(0.0, row.dot(planes.covariance * row)));
    return side.Clear(planes.mean) > kWalk.far * (spread_mm + std::max(side.sigma_mm, blur_mm));
  });
}

// A walk that found no way says less than the one before.
bool HasMoved(const Posterior& walk, const Posterior& before) {
  return walk.covariance.trace() > kWalk.least_moved * before.covariance.trace();
}

// Whether columns, none of which contradicts a plane by itself, stop too far before it together, as
// those of a border that waves about it do. `x`: as the evidence counts.
bool StopTooFarBefore(const Eigen::Vector3d& x, const EndEvidence& evidence) {
  double rarity = 0, columns = 0;
  for (const EndStop& stop : evidence.columns) {
    const double off =
        (x[0] + stop.cosine * x[1] + stop.sine * x[2] - stop.last_mm) / stop.mean_gap_mm;
    if (off > kWalk.stops_before) continue;
    rarity += evidence.gaps_before.Rarity(off);
    columns += 1;
  }
  const double sigma = std::sqrt(evidence.columns_of_line * columns);
  return rarity - columns > std::max(kWalk.rarer * columns, kWalk.rarer_sigmas * sigma);
}

}  // namespace

EndPlane PlaneAmong(EndEvidence evidence, const Eigen::Vector2d& slope_mm, double r_mm,
                    WalkDice& dice, const BetterPlane& better, double usual_slope) {
  const double prior_mm = usual_slope * r_mm;
  // Where all lines are lost a plane may be anywhere: no walk is to get there.
  const Eigen::Vector3d rough_mm = RoughEndPlane(evidence, r_mm);
  const double within_mm = evidence.sides.empty() ? 1e9 : kWalk.within * evidence.gap_mm + r_mm;
  const auto sample = [&](const Posterior& from, int walk, double blur_mm) {
    const PlaneLikelihood likelihood(evidence, blur_mm);
    return SamplePosterior(from, walk, dice, [&](const Eigen::VectorXd& x) {
      const double steep = (x.tail<2>() + slope_mm).squaredNorm() / (prior_mm * prior_mm);
      const double off = (x[0] - rough_mm[0]) / within_mm;
      return likelihood.Log(x) - 0.5 * (steep + off * off);
    });
  };
  const double first_mm = kWalk.first_step * evidence.gap_mm;
  Posterior posterior{rough_mm, first_mm * first_mm * Eigen::Matrix3d::Identity()};
  // A few samples look like lines by chance; those leave no needle.
  if (evidence.sides.size() > evidence.columns.size()) {
    for (const double blur : kWalk.blurs) {
      const Posterior blurred = sample(posterior, kWalk.blurred_walk, blur * evidence.gap_mm);
      if (!HasMoved(blurred, posterior)) continue;
      posterior = blurred;
      Forget(posterior, blur * evidence.gap_mm, evidence);
    }
  }
  EndPlane plane;
  for (const int walk : {kWalk.short_walk, kWalk.walk}) {
    const Posterior sharp = sample(posterior, walk, 0.0);
    if (HasMoved(sharp, posterior)) posterior = sharp;
    plane = PlaneOf(posterior, slope_mm, r_mm);
    if (better && walk == kWalk.short_walk) {
      Posterior whole = posterior;
      whole.mean.tail<2>() += slope_mm;
      if (const auto found = better(whole)) return PlaneOf(*found, Eigen::Vector2d::Zero(), r_mm);
    }
    if (!plane.MayBeOblique()) break;
  }
  return plane;
}

PlaneMisfit MisfitOf(const EndPlane& plane, const EndEvidence& evidence,
                     const Eigen::Vector2d& slope_mm, double r_mm) {
  Eigen::Vector3d x = plane.Numbers(r_mm);
  x.tail<2>() -= slope_mm;
  double square = 0;
  double wrong = 0, all = 0;
  for (const EndSide& side : evidence.sides) {
    const double clear_mm = side.Clear(x);
    // Lines that lie further off say nothing of how the border goes.
    if (side.is_told) continue;
    if (evidence.knows_passes && clear_mm > kWalk.near * evidence.gap_mm) continue;
    all += 1;
    const double most_mm = evidence.knows_passes ? std::max(kWalk.wrong * evidence.gap_mm,
                                                            kWalk.wrong_sigmas * side.sigma_mm)
                                                 : kWalk.wrong_unknown * evidence.gap_mm;
    if (-clear_mm < most_mm) continue;
    wrong += 1;
    square += clear_mm * clear_mm;
  }
  PlaneMisfit misfit;
  if (wrong > 0) misfit.rms_mm = std::sqrt(square / wrong);
  for (const EndStop& stop : evidence.columns) {
    const double off =
        (x[0] + stop.cosine * x[1] + stop.sine * x[2] - stop.last_mm) / stop.mean_gap_mm;
    all += 1;
    wrong += off < -kWalk.stops_beyond || off > kWalk.stops_before ? 1 : 0;
  }
  misfit.part = wrong / std::max(1.0, all);
  misfit.is_none = misfit.part <= kWalk.most_wrong && !StopTooFarBefore(x, evidence);
  return misfit;
}

}  // namespace bendloop::pipeline
