// SPDX-License-Identifier: Apache-2.0
#include "pipeline/features/end_cut.h"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <numbers>
#include <vector>

#include "hal/angles.h"
#include "pipeline/features/end_bevel.h"
#include "pipeline/features/end_border.h"
#include "pipeline/features/end_burr.h"
#include "pipeline/features/end_curve.h"
#include "pipeline/features/end_evidence.h"
#include "pipeline/features/end_samples.h"
#include "pipeline/features/end_shadow.h"
#include "pipeline/features/posterior.h"
#include "pipeline/features/sampling.h"
#include "pipeline/math/dense_solve.h"
#include "pipeline/math/quantiles.h"

namespace bendloop::pipeline {
namespace {

struct EndCutSettings {
  // [of r_P] From the border into the tube: where the gaps between samples are looked at.
  double window = 3.0;
  // Slopes before the scan, 1 sigma: any that a saw makes. Samples that leave more than a tenth of
  // it open tell nothing of the cut; its pull on others is below a hundredth of their sigma's
  // reach.
  double usual_slope = 0.5;
  // The same of ends that are to be square.
  double square_slope = 0.01;
  // Odds before the scan that an end is not square; and the logarithm of odds that leave no doubt.
  double oblique_odds = 0.1, sure_odds = 6.0;
  // [sigma] From a square cut; closer ones are taken for it.
  double oblique = 5.0;
  // Steps of the walk, and of one that says whether the end may be oblique at all, from so many
  // sigma on.
  int walk = 1500, short_walk = 500;
  double may_be_oblique = 2.5;
  // [of the mean gap] The walk's first steps.
  double first_step = 0.1;
  // Samples of an end: so many tell where about the plane is, and then all that lie beside it are
  // asked (end_border.h); laser lines should have theirs whole.
  std::size_t enough_samples = 9'000, enough_of_lines = 40'000;
  // [of the mean gap] Lines are blurred by so much, one after the other, before they are taken as
  // they are: what they leave free may be a needle, which a walk finds only by and by.
  std::array<double, 4> blurs = {0.3, 0.1, 0.03, 0.01};
  int blurred_walk = 250;
  double far = 6.0;  // [sigma]
  // Of the variance after the last blur: less is none.
  double least_moved = 1e-3;
  // [of the mean gap] Sides that are contradicted by more, and how many of all may be.
  double wrong = 0.1, most_wrong = 0.15;
  // [of its mean gap] A column that stops so far beyond a plane, or before it, contradicts it.
  double stops_beyond = 0.3, stops_before = 6.0;
  // All others contradict it together where they stop so much rarer before it than by chance: of
  // the mean, and [sigma].
  double rarer = 0.4, rarer_sigmas = 4.5;
  // [of their smear] Samples that lie so far beyond a plane, how many of all may, and those of how
  // much of the turn.
  double beyond = 4.0, fliers = 3.0, flier_part = 0.005, beside = 0.25;
  // The logarithm of how much likelier a shadow on one side is to be, that it is one; where it is
  // less likely by as much, of each column, it may be. Part of the turn that a cut is told by, and
  // that is about all.
  double shadow = 10.0, perhaps = 0.3, least_seen = 0.2, all_seen = 0.75;
  // The same of a border that no plane is, of each column. By trial: of shadows -0.5 and more, of
  // waves that were cut -1 and less.
  double shadow_of_curve = 0.2, perhaps_of_curve = 0.8;
  // [of r_P] The end beside a shadow that lies so much further out is looked for again from there,
  // so often at most.
  double further = 1.0;
  int most_further = 4;
  // [of r_P] Deeper samples are of no dent.
  double deepest_dent = 0.35;
  // Of the wall so far before an end [of r_P] sectors have this part, at least, of the samples that
  // they have on three times as much of it, where it is whole; so many of them are beside a dent.
  double whole_before = 0.15, whole_part = 0.5, least_whole = 0.25;
  // Of how far the face of the cut lies beyond the wall's border, where no bevel is certain between
  // them: the tube ends there to 1 sigma of this part.
  double perhaps_bevelled = 0.3;
  // A slope that is known no better may be of any end.
  double unsure_slope = 0.3;
  // [of their 1 sigma, together] Planes that are nearer to each other are one.
  double apart = 3.0;
  // Of scattered samples' columns: so many look like lines by chance.
  double by_chance = 0.2;
  // Of the noise across the wall: how unsure it makes, along the tube, where columns of a cloud
  // stop. By trial.
  double along_of_cloud = 0.5;
};
constexpr EndCutSettings kCut;

// The logarithm of the likelihood of planes.
class PlaneLikelihood {
 public:
  // `blur_mm`: laser lines are as uncertain as this, at least.
  PlaneLikelihood(const EndEvidence& evidence, double blur_mm)
      : evidence_(evidence), sides_(evidence.sides.size()), stops_(evidence.columns.size()) {
    for (const EndSide& side : evidence.sides) {
      AddSide(side, std::max(side.sigma_mm, blur_mm), sides_);
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
    return side.Clear(planes.mean) > kCut.far * (spread_mm + std::max(side.sigma_mm, blur_mm));
  });
}

EndCutFound Found(const EndPlane& plane) {
  const double slope = std::hypot(plane.cosine, plane.sine);
  EndCutFound found;
  found.cut.obliquity_deg = std::atan(slope) * hal::kDegreesPerRadian;
  found.cut.around_deg = std::atan2(plane.sine, plane.cosine) * hal::kDegreesPerRadian;
  found.obliquity_sigma_deg = plane.slope_sigma / (1.0 + slope * slope) * hal::kDegreesPerRadian;
  found.around_sigma_deg =
      std::min(180.0, plane.slope_sigma / std::max(slope, 1e-9) * hal::kDegreesPerRadian);
  found.border = plane.border;
  return found;
}

EndPlane PlaneOf(const Posterior& posterior, const Eigen::Vector2d& slope_mm, double r_mm) {
  const Eigen::Vector2d slope = (posterior.mean.segment<2>(1) + slope_mm) / r_mm;
  const Eigen::Matrix2d covariance = posterior.covariance.block<2, 2>(1, 1) / (r_mm * r_mm);
  EndPlane plane;
  plane.at_mm = posterior.mean[0];
  plane.at_sigma_mm = posterior.Sigma(0);
  plane.cosine = slope[0];
  plane.sine = slope[1];
  plane.slope_sigma = std::sqrt(0.5 * covariance.trace());
  plane.slope_sigmas = std::sqrt(std::max(0.0, slope.dot(covariance.inverse() * slope)));
  return plane;
}

// Of what is roughly known of a plane, what more is known; none: nothing.
using BetterPlane = std::function<std::optional<Posterior>(const Posterior&)>;

// A walk that found no way says less than the one before.
bool HasMoved(const Posterior& walk, const Posterior& before) {
  return walk.covariance.trace() > kCut.least_moved * before.covariance.trace();
}

// Mean and spread of all planes; `better`: asked when where about they lie is known, which is all
// that is said where it knows nothing.
EndPlane PlaneAmong(EndEvidence evidence, const Eigen::Vector2d& slope_mm, double r_mm,
                    WalkDice& dice, const BetterPlane& better = {}) {
  const double prior_mm = kCut.usual_slope * r_mm;
  const auto sample = [&](const Posterior& from, int walk, double blur_mm) {
    const PlaneLikelihood likelihood(evidence, blur_mm);
    return SamplePosterior(from, walk, dice, [&](const Eigen::VectorXd& x) {
      const double steep = (x.tail<2>() + slope_mm).squaredNorm() / (prior_mm * prior_mm);
      return likelihood.Log(x) - 0.5 * steep;
    });
  };
  const double first_mm = kCut.first_step * evidence.gap_mm;
  Posterior posterior{RoughEndPlane(evidence, r_mm),
                      first_mm * first_mm * Eigen::Matrix3d::Identity()};
  // A few samples look like lines by chance; those leave no needle.
  if (evidence.sides.size() > evidence.columns.size()) {
    for (const double blur : kCut.blurs) {
      const Posterior blurred = sample(posterior, kCut.blurred_walk, blur * evidence.gap_mm);
      if (!HasMoved(blurred, posterior)) continue;
      posterior = blurred;
      Forget(posterior, blur * evidence.gap_mm, evidence);
    }
  }
  EndPlane plane;
  for (const int walk : {kCut.short_walk, kCut.walk}) {
    const Posterior sharp = sample(posterior, walk, 0.0);
    if (HasMoved(sharp, posterior)) posterior = sharp;
    plane = PlaneOf(posterior, slope_mm, r_mm);
    if (better && walk == kCut.short_walk) {
      Posterior whole = posterior;
      whole.mean.tail<2>() += slope_mm;
      const auto found = better(whole);
      return found ? PlaneOf(*found, Eigen::Vector2d::Zero(), r_mm) : plane;
    }
    if (plane.slope_sigmas < kCut.may_be_oblique) break;
  }
  return plane;
}

Eigen::Vector3d NumbersOf(const EndPlane& plane, double r_mm) {
  return {plane.at_mm, r_mm * plane.cosine, r_mm * plane.sine};
}

// Whether columns, none of which contradicts a plane by itself, stop too far before it together, as
// those of a border that waves about it do. `x`: as the evidence counts.
bool StopTooFarBefore(const Eigen::Vector3d& x, const EndEvidence& evidence) {
  double rarity = 0, columns = 0;
  for (const EndStop& stop : evidence.columns) {
    const double off =
        (x[0] + stop.cosine * x[1] + stop.sine * x[2] - stop.last_mm) / stop.mean_gap_mm;
    if (off > kCut.stops_before) continue;
    rarity += evidence.gaps_before.Rarity(off);
    columns += 1;
  }
  const double sigma = std::sqrt(evidence.columns_of_line * columns);
  return rarity - columns > std::max(kCut.rarer * columns, kCut.rarer_sigmas * sigma);
}

// Whether most of the lines and columns stop where the plane is; else they stop at something that
// is none. `slope_mm`: that the evidence counts from.
bool Agrees(const EndPlane& plane, const EndEvidence& evidence, const Eigen::Vector2d& slope_mm,
            double r_mm) {
  Eigen::Vector3d x = NumbersOf(plane, r_mm);
  x.tail<2>() -= slope_mm;
  auto wrong = std::count_if(
      evidence.sides.begin(), evidence.sides.end(),
      [&](const EndSide& side) { return side.Clear(x) < -kCut.wrong * evidence.gap_mm; });
  wrong +=
      std::count_if(evidence.columns.begin(), evidence.columns.end(), [&](const EndStop& stop) {
        const double off =
            (x[0] + stop.cosine * x[1] + stop.sine * x[2] - stop.last_mm) / stop.mean_gap_mm;
        return off < -kCut.stops_beyond || off > kCut.stops_before;
      });
  return static_cast<double>(wrong) <
             kCut.most_wrong *
                 static_cast<double>(evidence.sides.size() + evidence.columns.size()) &&
         !StopTooFarBefore(x, evidence);
}

// How far along the tube samples reach.
double DepthMm(std::span<const EndSample> samples) {
  if (samples.empty()) return 0.0;
  const auto [low, high] = std::minmax_element(
      samples.begin(), samples.end(),
      [](const EndSample& a, const EndSample& b) { return a.beyond_mm < b.beyond_mm; });
  return high->beyond_mm - low->beyond_mm;
}

// What walks share.
struct EndDice {
  WalkDice plane{3}, border{4};
};

// What is asked of all samples about an end.
struct AllSamples {
  std::size_t count = 0;
  bool knows_passes = false;                                        // of the scan
  std::function<std::vector<EndSample>(std::size_t stride)> every;  // so many of them
  EndBand band;
  // Where something hides that the wall goes on beyond a plane.
  std::function<EndSectors(const Eigen::Vector3d& plane_mm)> hidden;
};

// The plane of an end, or a border that none is where lines and columns say so.
class EndFit {
 public:
  EndFit(AllSamples all, double pipe_radius_mm, double window_mm, double sigma_mm, EndDice& dice)
      : all_(std::move(all)),
        r_mm_(pipe_radius_mm),
        window_mm_(window_mm),
        sigma_mm_(sigma_mm),
        smear_mm_(kSampling.SmearMm(sigma_mm, pipe_radius_mm)),
        dice_(dice) {}

