// SPDX-License-Identifier: Apache-2.0
#include "pipeline/spine/pipe_radius.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "pipeline/math/quantiles.h"
#include "pipeline/points/point_pyramid.h"
#include "pipeline/spine/cylinder_fit.h"
#include "pipeline/spine/local_paraboloid.h"

namespace bendloop::pipeline {
namespace {

// Of the pipe radius: 2/3 as in section 7; the whole where a sparse scan has too few points in
// that.
constexpr std::array<double, 2> kParaboloidRadius = {2.0 / 3.0, 1.0};
constexpr double kConvincing = 0.25;      // support at which the wider neighbourhood is not tried
constexpr double kCylinderSupport = 1.6;  // of the pipe radius; with 1.2 noise biases it fivefold
constexpr double kHighPeak = 0.5;         // after which the search ends
constexpr double kCertain = 0.75;         // at which it ends at once
constexpr double kLadderStep = 1.25;
constexpr double kNearest = 0.11;  // of the trial: no other on the ladder is nearer
constexpr std::size_t kMostAhead = 4;
constexpr double kAgreement = 0.2;   // of the trial's curvature
constexpr double kTolerance = 1e-3;  // of r_P: less than what noise does
constexpr double kMaxRms = 0.12;     // of the trial radius: noise of 0.12 mm on a 2 mm wire is half
constexpr double kVoxels = 5.0;      // a neighbourhood holds so many along its radius, or more
constexpr std::size_t kSeeds = 240;
// Seeds are asked in an order in which any number of the first are spread over the scan.
constexpr std::size_t kSeedStep = 389;  // a prime beyond kSeeds
// So many are asked first: enough to know where it is worth asking all.
constexpr std::size_t kPilot = 40;
// So many of the votes are asked for cylinders: the median of their radii is good to a part in a
// thousand.
constexpr std::size_t kCylinders = 36;
constexpr std::ptrdiff_t kLeastCylinders = 5;
constexpr std::size_t kWorkingPoints = 20'000;
constexpr std::size_t kBoxPoints = 2'000;
constexpr double kMinSupport = 0.04;
constexpr double kStray = 0.01;  // part of the points at either end that may lie anywhere

struct Vote {
  LocalParaboloid surface;
  std::size_t curved = 0;  // which principal direction runs around the pipe
};

// Evenly picked by index: deterministic, and spread over the scan, which is ordered in time.
std::vector<Eigen::Vector3d> Pick(std::span<const Eigen::Vector3d> points, std::size_t count) {
  std::vector<Eigen::Vector3d> picked;
  if (points.size() <= count) return {points.begin(), points.end()};
  picked.reserve(count);
  for (std::size_t i = 0; i < count; ++i) picked.push_back(points[i * points.size() / count]);
  return picked;
}

// What a trial radius comes to.
struct Trial {
  double radius_mm = 0;
  double neighbourhood_mm = 0;
  const PointPyramid::Level* level = nullptr;
  std::size_t asked = 0;  // seeds
  std::vector<Vote> votes;
  double score = 0;  // part of the seeds whose cylinders agree with it and with each other
  std::vector<double> cylinder_radius_mm, cylinder_rms_mm;

