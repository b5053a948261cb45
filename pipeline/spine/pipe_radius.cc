// SPDX-License-Identifier: Apache-2.0
#include "pipeline/spine/pipe_radius.h"

#include <Eigen/Geometry>
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

// How the radius is looked for (Bauer & Polthier 2009, sections 3.1 and 7): trial radii on a
// ladder, seeds whose paraboloids vote for one, cylinders at the places of the votes.
struct SearchSettings {
  // [of the trial radius] Radius of the ball that a paraboloid looks at: 2/3 as in section 7; the
  // whole where a sparse scan has too few points in that.
  std::array<double, 2> paraboloids = {2.0 / 3.0, 1.0};
  // Score at which the wider paraboloids are not tried (by trial).
  double convincing = 0.25;
  // [of the trial radius] Support of the cylinders; with 1.2 noise biases them fivefold.
  double cylinder_support = 1.6;

  // The ladder: from a third of the cloud's size down to where neighbourhoods are too small.
  // [of the next trial] One trial; their votes, which agree within 0.2, leave no gap (by trial).
  double ladder_step = 1.25;
  // [of the trial] How far the cylinders' median may be from it: no other on the ladder is nearer.
  double nearest = 0.11;
  // Support at which a trial is judged at once, and after which the search ends (by trial).
  double high_peak = 0.5;
  // Score at which it ends without a look at the next (by trial).
  double certain = 0.75;
  // [of the trial] What cylinders leave of their points, from which on a trial is rough: a coil of
  // many turns looks like one pipe as wide as all of it, so the search goes on (by trial).
  double rough = 0.015;
  // A thinner trial whose cylinders leave so much less [mm], as noise never does, is the pipe that
  // the rough one is made of, where so much of the rough one's score agree with it (by trial).
  double much_finer = 1.0 / 3.0, finer_score = 0.2;
  std::size_t most_ahead = 4;  // trials that workers look at together, the last maybe in vain

  // [of the trial's curvature] How far a vote's may be off (by trial).
  double agreement = 0.2;
  // [of the trial's curvature] The other principal curvature is less: no ball (by trial).
  double least_round = 0.75;
  // [of the trial radius] Rougher surfaces have no vote: noise of 0.12 mm on a 2 mm wire is half of
  // it.
  double most_rms = 0.12;
  // [of r_P] Steps of a cylinder fit end below this: less than what noise does.
  double step_tolerance = 1e-3;
  // A neighbourhood holds so many voxels along its radius, or more (by trial).
  double voxels = 5.0;

  // Places that vote, and how many of them are asked first: enough to know where it is worth asking
  // all (by trial).
  std::size_t seeds = 240;
  std::size_t first_seeds = 40;
  // Seeds are asked in an order in which any number of the first are spread over the scan: every
  // so many-th, a prime beyond their number.
  std::size_t seed_step = 389;
  // So many of the votes are asked for cylinders: the median of their radii is good to a part in a
  // thousand.
  std::size_t cylinders = 36;
  std::ptrdiff_t least_cylinders = 5;  // that agree with each other (by trial)
  // A trial's score that stands for a pipe at least (by trial).
  double least_score = 0.04;
  double least_rough_score = 0.1;  // of a rough one: bends of a wire look like that

  // Points that are looked at, and of these for the size of the cloud (by trial).
  std::size_t working_points = 20'000;
  // Where these are too few for thin pipes, and no other convinces, so many times more, again and
  // again up to a million: metres of thin wire.
  std::size_t more_points = 8, most_points = 1'000'000;
  std::size_t box_points = 2'000;
  // [of the points] At either end of each axis so many may lie anywhere (by trial).
  double stray = 0.01;
};
constexpr SearchSettings kSearch;