  std::optional<EndPlane> Fit() {
    // Where nobody knows passes, columns say at less cost whether there are lines at all.
    Eigen::Vector2d slope_mm = Eigen::Vector2d::Zero();
    std::optional<EndEvidence> columns;
    if (!all_.knows_passes) columns = LookAtColumns(slope_mm);
    if (!columns || MayBeLines(*columns)) {
      if (auto plane = OfLines()) return all_.knows_passes ? plane : UnlessScattered(*plane);
    }
    if (all_.knows_passes) columns = LookAtColumns(slope_mm);
    if (!columns) return std::nullopt;
    const EndPlane plane = OfColumns(*columns, slope_mm);
    const bool agrees = Agrees(plane, *columns, slope_mm, r_mm_);
    const auto border = agrees ? std::nullopt : Bordered(plane, *columns, slope_mm);
    if (border) return UnlessInShadow(*border);
    const EndPlane certain = Certain(plane);
    if (agrees && certain.slope_sigmas < kCut.may_be_oblique) return certain;
    return UnlessInShadow(certain);
  }

 private:
  static bool MayBeLines(const EndEvidence& columns) {
    const double with_lines = 0.5 * static_cast<double>(columns.sides.size());
    return with_lines > kCut.by_chance * (with_lines + static_cast<double>(columns.columns.size()));
  }

