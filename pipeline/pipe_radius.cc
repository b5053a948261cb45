// SPDX-License-Identifier: Apache-2.0
#include "pipeline/pipe_radius.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "pipeline/cylinder_fit.h"
#include "pipeline/local_paraboloid.h"
#include "pipeline/sample_grid.h"
#include "pipeline/statistics.h"

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
constexpr double kTolerance = 1e-4;  // of r_P: far less than what noise does
constexpr double kMaxRms = 0.12;     // of the trial radius: noise of 0.12 mm on a 2 mm wire is half
constexpr std::size_t kSeeds = 240;
// Every so many seeds are asked first. When none of these agrees with the trial, hardly one in
// twenty of all does, and the others are not asked; nor when so many agree that all is said.
constexpr std::size_t kPilotStride = 3;
constexpr std::size_t kEnoughVotes = 24;
// So many of the votes are asked for cylinders: the median of their radii is good to a part in a
// thousand.
constexpr std::size_t kCylinders = 36;
// Points are looked at in passes, twice as many in each. A pass that finds something new in fewer
// than one of so many points is the last.
constexpr std::size_t kFirstPass = 64;  // every so many-th point
constexpr std::size_t kSaturated = 8;
constexpr std::size_t kWorkingPoints = 20'000;
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

// The votes for a trial radius, and how many seeds were asked.
struct Votes {
  std::vector<Vote> votes;
  std::size_t asked = 0;
};

Votes VotesFor(double trial_mm, double neighbourhood_mm, std::span<const Eigen::Vector3d> seeds,
               const SampleGrid& grid) {
  Votes result;
  std::vector<Vote>& votes = result.votes;
  std::vector<Eigen::Vector3d> ball;
  const auto ask = [&](const Eigen::Vector3d& seed) {
    ++result.asked;
    grid.GatherBall(seed, neighbourhood_mm, ball);
    const auto surface = FitLocalParaboloid(seed, ball, neighbourhood_mm);
    if (!surface || surface->rms_mm > kMaxRms * trial_mm) return;
    for (std::size_t i = 0; i < 2; ++i) {
      if (std::abs(std::abs(surface->curvature[i]) * trial_mm - 1.0) < kAgreement &&
          std::abs(surface->curvature[1 - i]) * trial_mm < 0.75) {
        votes.push_back({*surface, i});
        break;
      }
    }
  };
  for (std::size_t i = 0; i < seeds.size(); i += kPilotStride) ask(seeds[i]);
  if (votes.empty() || votes.size() >= kEnoughVotes) return result;
  for (std::size_t i = 0; i < seeds.size(); ++i) {
    if (i % kPilotStride != 0) ask(seeds[i]);
  }
  return result;
}

// Radii of free cylinder fits at the votes; keeps only those that agree with the trial.
struct Cylinders {
  std::size_t asked = 0;
  std::vector<double> radius_mm;
  std::vector<double> rms_mm;
};

Cylinders FitCylinders(double trial_mm, std::span<const Vote> votes, const SampleGrid& grid) {
  Cylinders cylinders;
  std::vector<Eigen::Vector3d> ball;
  const std::size_t count = std::min(votes.size(), kCylinders);
  for (std::size_t i = 0; i < count; ++i) {
    const Vote& vote = votes[i * votes.size() / count];
    ++cylinders.asked;
    const double side = vote.surface.curvature[vote.curved] > 0 ? 1.0 : -1.0;
    const Eigen::Vector3d axis_point = vote.surface.foot_mm + side * trial_mm * vote.surface.normal;
    grid.GatherBall(axis_point, (kCylinderSupport + 0.2) * trial_mm, ball);
    const auto cylinder = FitCylinder(axis_point, vote.surface.direction[1 - vote.curved], ball,
                                      {.radius_mm = trial_mm,
                                       .free_radius = true,
                                       .support_mm = kCylinderSupport * trial_mm,
                                       .inlier_mm = 0.35 * trial_mm,
                                       .tolerance = kTolerance});
    if (!cylinder || cylinder->angular_coverage < 0.15 ||
        cylinder->axial_spread_mm < 0.15 * trial_mm ||
        std::abs(cylinder->radius_mm / trial_mm - 1.0) > 0.4 ||
        cylinder->rms_mm > kMaxRms * trial_mm) {
      continue;
    }
    cylinders.radius_mm.push_back(cylinder->radius_mm);
    cylinders.rms_mm.push_back(cylinder->rms_mm);
  }
  return cylinders;
}