// When a cylinder at a vote is believed. Lengths in parts of the trial radius; all by trial.
struct CylinderSettings {
  double inlier = 0.35;              // Tukey's cut-off
  double ball_margin = 0.2;          // beyond the support: the axis may move
  double least_coverage = 0.15;      // of the circumference
  double least_axial_spread = 0.15;  // 1 sigma; less is a stripe, which has no direction
  double most_off = 0.4;             // its radius from the trial's
  double agreement = 0.1;            // its radius from the median of all, in parts of that
};
constexpr CylinderSettings kCylinder;

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
  double RoughnessMm() const { return Median(cylinder_rms_mm); }
  bool IsRough() const { return score > 0 && RoughnessMm() > kSearch.rough * radius_mm; }
  bool Beats(const Trial& other) const {
    if (IsMuchFinerThan(other)) return true;
    return score > other.score && !other.IsMuchFinerThan(*this);
  }
  bool IsMuchFinerThan(const Trial& rough) const {
    return rough.IsRough() && radius_mm < rough.radius_mm &&
           score > kSearch.finer_score * rough.score &&
           RoughnessMm() < kSearch.much_finer * rough.RoughnessMm();
  }
  double PartAsked(std::size_t more) const {
    return static_cast<double>(votes.size() + more) / static_cast<double>(asked);
  }
};

// Asks seeds until so many have been asked in all.
void AskSeeds(std::span<const Eigen::Vector3d> seeds, std::size_t until, Trial& trial) {
  std::vector<Eigen::Vector3d> ball;
  while (trial.asked < std::min(until, seeds.size())) {
    const Eigen::Vector3d& seed = seeds[trial.asked++ * kSearch.seed_step % seeds.size()];
    trial.level->GatherBall(seed, trial.neighbourhood_mm, ball);
    const auto surface = FitLocalParaboloid(seed, ball, trial.neighbourhood_mm);
    if (!surface || surface->rms_mm > kSearch.most_rms * trial.radius_mm) continue;
    for (std::size_t i = 0; i < 2; ++i) {
      if (std::abs(std::abs(surface->curvature[i]) * trial.radius_mm - 1.0) < kSearch.agreement &&
          std::abs(surface->curvature[1 - i]) * trial.radius_mm < kSearch.least_round) {
        trial.votes.push_back({*surface, i});
        break;
      }
    }
  }
}

// Asks the other seeds, unless nearly all agree, and free cylinders where they do; those that agree
// with each other, too, count.
void Judge(std::span<const Eigen::Vector3d> seeds, PointPyramid& points, Trial& trial) {
  if (trial.Support() < kSearch.certain) AskSeeds(seeds, seeds.size(), trial);
  const double trial_mm = trial.radius_mm;
  const double support_mm = kSearch.cylinder_support * trial_mm;
  const PointPyramid::Level& level = points.Thinned(support_mm / kSearch.voxels);
  std::vector<Eigen::Vector3d> ball;
  const std::size_t count = std::min(trial.votes.size(), kSearch.cylinders);
  for (std::size_t i = 0; i < count; ++i) {
    const Vote& vote = trial.votes[i * trial.votes.size() / count];
    const double side = vote.surface.curvature[vote.curved] > 0 ? 1.0 : -1.0;
    const Eigen::Vector3d axis_point = vote.surface.foot_mm + side * trial_mm * vote.surface.normal;
    level.GatherBall(axis_point, support_mm + kCylinder.ball_margin * trial_mm, ball);
    const auto cylinder = FitCylinder(axis_point, vote.surface.direction[1 - vote.curved], ball,
                                      {.radius_mm = trial_mm,
                                       .free_radius = true,
                                       .support_mm = support_mm,
                                       .inlier_mm = kCylinder.inlier * trial_mm,
                                       .tolerance = kSearch.step_tolerance});
    if (!cylinder || cylinder->angular_coverage < kCylinder.least_coverage ||
        cylinder->axial_spread_mm < kCylinder.least_axial_spread * trial_mm ||
        std::abs(cylinder->radius_mm / trial_mm - 1.0) > kCylinder.most_off ||
        cylinder->rms_mm > kSearch.most_rms * trial_mm) {
      continue;
    }
    trial.cylinder_radius_mm.push_back(cylinder->radius_mm);
    trial.cylinder_rms_mm.push_back(cylinder->rms_mm);
  }
  const double center_mm = Median(trial.cylinder_radius_mm);
  const auto agree =
      std::count_if(trial.cylinder_radius_mm.begin(), trial.cylinder_radius_mm.end(),
                    [center_mm](double radius_mm) {
                      return std::abs(radius_mm / center_mm - 1.0) < kCylinder.agreement;
                    });
  if (agree < kSearch.least_cylinders) return;
  trial.score = trial.Support() * static_cast<double>(agree) / static_cast<double>(count);
}