  std::size_t OfLinesStride() const { return StrideTo(all_.count, kCut.enough_of_lines); }
  std::optional<EndEvidence> LookAtColumns(Eigen::Vector2d& slope_mm) {
    const std::size_t stride = OfLinesStride();
    const std::size_t left = (all_.count + stride - 1) / stride;
    of_columns_ = all_.every(stride * StrideTo(left, kCut.enough_samples));
    depth_mm_ = DepthMm(of_columns_);
    return LookAtEndColumns(of_columns_, r_mm_, window_mm_, smear_mm_, slope_mm);
  }

  std::optional<EndPlane> OfLines() {
    const auto lines =
        LookAtEndLines(all_.every(OfLinesStride()), r_mm_, window_mm_, smear_mm_, sigma_mm_);
    if (!lines) return std::nullopt;
    EndPlane plane = PlaneAmong(*lines, Eigen::Vector2d::Zero(), r_mm_, dice_.plane);
    plane.of_lines = true;
    if (Agrees(plane, *lines, Eigen::Vector2d::Zero(), r_mm_)) return plane;
    return Bordered(plane, *lines, Eigen::Vector2d::Zero());
  }

  // `columns`: is told how many of them say the same where samples are not scattered.
  EndPlane OfColumns(EndEvidence& columns, const Eigen::Vector2d& slope_mm) {
    // Where laser lines are seen the columns have said all; a few samples look like some by chance.
    if (columns.sides.size() <= columns.columns.size()) {
      RoughEnd rough = Rough();
      bool of_border = false;
      const auto better = [&](const Posterior& about) {
        rough.plane = about;
        if (!rough.knows_rays) rough.hidden = SectorsInShadow(columns, slope_mm, about.mean);
        const auto border = FitEndBorder(rough, all_.band, dice_.border);
        of_border = border.has_value();
        return border;
      };
      EndPlane plane = PlaneAmong(columns, slope_mm, r_mm_, dice_.plane, better);
      plane.of_border = of_border;
      if (of_border) PlaceOfSquare(rough, plane);
      if (of_border) return plane;
    }
    const auto lines = EndColumnsAbout(of_columns_, window_mm_, smear_mm_, slope_mm, true);
    if (lines) columns = *lines;
    EndPlane plane = PlaneAmong(columns, slope_mm, r_mm_, dice_.plane);
    // Of a cloud nobody knows how far noise moves samples along the tube.
    if (!all_.knows_passes) {
      plane.at_sigma_mm = std::hypot(plane.at_sigma_mm, kCut.along_of_cloud * sigma_mm_);
    }
    return plane;
  }