  double Support() const { return PartAsked(0); }  // of the seeds: no score is better
  double Hope() const { return PartAsked(2); }     // few were asked: it may be a little more
  double PartAsked(std::size_t more) const {
    return static_cast<double>(votes.size() + more) / static_cast<double>(asked);
  }
};

// Asks seeds until so many have been asked in all.
void AskSeeds(std::span<const Eigen::Vector3d> seeds, std::size_t until, Trial& trial) {
  std::vector<Eigen::Vector3d> ball;
  while (trial.asked < std::min(until, seeds.size())) {
    const Eigen::Vector3d& seed = seeds[trial.asked++ * kSeedStep % seeds.size()];
    trial.level->GatherBall(seed, trial.neighbourhood_mm, ball);
    const auto surface = FitLocalParaboloid(seed, ball, trial.neighbourhood_mm);
    if (!surface || surface->rms_mm > kMaxRms * trial.radius_mm) continue;
    for (std::size_t i = 0; i < 2; ++i) {
      if (std::abs(std::abs(surface->curvature[i]) * trial.radius_mm - 1.0) < kAgreement &&
          std::abs(surface->curvature[1 - i]) * trial.radius_mm < 0.75) {
        trial.votes.push_back({*surface, i});
        break;
      }
    }
  }
}

// Asks the other seeds, unless nearly all agree, and free cylinders where they do; those that agree
// with each other, too, count.
void Judge(std::span<const Eigen::Vector3d> seeds, PointPyramid& points, Trial& trial) {
  if (trial.Support() < kCertain) AskSeeds(seeds, seeds.size(), trial);
  const double trial_mm = trial.radius_mm;
  const double support_mm = kCylinderSupport * trial_mm;
  const PointPyramid::Level& level = points.Thinned(support_mm / kVoxels);
  std::vector<Eigen::Vector3d> ball;
  const std::size_t count = std::min(trial.votes.size(), kCylinders);
  for (std::size_t i = 0; i < count; ++i) {
    const Vote& vote = trial.votes[i * trial.votes.size() / count];
    const double side = vote.surface.curvature[vote.curved] > 0 ? 1.0 : -1.0;
    const Eigen::Vector3d axis_point = vote.surface.foot_mm + side * trial_mm * vote.surface.normal;
    level.GatherBall(axis_point, support_mm + 0.2 * trial_mm, ball);
    const auto cylinder = FitCylinder(axis_point, vote.surface.direction[1 - vote.curved], ball,
                                      {.radius_mm = trial_mm,
                                       .free_radius = true,
                                       .support_mm = support_mm,
                                       .inlier_mm = 0.35 * trial_mm,
                                       .tolerance = kTolerance});
    if (!cylinder || cylinder->angular_coverage < 0.15 ||
        cylinder->axial_spread_mm < 0.15 * trial_mm ||
        std::abs(cylinder->radius_mm / trial_mm - 1.0) > 0.4 ||
        cylinder->rms_mm > kMaxRms * trial_mm) {
      continue;
    }
    trial.cylinder_radius_mm.push_back(cylinder->radius_mm);
    trial.cylinder_rms_mm.push_back(cylinder->rms_mm);
  }
  const double center_mm = Median(trial.cylinder_radius_mm);
  const auto agree = std::count_if(
      trial.cylinder_radius_mm.begin(), trial.cylinder_radius_mm.end(),
      [center_mm](double radius_mm) { return std::abs(radius_mm / center_mm - 1.0) < 0.1; });
  if (agree < kLeastCylinders) return;
  trial.score = trial.Support() * static_cast<double>(agree) / static_cast<double>(count);
}

// From pipes as thick as the cloud down to where neighbourhoods are too small to be fitted.
Trial BestTrial(PointPyramid& points, std::span<const Eigen::Vector3d> seeds, double size_mm,
                double neighbourhood, Workers* workers) {
  Trial best;
  int worse = 0;
  // Judging is dear: trials that few agree with wait until it is known what else there is.
  std::vector<Trial> waiting;
  const auto judge = [&](Trial& trial) {
    Judge(seeds, points, trial);
    if (trial.score <= best.score) return false;
    best = std::move(trial);
    return true;
  };
  // With workers the next few are tried at once, of which the last may be in vain.
  std::vector<Trial> ahead(workers ? std::min(workers->threads(), kMostAhead) : 1);
  std::size_t next = ahead.size();
  for (double trial_mm = size_mm / 3.0; trial_mm > size_mm / 5000.0; trial_mm /= kLadderStep) {
    if (next == ahead.size()) {
      double ahead_mm = trial_mm;
      for (Trial& trial : ahead) {
        trial = {};
        trial.radius_mm = ahead_mm;
        trial.neighbourhood_mm = neighbourhood * ahead_mm;
        trial.level = &points.Thinned(trial.neighbourhood_mm / kVoxels);
        ahead_mm /= kLadderStep;
      }
      ParallelFor(workers, ahead.size(), [&](std::size_t i) { AskSeeds(seeds, kPilot, ahead[i]); });
      next = 0;
    }
    Trial& trial = ahead[next++];
    if (trial.level->cell_count() > points.size() / 2) break;  // so sparse are all smaller ones
    const bool high = trial.Support() >= kHighPeak;
    if (high && judge(trial)) {
      worse = 0;
      if (best.score > kCertain &&
          std::abs(Median(best.cylinder_radius_mm) / best.radius_mm - 1.0) < kNearest) {
        break;
      }
      continue;
    }
    // Well past a high peak the smaller trials need not be looked at. A whole bent tube may pass
    // for a piece of a far thicker one, but never with so much support.
    if (best.score > kHighPeak && trial.Support() < 0.5 * best.score && ++worse >= 2) break;
    if (!high) waiting.push_back(std::move(trial));
  }
  std::stable_sort(waiting.begin(), waiting.end(),
                   [](const Trial& a, const Trial& b) { return a.Support() > b.Support(); });
  for (Trial& trial : waiting) {
    if (trial.Hope() <= best.score) break;
    judge(trial);
  }
  return best;
}

}  // namespace

hal::Result<PipeRadius> EstimatePipeRadius(std::span<const Eigen::Vector3d> points,
                                           Workers* workers) {
  if (points.empty()) {
    return hal::Fail(hal::ErrorKind::kBadInput, "no points; expected a scan of a tube");
  }
  std::vector<Eigen::Vector3d> working = Pick(points, kWorkingPoints);
  const std::vector<Eigen::Vector3d> some = Pick(working, kBoxPoints);
  // The box of nearly all points: one reading from far away must not set the scale.
  Eigen::Vector3d low, high;
  for (Eigen::Index axis = 0; axis < 3; ++axis) {
    std::vector<double> along;
    along.reserve(some.size());
    for (const Eigen::Vector3d& p : some) along.push_back(p[axis]);
    low[axis] = Quantile(along, kStray);
    high[axis] = Quantile(std::move(along), 1.0 - kStray);
  }
  const double margin_mm = (high - low).norm();
  std::erase_if(working, [&](const Eigen::Vector3d& p) {
    return ((p - low).array() < -margin_mm).any() || ((p - high).array() > margin_mm).any();
  });
  for (const Eigen::Vector3d& p : working) {
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  const double size_mm = (high - low).norm();
  const std::vector<Eigen::Vector3d> seeds = Pick(working, kSeeds);
  PointPyramid pyramid(working);

  Trial best;
  for (const double neighbourhood : kParaboloidRadius) {
    Trial found = BestTrial(pyramid, seeds, size_mm, neighbourhood, workers);
    if (found.score > best.score) best = std::move(found);
    if (best.score > kConvincing) break;
  }
  if (best.score < kMinSupport) {
    return hal::Fail(hal::ErrorKind::kBadInput,
                     "no pipe found in the points: no part of them is curved like a cylinder "
                     "(expected a scan of a tube with at least a few hundred points on it)");
  }
  PipeRadius result;
  result.radius_mm = Median(best.cylinder_radius_mm);
  result.noise_mm = Median(best.cylinder_rms_mm);
  result.sigma_mm = 1.2533 * RobustSigma(best.cylinder_radius_mm) /
                    std::sqrt(static_cast<double>(best.cylinder_radius_mm.size()));
  result.support = best.score;
  return result;
}

}  // namespace bendloop::pipeline