// Points in cubes of the neighbourhood's size, as many as make a difference.
SampleGrid GridOf(std::span<const Eigen::Vector3d> working, double block_mm) {
  SampleGrid grid(block_mm, SampleGrid::kMaxPoints, SampleGrid::Links::kNone);
  std::int32_t block = 0;
  for (std::size_t i = 0; i < working.size(); i += kFirstPass) grid.Insert(working[i], block);
  for (std::size_t stride = kFirstPass / 2; stride > 0; stride /= 2) {
    const std::size_t before = grid.sample_count();
    for (std::size_t i = stride; i < working.size(); i += 2 * stride)
      grid.Insert(working[i], block);
    if (kSaturated * (grid.sample_count() - before) < working.size() / (2 * stride)) break;
  }
  return grid;
}

// What a trial radius comes to.
struct Trial {
  bool too_sparse = false;  // and so will be all smaller ones
  double score = 0;         // part of the seeds that agree with it and with each other
  std::vector<double> radius_mm;
  std::vector<double> rms_mm;
};

Trial Try(double trial_mm, double neighbourhood, std::span<const Eigen::Vector3d> working,
          std::span<const Eigen::Vector3d> seeds) {
  Trial trial;
  const SampleGrid grid = GridOf(working, neighbourhood * trial_mm);
  trial.too_sparse = grid.blocks().size() > working.size() / 2;
  if (trial.too_sparse) return trial;
  const auto [votes, asked] = VotesFor(trial_mm, neighbourhood * trial_mm, seeds, grid);
  if (votes.size() < std::max<std::size_t>(5, seeds.size() / 50)) return trial;
  Cylinders cylinders = FitCylinders(trial_mm, votes, grid);
  // Agreement of the cylinders with each other counts, not only that they exist.
  const double center = Median(cylinders.radius_mm);
  std::size_t agree = 0;
  for (const double r : cylinders.radius_mm) agree += std::abs(r / center - 1.0) < 0.1 ? 1 : 0;
  if (agree < 5) return trial;
  trial.score =
      static_cast<double>(agree * votes.size()) / static_cast<double>(cylinders.asked * asked);
  trial.radius_mm = std::move(cylinders.radius_mm);
  trial.rms_mm = std::move(cylinders.rms_mm);
  return trial;
}

// From pipes as thick as the cloud down to where neighbourhoods are too small to be fitted.
Trial BestTrial(std::span<const Eigen::Vector3d> working, std::span<const Eigen::Vector3d> seeds,
                double size_mm, double neighbourhood, Workers* workers) {
  Trial best;
  int worse = 0;
  // With workers the next few are tried at once, of which the last may be in vain.
  std::vector<Trial> ahead(workers ? std::min(workers->threads(), kMostAhead) : 1);
  std::size_t next = ahead.size();
  for (double trial_mm = size_mm / 3.0; trial_mm > size_mm / 5000.0; trial_mm /= kLadderStep) {
    if (next == ahead.size()) {
      ParallelFor(workers, ahead.size(), [&](std::size_t i) {
        double ahead_mm = trial_mm;
        for (std::size_t step = 0; step < i; ++step) ahead_mm /= kLadderStep;
        ahead[i] = Try(ahead_mm, neighbourhood, working, seeds);
      });
      next = 0;
    }
    Trial& trial = ahead[next++];
    if (trial.too_sparse) break;
    if (trial.score > best.score) {
      best = std::move(trial);
      worse = 0;
      if (best.score > kCertain && std::abs(Median(best.radius_mm) / trial_mm - 1.0) < kNearest) {
        break;
      }
      continue;
    }
    // Well past a high peak the smaller trials, the costly ones, need not be looked at. A whole
    // bent tube may pass for a piece of a far thicker one, but never with so much support.
    if (best.score > kHighPeak && trial.score < 0.3 * best.score && ++worse >= 2) break;
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
  // The box of nearly all points: one reading from far away must not set the scale.
  Eigen::Vector3d low, high;
  for (Eigen::Index axis = 0; axis < 3; ++axis) {
    std::vector<double> along;
    along.reserve(working.size());
    for (const Eigen::Vector3d& p : working) along.push_back(p[axis]);
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

  Trial best;
  for (const double neighbourhood : kParaboloidRadius) {
    Trial found = BestTrial(working, seeds, size_mm, neighbourhood, workers);
    if (found.score > best.score) best = std::move(found);
    if (best.score > kConvincing) break;
  }
  if (best.score < kMinSupport) {
    return hal::Fail(hal::ErrorKind::kBadInput,
                     "no pipe found in the points: no part of them is curved like a cylinder "
                     "(expected a scan of a tube with at least a few hundred points on it)");
  }
  PipeRadius result;
  result.radius_mm = Median(best.radius_mm);
  result.noise_mm = Median(best.rms_mm);
  result.sigma_mm =
      1.2533 * RobustSigma(best.radius_mm) / std::sqrt(static_cast<double>(best.radius_mm.size()));
  result.support = best.score;
  return result;
}

}  // namespace bendloop::pipeline