  // By all samples about a rough plane; none: they are not scattered, or too few.
  std::optional<EndPlane> OfBorder(const RoughEnd& rough) const {
    const auto border = FitEndBorder(rough, all_.band, dice_.border);
    if (!border) return std::nullopt;
    EndPlane plane = PlaneOf(*border, Eigen::Vector2d::Zero(), r_mm_);
    plane.of_border = true;
    PlaceOfSquare(rough, plane);
    return plane;
  }

  // The samples of a cloud look like lines by chance now and then.
  EndPlane UnlessScattered(const EndPlane& of_lines) const {
    RoughEnd rough = Rough();
    const double at_mm = std::hypot(of_lines.at_sigma_mm, rough.smear_mm);
    const double slope_mm = std::hypot(r_mm_ * of_lines.slope_sigma, rough.smear_mm);
    rough.plane = {NumbersOf(of_lines, r_mm_), Eigen::Matrix3d::Zero(), 0.0};
    rough.plane.covariance.diagonal() << at_mm * at_mm, slope_mm * slope_mm, slope_mm * slope_mm;
    const auto border = OfBorder(rough);
    return border ? Certain(*border) : of_lines;
  }

  // What is known of the end but its plane.
  RoughEnd Rough() const {
    const double seen_mm2 = 2.0 * std::numbers::pi * r_mm_ * depth_mm_;
    RoughEnd rough;
    rough.pipe_radius_mm = r_mm_;
    rough.knows_rays = all_.knows_passes;
    rough.smear_mm = rough.knows_rays ? smear_mm_ : std::max(smear_mm_, sigma_mm_);
    rough.per_mm2 = static_cast<double>(all_.count) / seen_mm2;
    rough.slope_mm = kCut.usual_slope * r_mm_;
    rough.is_thinned = all_.count > kCut.enough_samples;
    return rough;
  }