// From pipes of `from_mm` down to where neighbourhoods are too small to be fitted: `sparse_mm` is
// where that was, and 0 where the search ended before.
Trial BestTrial(PointPyramid& points, std::span<const Eigen::Vector3d> seeds, double size_mm,
                double from_mm, double neighbourhood, Workers* workers, double& sparse_mm) {
  Trial best;
  sparse_mm = 0;
  int worse = 0;
  // Judging is dear: trials that few agree with wait until it is known what else there is.
  std::vector<Trial> waiting;
  const auto judge = [&](Trial& trial) {
    Judge(seeds, points, trial);
    if (!trial.Beats(best)) return false;
    best = std::move(trial);
    return true;
  };
  // With workers the next few are tried at once, of which the last may be in vain.
  std::vector<Trial> ahead(workers ? std::min(workers->threads(), kSearch.most_ahead) : 1);
  std::size_t next = ahead.size();
  for (double trial_mm = from_mm; trial_mm > size_mm / 5000.0; trial_mm /= kSearch.ladder_step) {
    if (next == ahead.size()) {
      double ahead_mm = trial_mm;
      for (Trial& trial : ahead) {
        trial = {};
        trial.radius_mm = ahead_mm;
        trial.neighbourhood_mm = neighbourhood * ahead_mm;
        trial.level = &points.Thinned(trial.neighbourhood_mm / kSearch.voxels);
        ahead_mm /= kSearch.ladder_step;
      }
      ParallelFor(workers, ahead.size(),
                  [&](std::size_t i) { AskSeeds(seeds, kSearch.first_seeds, ahead[i]); });
      next = 0;
    }
    Trial& trial = ahead[next++];
    if (trial.level->cell_count() > points.size() / 2) {  // so sparse are all smaller ones
      sparse_mm = trial_mm;
      break;
    }
    const bool high = trial.Support() >= kSearch.high_peak;
    if (high && judge(trial)) {
      worse = 0;
      if (best.score > kSearch.certain && !best.IsRough() &&
          std::abs(Median(best.cylinder_radius_mm) / best.radius_mm - 1.0) < kSearch.nearest) {
        break;
      }
      continue;
    }
    // Well past a high peak the smaller trials need not be looked at. A whole bent tube may pass
    // for a piece of a far thicker one, but never with so much support.
    if (best.score > kSearch.high_peak && !best.IsRough() && trial.Support() < 0.5 * best.score &&
        ++worse >= 2) {
      break;
    }
    if (!high) waiting.push_back(std::move(trial));
  }
  std::stable_sort(waiting.begin(), waiting.end(),
                   [](const Trial& a, const Trial& b) { return a.Support() > b.Support(); });
  for (Trial& trial : waiting) {
    if (trial.Hope() <= (best.IsRough() ? kSearch.finer_score : 1.0) * best.score) break;
    judge(trial);
  }
  return best;
}