  // What is not oblique for all that is seen was cut about square: few samples tell the place of
  // such a plane better than that of any. Where it may be either its place is both planes', by
  // their odds: the prior's, by Laplace's volume of two slopes, by what speaks for them.
  void PlaceOfSquare(RoughEnd rough, EndPlane& plane) const {
    const double volume = std::pow(plane.slope_sigma / kCut.usual_slope, 2);
    const double log_odds =
        std::log(kCut.oblique_odds * volume) + 0.5 * std::pow(plane.slope_sigmas, 2);
    if (log_odds > kCut.sure_odds) return;
    rough.slope_mm = kCut.square_slope * r_mm_;
    rough.plane.mean.tail<2>().setZero();
    const auto square = FitEndBorder(rough, all_.band, dice_.border);
    if (!square) return;
    const double part = 1.0 / (1.0 + std::exp(-log_odds));  // of the oblique one
    const double apart_mm = plane.at_mm - square->mean[0];
    plane.at_sigma_mm =
        std::sqrt(part * std::pow(plane.at_sigma_mm, 2) + (1.0 - part) * square->covariance(0, 0) +
                  part * (1.0 - part) * apart_mm * apart_mm);
    plane.at_mm = square->mean[0] + part * apart_mm;
  }

  // Columns of few samples each may stop by chance as those of an oblique cut would: where the
  // plane leaves more of the wall beyond itself than fliers are, that is all. Else what speaks for
  // its obliquity are the samples that a square cut as far out would have beyond it, and are not
  // there: so many are missing by chance as seldom as a normal distribution leads so far.
  EndPlane Certain(EndPlane plane) const {
    if (plane.slope_sigmas < kCut.may_be_oblique) return plane;
    const Eigen::Vector3d at = NumbersOf(plane, r_mm_);
    const std::vector<EndSample> samples = all_.every(StrideTo(all_.count, kCut.enough_samples));
    double beyond = 0, beyond_mm = 0, outermost_mm = at[0];
    EndSectors goes_on{};
    for (const EndSample& sample : samples) {
      const double off_mm = sample.beyond_mm - at[0] - at.tail<2>().dot(sample.Direction());
      const bool is_beyond = off_mm > kCut.beyond * smear_mm_;
      if (is_beyond) {
        beyond += 1;
        beyond_mm += off_mm;
        goes_on[EndSectorOf(sample.around_rad)] = true;
      } else {
        outermost_mm = std::max(outermost_mm, sample.beyond_mm);
      }
    }
    // A table goes on beside the end in a few sectors, too.
    const auto sectors = std::count(goes_on.begin(), goes_on.end(), true);
    if (beyond > kCut.fliers + kCut.flier_part * static_cast<double>(samples.size()) &&
        static_cast<double>(sectors) > kCut.beside * static_cast<double>(kEndSectors)) {
      plane.at_sigma_mm = std::hypot(plane.at_sigma_mm, beyond_mm / beyond);
      plane.slope_sigma = std::max(plane.slope_sigma, std::hypot(plane.cosine, plane.sine));
      plane.slope_sigmas = 0;
      return plane;
    }
    const double per_mm = static_cast<double>(all_.count) / std::max(depth_mm_, r_mm_);
    const double missing = per_mm * (outermost_mm - at[0]);
    const double certain = std::max(1.0, std::sqrt(2.0 * missing));
    if (certain < std::min(plane.slope_sigmas, kCut.oblique)) {
      plane.slope_sigma *= plane.slope_sigmas / certain;
      plane.slope_sigmas = certain;
    }
    return plane;
  }

  // The plane, or border, where samples stop; or where the sides end that are in no shadow. Where
  // either may be, it is as unsure as both are apart.
  EndPlane UnlessInShadow(const EndPlane& plane) const {
    const std::vector<EndSample> samples = all_.every(StrideTo(all_.count, kCut.enough_samples));
    const EndInDoubt doubt{r_mm_,        window_mm_,        smear_mm_, NumbersOf(plane, r_mm_),
                           plane.border, plane.border_terms};
    const auto shadowed = FindEndInShadow(samples, doubt, dice_.plane);
    if (!shadowed || shadowed->seen < kCut.least_seen) return plane;
    // A series follows the edge of a shadow, too.
    const bool is_curve = !plane.border.empty();
    const double sure = is_curve ? -kCut.shadow_of_curve * shadowed->columns : kCut.shadow;
    const double perhaps = -(is_curve ? kCut.perhaps_of_curve : kCut.perhaps) * shadowed->columns;
    if (shadowed->likelier < perhaps) return plane;
    const double apart_mm = std::abs(shadowed->plane.mean[0] - plane.at_mm);
    if (apart_mm < kCut.apart * (shadowed->plane.Sigma(0) + plane.at_sigma_mm)) return plane;
    if (shadowed->likelier > sure) return BesideShadow(*shadowed, samples);
    EndPlane either = plane;
    either.at_sigma_mm = std::hypot(plane.at_sigma_mm, apart_mm);
    either.slope_sigma = std::max(plane.slope_sigma, std::hypot(plane.cosine, plane.sine));
    either.slope_sigmas = 0;
    either.in_shadow = true;
    return either;
  }

  EndPlane BesideShadow(const ShadowedEnd& end, std::span<const EndSample> samples) const {
    EndPlane plane = PlaneOf(end.plane, Eigen::Vector2d::Zero(), r_mm_);
    RoughEnd rough = Rough();
    rough.plane = end.plane;
    const Eigen::Vector2d slope_mm = end.plane.mean.tail<2>();
    if (const auto columns = EndColumnsAbout(samples, window_mm_, smear_mm_, slope_mm)) {
      rough.hidden = SectorsInShadow(*columns, slope_mm, end.plane.mean);
      if (const auto border = OfBorder(rough)) plane = *border;
    }
    plane.in_shadow = end.seen < kCut.all_seen;
    // A slope that a part of the turn shows may be another's.
    if (plane.in_shadow && plane.slope_sigmas > kCut.may_be_oblique) {
      plane.slope_sigma *= plane.slope_sigmas / kCut.may_be_oblique;
      plane.slope_sigmas = kCut.may_be_oblique;
    }
    return plane;
  }

  // None: no border explains the samples better than a plane that they contradict.
  std::optional<EndPlane> Bordered(const EndPlane& plane, const EndEvidence& evidence,
                                   const Eigen::Vector2d& slope_mm) const {
    const EndSectors hidden = all_.hidden(NumbersOf(plane, r_mm_));
    const auto curve = FitEndCurve(evidence, slope_mm, hidden, r_mm_);
    if (!curve) return std::nullopt;
    EndPlane of_curve = PlaneOf(*curve, Eigen::Vector2d::Zero(), r_mm_);
    of_curve.border = PlacesOf(*curve);
    of_curve.border_terms = static_cast<int>(curve->mean.size());
    return of_curve;
  }

  AllSamples all_;
  double r_mm_, window_mm_, sigma_mm_, smear_mm_;
  std::vector<EndSample> of_columns_;
  double depth_mm_ = 0;  // along the tube, of the samples of columns
  EndDice& dice_;
};

// One end: its plane, and what it has beside it.
struct FoundCut {
  EndPlane plane;
  EndCutFound cut;
  bool is_dented = false, may_be_bevelled = false, has_rim = false;
};
class CutSearch {
 public:
  CutSearch(double pipe_radius_mm, double window_mm, double sigma_mm, EndDice& dice)
      : r_mm_(pipe_radius_mm), window_mm_(window_mm), sigma_mm_(sigma_mm), dice_(dice) {}

  std::optional<FoundCut> Find(const SamplesNearEnd& near) {
    const auto plane = PlaneOfWall(near);
    if (!plane) return std::nullopt;
    FoundCut found{*plane, Found(*plane)};
    // What is pressed in is on one side: neither a shadow there nor the flank of a bevel.
    if (const auto dented = UnlessDented(near, *plane)) return dented;
    if (plane->in_shadow) return found;
    const Eigen::Vector3d of_wall_mm = NumbersOf(*plane, r_mm_);
    // Where the wall comes in or stands out, it ends before the tube does.
    const BevelSearch search = FindBevel(near, of_wall_mm, r_mm_, sigma_mm_);
    if (const auto& bevel = search.bevel) {
      if (const auto tip = PlaneOfWall(near.With(bevel->samples))) {
        found = {*tip, Found(*tip)};
        found.cut.bevel = bevel->Found(tip->at_mm - of_wall_mm[0], tip->at_sigma_mm);
      }
      return found;
    }
    if (const auto rimmed = WithRim(near, of_wall_mm)) return rimmed;
    // Beside what stands out, as a flare does, the face is another's.
    const auto out = static_cast<double>(near.outside().size());
    if (search.perhaps_mm > 0 &&
        out < kCut.fliers + kCut.flier_part * static_cast<double>(near.wall().size())) {
      found.plane.at_mm += search.perhaps_mm;
      found.plane.at_sigma_mm =
          std::hypot(found.plane.at_sigma_mm, kCut.perhaps_bevelled * search.perhaps_mm);
      found.may_be_bevelled = true;
    }
    return found;
  }