// The box of nearly all points: one reading from far away must not set the scale.
class NearlyAll {
 public:
  explicit NearlyAll(std::span<const Eigen::Vector3d> points) {
    const std::vector<Eigen::Vector3d> some = Pick(points, kSearch.box_points);
    for (Eigen::Index axis = 0; axis < 3; ++axis) {
      std::vector<double> along;
      along.reserve(some.size());
      for (const Eigen::Vector3d& p : some) along.push_back(p[axis]);
      low_[axis] = Quantile(along, kSearch.stray);
      high_[axis] = Quantile(std::move(along), 1.0 - kSearch.stray);
    }
    margin_mm_ = (high_ - low_).norm();
  }
  // Those within it, and as much beside it.
  std::vector<Eigen::Vector3d> Of(std::vector<Eigen::Vector3d> points) const {
    std::erase_if(points, [this](const Eigen::Vector3d& p) {
      return ((p - low_).array() < -margin_mm_).any() || ((p - high_).array() > margin_mm_).any();
    });
    return points;
  }

 private:
  Eigen::Vector3d low_, high_;
  double margin_mm_;
};

// Diagonal of the points' box.
double SizeOf(std::span<const Eigen::Vector3d> points) {
  Eigen::AlignedBox3d box;
  for (const Eigen::Vector3d& p : points) box.extend(p);
  return box.isEmpty() ? 0.0 : box.diagonal().norm();
}

// With the narrower paraboloids, and with the wider ones where these do not convince.
Trial BestOf(std::span<const Eigen::Vector3d> points, std::span<const Eigen::Vector3d> seeds,
             double size_mm, double from_mm, Workers* workers, double& sparse_mm) {
  PointPyramid pyramid(points);
  Trial best;
  for (const double neighbourhood : kSearch.paraboloids) {
    Trial found = BestTrial(pyramid, seeds, size_mm, from_mm, neighbourhood, workers, sparse_mm);
    if (found.Beats(best)) best = std::move(found);
    if (best.score > kSearch.convincing) break;
  }
  return best;
}

}  // namespace

hal::Result<PipeRadius> EstimatePipeRadius(std::span<const Eigen::Vector3d> points,
                                           Workers* workers) {
  if (points.empty()) {
    return hal::Fail(hal::ErrorKind::kBadInput, "no points; expected a scan of a tube");
  }
  const std::vector<Eigen::Vector3d> some = Pick(points, kSearch.working_points);
  const NearlyAll nearly_all(some);
  std::vector<Eigen::Vector3d> working = nearly_all.Of(some);
  const double size_mm = SizeOf(working);
  const std::vector<Eigen::Vector3d> seeds = Pick(working, kSearch.seeds);
  double sparse_mm = 0;
  Trial best = BestOf(working, seeds, size_mm, size_mm / 3.0, workers, sparse_mm);
  for (std::size_t count = kSearch.working_points;
       best.score < kSearch.convincing && sparse_mm > 0 &&
       count < std::min(points.size(), kSearch.most_points);) {
    count *= kSearch.more_points;
    working = nearly_all.Of(Pick(points, count));
    // Trials near the border had few points, too.
    const double from_mm = std::min(size_mm / 3.0, 2.0 * sparse_mm);
    Trial found = BestOf(working, seeds, size_mm, from_mm, workers, sparse_mm);
    if (found.Beats(best)) best = std::move(found);
  }
  if (best.score < (best.IsRough() ? kSearch.least_rough_score : kSearch.least_score)) {
    return hal::Fail(hal::ErrorKind::kBadInput,
                     "no pipe found in the points: no part of them is curved like a cylinder "
                     "(expected a scan of a tube with at least a few hundred points on it)");
  }
  PipeRadius result;
  result.radius_mm = Median(best.cylinder_radius_mm);
  result.noise_mm = Median(best.cylinder_rms_mm);
  // The median of normal values scatters sqrt(pi / 2) times as much as their mean.
  result.sigma_mm = 1.2533 * RobustSigma(best.cylinder_radius_mm) /
                    std::sqrt(static_cast<double>(best.cylinder_radius_mm.size()));
  result.support = best.score;
  return result;
}

}  // namespace bendloop::pipeline