 private:
  std::optional<FoundCut> WithRim(const SamplesNearEnd& near, const Eigen::Vector3d& of_wall_mm) {
    const std::vector<NearEnd> out = StandingOut(near, of_wall_mm, r_mm_, sigma_mm_);
    if (out.empty()) return std::nullopt;
    const SamplesNearEnd whole = near.With(out);
    const auto tip = PlaneOfWall(whole);
    if (!tip) return std::nullopt;
    const RimTip ends{NumbersOf(*tip, r_mm_), tip->at_sigma_mm, tip->slope_sigma};
    const auto rim = FindRim(whole, ends, r_mm_, sigma_mm_);
    if (!rim) return std::nullopt;
    FoundCut found{*tip, Found(*tip)};
    found.cut.burr = rim->burr;
    found.has_rim = true;
    return found;
  }

  // Where a dent presses the wall in its samples still show that it goes on: an end that is square
  // with them and oblique, or a curve, without is dented.
  std::optional<FoundCut> UnlessDented(const SamplesNearEnd& near, const EndPlane& plane) {
    const auto may_be_square = [](const EndPlane& of) {
      return of.slope_sigmas < kCut.may_be_oblique && of.slope_sigma < kCut.unsure_slope &&
             of.border.empty() && !of.in_shadow;
    };
    if (may_be_square(plane)) return std::nullopt;
    std::vector<NearEnd> pressed_in;
    for (const NearEnd& sample : near.inside()) {
      if (sample.RadiusMm() > (1.0 - kCut.deepest_dent) * r_mm_) pressed_in.push_back(sample);
    }
    if (pressed_in.empty()) return std::nullopt;
    const auto square = PlaneOfWall(near.With(pressed_in));
    if (!square || !may_be_square(*square)) return std::nullopt;
    const Eigen::Vector3d square_mm = NumbersOf(*square, r_mm_);
    if (!StandingOut(near, square_mm, r_mm_, sigma_mm_).empty()) return std::nullopt;
    if (!IsWholeElsewhere(near, square_mm)) return std::nullopt;
    return FoundCut{*square, Found(*square), true};
  }

  // Whether the wall, and not what lies further in, goes on to the plane on some sides.
  bool IsWholeElsewhere(const SamplesNearEnd& near, const Eigen::Vector3d& plane_mm) const {
    std::array<double, kEndSectors> before{}, at_end{};
    const double part_mm = kCut.whole_before * r_mm_;
    for (const NearEnd& sample : near.wall()) {
      const double before_mm = -sample.BeyondMm(plane_mm);
      if (before_mm > 3.0 * part_mm) continue;
      const std::size_t sector = EndSectorOf(sample.AroundRad());
      if (before_mm < part_mm) at_end[sector] += 1;
      before[sector] += 1.0 / 3.0;
    }
    double whole = 0, seen = 0;
    for (std::size_t i = 0; i < kEndSectors; ++i) {
      seen += before[i] > 0 ? 1 : 0;
      whole += at_end[i] > kCut.whole_part * before[i] ? 1 : 0;
    }
    return whole > kCut.least_whole * seen;
  }

  std::optional<EndPlane> PlaneOfWall(const SamplesNearEnd& near) {
    AllSamples all{near.size(), near.knows_passes(),
                   [&](std::size_t stride) { return near.Every(stride); },
                   [&](const Eigen::Vector3d& plane_mm, double below_mm, double above_mm) {
                     return near.Band(plane_mm, below_mm, above_mm);
                   },
                   [&](const Eigen::Vector3d& plane_mm) { return near.Hidden(plane_mm); }};
    return EndFit(std::move(all), r_mm_, window_mm_, sigma_mm_, dice_).Fit();
  }

  double r_mm_, window_mm_, sigma_mm_;
  EndDice& dice_;
};

// An end among the samples about it.
struct SeenEnd {
  FoundCut cut;
  bool knows_passes = false;
  bool is_further = false;  // than was looked at first

  // Whether it tells the end's place better than the borders' outermost point does.
  bool IsSurerThan(double sigma_mm) const {
    const EndPlane& plane = cut.plane;
    if (plane.slope_sigmas >= kCut.oblique || plane.of_border || is_further) return true;
    // Where the wall comes in, or its border is no plane, its outermost point is not the end.
    if (cut.cut.bevel || cut.has_rim || cut.is_dented || cut.may_be_bevelled) return true;
    if (!plane.border.empty() || plane.in_shadow) return true;
    // Laser lines tell of an end's place at its axis whether it is square or not.
    return plane.of_lines &&
           (plane.slope_sigmas >= kCut.may_be_oblique || plane.at_sigma_mm < sigma_mm);
  }
};

class EndSearch {
 public:
  EndSearch(const hal::Tube& tube, bool at_start, double sigma_mm,
            std::span<const PointBlock> blocks, EndDice& dice)
      : tube_(tube), at_start_(at_start), sigma_mm_(sigma_mm), blocks_(blocks), dice_(dice) {}

  std::optional<SeenEnd> Find(EndAxis axis) {
    auto end = FindAt(axis);
    // Beside a shadow the tube may go on for longer than is looked at.
    double further_mm = 0;
    for (int i = 0; i < kCut.most_further && end; ++i) {
      const double at_mm = end->cut.plane.at_mm;
      if (!end->cut.plane.in_shadow || at_mm < kCut.further * tube_.pipe_radius_mm) break;
      axis.end_mm += at_mm * axis.outward;
      const auto next = FindAt(axis);
      if (!next) break;
      further_mm += at_mm;
      end = next;
    }
    if (!end) return std::nullopt;
    end->cut.plane.at_mm += further_mm;
    end->is_further = further_mm > 0;
    return end;
  }

 private:
  std::optional<SeenEnd> FindAt(const EndAxis& axis) {
    const auto& rows = tube_.program.rows;
    const double straight_mm = at_start_ ? rows.front().length_mm : rows.back().length_mm;
    const double r_mm = tube_.pipe_radius_mm;
    const double window_mm = std::min(kCut.window * r_mm, straight_mm);
    const SamplesNearEnd near(tube_, at_start_, axis, sigma_mm_, window_mm, blocks_);
    const auto cut = CutSearch(r_mm, window_mm, sigma_mm_, dice_).Find(near);
    if (!cut) return std::nullopt;
    return SeenEnd{*cut, near.knows_passes(), false};
  }

  const hal::Tube& tube_;
  bool at_start_;
  double sigma_mm_;
  std::span<const PointBlock> blocks_;
  EndDice& dice_;
};

}  // namespace

std::optional<EndPlane> FitEndPlane(std::span<const EndSample> samples, double pipe_radius_mm,
                                    double window_mm, double sigma_mm, bool knows_passes) {
  const EndBand band = [&](const Eigen::Vector3d& plane_mm, double below_mm, double above_mm) {
    std::vector<BandSample> taken;
    for (const EndSample& sample : samples) {
      const double cosine = std::cos(sample.around_rad), sine = std::sin(sample.around_rad);
      const double off_mm =
          sample.beyond_mm - plane_mm[0] - plane_mm[1] * cosine - plane_mm[2] * sine;
      if (off_mm > -below_mm && off_mm < above_mm) {
        taken.push_back({cosine, sine, sample.beyond_mm});
      }
    }
    return taken;
  };
  const auto every = [&](std::size_t stride) {
    std::vector<EndSample> taken;
    for (std::size_t i = 0; i < samples.size(); i += stride) taken.push_back(samples[i]);
    return taken;
  };
  if (samples.empty()) return std::nullopt;
  const auto hidden = [](const Eigen::Vector3d&) { return EndSectors{}; };
  EndDice dice;
  return EndFit({samples.size(), knows_passes, every, band, hidden}, pipe_radius_mm, window_mm,
                sigma_mm, dice)
      .Fit();
}

EndCuts FindEndCuts(double sigma_mm, std::span<const PointBlock> blocks, TubeEnds& ends) {
  EndCuts cuts;
  const hal::Tube found = ends.tube;
  EndDice dice;
  for (const bool at_start : {true, false}) {
    if (!(at_start ? ends.first_seen : ends.last_seen)) continue;
    const auto end =
        EndSearch(found, at_start, sigma_mm, blocks, dice).Find(at_start ? ends.first : ends.last);
    if (!end) continue;
    const EndPlane& plane = end->cut.plane;
    (at_start ? cuts.first : cuts.last) = end->cut.cut;
    double& sigma_of_end_mm = at_start ? ends.first_sigma_mm : ends.last_sigma_mm;
    if (!end->IsSurerThan(sigma_of_end_mm)) {
      // Where noise has moved them are the outermost samples of a cloud, by which it was found.
      if (!end->knows_passes) sigma_of_end_mm = std::hypot(sigma_of_end_mm, sigma_mm);
      continue;
    }
    sigma_of_end_mm = plane.at_sigma_mm;
    auto& rows = ends.tube.program.rows;
    double& length_mm = at_start ? rows.front().length_mm : rows.back().length_mm;
    length_mm = std::max(0.0, length_mm + plane.at_mm);
    if (at_start) {
      ends.tube.X_WT.position_mm -=
          plane.at_mm * (ends.tube.X_WT.orientation * Eigen::Vector3d::UnitX());
    }
  }
  return cuts;
}

}  // namespace bendloop::pipeline
