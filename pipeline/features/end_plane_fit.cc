// SPDX-License-Identifier: Apache-2.0
#include "pipeline/features/end_plane_fit.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "hal/angles.h"
#include "pipeline/features/end_curve.h"
#include "pipeline/features/end_evidence.h"
#include "pipeline/features/end_plane_walk.h"
#include "pipeline/features/end_ragged.h"
#include "pipeline/features/end_shadow.h"
#include "pipeline/features/sampling.h"

namespace bendloop::pipeline {
namespace {

struct EndFitSettings {
  // The same of ends that are to be square.
  double square_slope = 0.01;
  // Odds before the scan that an end is not square; and the logarithm of odds that leave no doubt.
  double oblique_odds = 0.1, sure_odds = 6.0;
  // Of the lines near a plane: so many contradict it where rays are lost. More may be of a border
  // that is none, or it is as unsure as they are off.
  double few_wrong = 0.03;
  // Samples of an end: so many tell where about the plane is, and then all that lie beside it are
  // asked (end_border.h); laser lines should have theirs whole.
  std::size_t enough_samples = 9'000, enough_of_lines = 40'000;
  // [of their smear] Samples that lie so far beyond a plane, and those of how much of the turn.
  double beyond = 4.0, beside = 0.25;
  // The logarithm of how much likelier a shadow on one side is to be, that it is one; where it is
  // less likely by as much, of each column, it may be. Part of the turn that a cut is told by, and
  // that is about all.
  double shadow = 10.0, perhaps = 0.3, least_seen = 0.2, all_seen = 0.75;
  // The same of a border that no plane is, of each column. By trial: of shadows -0.5 and more, of
  // waves that were cut -1 and less.
  double shadow_of_curve = 0.2, perhaps_of_curve = 0.8;
  // [of r_P] A border that is no further from the plane of a shadow may as well be ragged.
  double deep_shadow = 0.5;
  // [of their 1 sigma, together] Planes that are nearer to each other are one.
  double apart = 3.0;
  // Of scattered samples' columns: so many look like lines by chance.
  double by_chance = 0.2;
  // Of the noise across the wall: how unsure it makes, along the tube, where columns of a cloud
  // stop. By trial.
  double along_of_cloud = 0.5;
  // [of the mean gap] A border that rises by less across a column is level in it.
  double level = 0.25;
};
constexpr EndFitSettings kFit;

// How far along the tube samples reach.
double DepthMm(std::span<const EndSample> samples) {
  if (samples.empty()) return 0.0;
  const auto [low, high] = std::minmax_element(
      samples.begin(), samples.end(),
      [](const EndSample& a, const EndSample& b) { return a.beyond_mm < b.beyond_mm; });
  return high->beyond_mm - low->beyond_mm;
}

// The plane of an end, or a border that none is where lines and columns say so.
class EndFit {
 public:
  EndFit(SamplesAboutEnd all, double pipe_radius_mm, double window_mm, double sigma_mm,
         EndDice& dice)
      : all_(std::move(all)),
        r_mm_(pipe_radius_mm),
        window_mm_(window_mm),
        sigma_mm_(sigma_mm),
        smear_mm_(kSampling.SmearMm(sigma_mm, pipe_radius_mm)),
        dice_(dice) {}

  std::optional<EndPlanes> Fit() {
    // Where nobody knows passes, columns say at less cost whether there are lines at all.
    Eigen::Vector2d slope_mm = Eigen::Vector2d::Zero();
    std::optional<EndEvidence> columns;
    if (!all_.knows_passes) columns = LookAtColumns(slope_mm);
    if (!columns || MayBeLines(*columns)) {
      if (auto plane = OfLines()) {
        return EndPlanes{all_.knows_passes ? *plane : UnlessScattered(*plane), std::nullopt};
      }
    }
    if (all_.knows_passes) columns = LookAtColumns(slope_mm);
    if (!columns) return std::nullopt;
    const EndPlane plane = OfColumns(*columns, slope_mm);
    is_scattered_ = !columns->share_lines && columns->columns_of_line <= 1.0 && !AreLines(*columns);
    const bool agrees = MisfitOf(plane, *columns, slope_mm, r_mm_).is_none;
    const auto border = agrees ? std::nullopt : Bordered(plane, *columns, slope_mm);
    if (border) {
      const bool is_deep =
          DeepestMm(*border, border->Numbers(r_mm_)) > 0.5 * kFit.deep_shadow * r_mm_;
      return EndPlanes{UnlessInShadow(*border), is_deep ? std::nullopt : Ragged(plane, agrees)};
    }
    EndPlane certain = Certain(plane);
    certain.of_columns = agrees;
    EndPlanes planes{certain, Ragged(plane, agrees)};
    if (!agrees || certain.MayBeOblique()) planes.plane = UnlessInShadow(certain);
    // Lines of a hand that tilts them look like scattered samples: these end there as little.
    if (unlike_lines_ && !planes.plane.in_shadow) {
      planes.plane.at_sigma_mm = std::hypot(planes.plane.at_sigma_mm, unlike_lines_->at_sigma_mm,
                                            planes.plane.at_mm - unlike_lines_->at_mm);
    }
    return planes;
  }

 private:
  static bool MayBeLines(const EndEvidence& columns) {
    const double with_lines = 0.5 * static_cast<double>(columns.sides.size());
    return with_lines > kFit.by_chance * (with_lines + static_cast<double>(columns.columns.size()));
  }

  static bool AreLines(const EndEvidence& columns) {
    return columns.sides.size() > columns.columns.size();
  }

  std::size_t OfLinesStride() const { return StrideTo(all_.count, kFit.enough_of_lines); }
  std::optional<EndEvidence> LookAtColumns(Eigen::Vector2d& slope_mm) {
    const std::size_t stride = OfLinesStride();
    const std::size_t left = (all_.count + stride - 1) / stride;
    of_columns_ = all_.every(stride * StrideTo(left, kFit.enough_samples));
    depth_mm_ = DepthMm(of_columns_);
    return LookAtEndColumns(of_columns_, r_mm_, window_mm_, smear_mm_, slope_mm);
  }

  std::optional<EndPlane> OfLines() {
    const auto lines = LookAtEndLines(all_.every(OfLinesStride()), r_mm_, window_mm_, smear_mm_,
                                      sigma_mm_, all_.knows_passes);
    if (!lines) return std::nullopt;
    const auto plane_among = [&](double usual_slope) {
      return PlaneAmong(*lines, Eigen::Vector2d::Zero(), r_mm_, dice_.plane, {}, usual_slope);
    };
    EndPlane plane = plane_among(kEndPlane.usual_slope);
    plane.of_lines = true;
    const PlaneMisfit misfit = MisfitOf(plane, *lines, Eigen::Vector2d::Zero(), r_mm_);
    const bool is_doubtful = all_.knows_passes && misfit.part > kFit.few_wrong;
    if (is_doubtful || !misfit.is_none) {
      if (const auto border = Bordered(plane, *lines, Eigen::Vector2d::Zero())) return border;
      if (!misfit.is_none) {
        unlike_lines_ = plane;
        unlike_lines_->at_sigma_mm = std::hypot(plane.at_sigma_mm, misfit.rms_mm);
        return std::nullopt;
      }
    }
    const double log_odds = LogOddsOfOblique(plane);
    if (all_.knows_passes && log_odds < kFit.sure_odds) {
      const EndPlane square = plane_among(kFit.square_slope);
      PlaceOfEither({square.at_mm, std::pow(square.at_sigma_mm, 2)}, log_odds, plane);
    }
    if (is_doubtful) {
      plane.at_sigma_mm = std::hypot(plane.at_sigma_mm, misfit.rms_mm);
      plane.slope_sigmas *=
          plane.slope_sigma / std::hypot(plane.slope_sigma, misfit.rms_mm / r_mm_);
      plane.slope_sigma = std::hypot(plane.slope_sigma, misfit.rms_mm / r_mm_);
    }
    return plane;
  }

  // `columns`: is told how many of them say the same where samples are not scattered.
  EndPlane OfColumns(EndEvidence& columns, const Eigen::Vector2d& slope_mm) {
    // Where laser lines are seen the columns have said all; a few samples look like some by chance.
    EndPlane plane;
    const bool are_lines = AreLines(columns);
    if (!are_lines) {
      RoughEnd rough = Rough();
      std::optional<EndBorder> border;
      const auto better = [&](const Posterior& about) {
        rough.plane = about;
        if (!rough.knows_rays) rough.hidden = SectorsInShadow(columns, slope_mm, about.mean);
        border = FitEndBorder(rough, all_.band, dice_.border);
        return border ? std::optional(border->plane) : std::nullopt;
      };
      plane = PlaneAmong(columns, slope_mm, r_mm_, dice_.plane, better);
      plane.of_border = border.has_value();
      if (border) PlaceOfSquare(border->square, plane);
      if (border) return plane;
    }
    const double columns_of_line = columns.columns_of_line;
    const auto lines = EndColumnsAbout(of_columns_, window_mm_, smear_mm_, slope_mm, true);
    if (lines) columns = *lines;
    // Columns that share nothing say what they said.
    if (are_lines || columns.columns_of_line != columns_of_line) {
      plane = PlaneAmong(columns, slope_mm, r_mm_, dice_.plane);
    }
    // Of a cloud nobody knows how far noise moves samples along the tube.
    if (!all_.knows_passes) {
      plane.at_sigma_mm = std::hypot(plane.at_sigma_mm, kFit.along_of_cloud * sigma_mm_);
    }
    return plane;
  }

  // By all samples about a rough plane; none: they are not scattered, or too few.
  std::optional<EndPlane> OfBorder(const RoughEnd& rough) const {
    const auto border = FitEndBorder(rough, all_.band, dice_.border);
    if (!border) return std::nullopt;
    EndPlane plane = PlaneOf(border->plane, Eigen::Vector2d::Zero(), r_mm_);
    plane.of_border = true;
    PlaceOfSquare(border->square, plane);
    return plane;
  }

  // The samples of a cloud look like lines by chance now and then.
  EndPlane UnlessScattered(const EndPlane& of_lines) const {
    RoughEnd rough = Rough();
    const double at_mm = std::hypot(of_lines.at_sigma_mm, rough.smear_mm);
    const double slope_mm = std::hypot(r_mm_ * of_lines.slope_sigma, rough.smear_mm);
    rough.plane = {of_lines.Numbers(r_mm_), Eigen::Matrix3d::Zero(), 0.0};
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
    rough.slope_mm = kEndPlane.usual_slope * r_mm_;
    rough.square_mm = kFit.square_slope * r_mm_;
    rough.is_thinned = all_.count > kFit.enough_samples;
    return rough;
  }

  // What is not oblique for all that is seen was cut about square: few samples tell the place of
  // such a plane better than that of any. Where it may be either its place is both planes', by
  // their odds. `square`: what is known of its place then.
  static void PlaceOfEither(const EndPlace& square, double log_odds, EndPlane& plane) {
    if (log_odds > kFit.sure_odds) return;
    const EndPlace place =
        OfEither(square, {plane.at_mm, std::pow(plane.at_sigma_mm, 2)}, log_odds);
    plane.at_mm = place.at_mm;
    plane.at_sigma_mm = std::sqrt(place.variance_mm2);
  }
  // The odds: the prior's, by Laplace's volume of two slopes, by what speaks for them.
  static void PlaceOfSquare(const Posterior& square, EndPlane& plane) {
    const double volume = std::pow(plane.slope_sigma / kEndPlane.usual_slope, 2);
    const double log_odds =
        std::log(kFit.oblique_odds * volume) + 0.5 * std::pow(plane.slope_sigmas, 2);
    PlaceOfEither({square.mean[0], square.covariance(0, 0)}, log_odds, plane);
  }

  // Columns of few samples each may stop by chance as those of an oblique cut would: where the
  // plane leaves more of the wall beyond itself than fliers are, that is all. Else what speaks for
  // its obliquity are the samples that a square cut as far out would have beyond it, and are not
  // there: so many are missing by chance as seldom as a normal distribution leads so far.
  EndPlane Certain(EndPlane plane) const {
    if (!plane.MayBeOblique()) return plane;
    const Eigen::Vector3d at = plane.Numbers(r_mm_);
    const std::vector<EndSample> samples = all_.every(StrideTo(all_.count, kFit.enough_samples));
    double beyond = 0, beyond_mm = 0, outermost_mm = at[0];
    EndSectors goes_on{};
    for (const EndSample& sample : samples) {
      const double off_mm = sample.beyond_mm - at[0] - at.tail<2>().dot(sample.Direction());
      const bool is_beyond = off_mm > kFit.beyond * smear_mm_;
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
    if (!MayBeFliers(beyond, samples.size()) &&
        static_cast<double>(sectors) > kFit.beside * static_cast<double>(kEndSectors)) {
      plane.at_sigma_mm = std::hypot(plane.at_sigma_mm, beyond_mm / beyond);
      plane.slope_sigma = std::max(plane.slope_sigma, plane.Slope());
      plane.slope_sigmas = 0;
      return plane;
    }
    const double per_mm = static_cast<double>(all_.count) / std::max(depth_mm_, r_mm_);
    const double missing = per_mm * (outermost_mm - at[0]);
    const double certain = std::max(1.0, std::sqrt(2.0 * missing));
    if (certain < std::min(plane.slope_sigmas, kEndPlane.oblique)) {
      plane.slope_sigma *= plane.slope_sigmas / certain;
      plane.slope_sigmas = certain;
    }
    return plane;
  }

  // The plane, or border, where samples stop; or where the sides end that are in no shadow. Where
  // either may be, it is as unsure as both are apart.
  EndPlane UnlessInShadow(const EndPlane& plane) const {
    const std::vector<EndSample> samples = all_.every(StrideTo(all_.count, kFit.enough_samples));
    const EndInDoubt doubt{r_mm_,        window_mm_,        smear_mm_, plane.Numbers(r_mm_),
                           plane.border, plane.border_terms};
    const auto shadowed = FindEndInShadow(samples, doubt, dice_.plane);
    if (!shadowed || shadowed->seen < kFit.least_seen) return plane;
    // A series follows the edge of a shadow, too.
    const bool is_curve = !plane.border.empty();
    const double sure = is_curve ? -kFit.shadow_of_curve * shadowed->columns : kFit.shadow;
    const double perhaps = -(is_curve ? kFit.perhaps_of_curve : kFit.perhaps) * shadowed->columns;
    if (shadowed->likelier < perhaps) return plane;
    const double apart_mm = std::abs(shadowed->plane.mean[0] - plane.at_mm);
    if (apart_mm < kFit.apart * (shadowed->plane.Sigma(0) + plane.at_sigma_mm)) return plane;
    if (is_scattered_) {
      RaggedAbout about = AboutRagged(plane);
      about.plane_mm = shadowed->plane.mean;
      if (MissesSamplesAllRound(all_.every(OfLinesStride()), about, r_mm_)) return plane;
    }
    const bool is_deep =
        !is_curve || DeepestMm(plane, shadowed->plane.mean) > kFit.deep_shadow * r_mm_;
    if (shadowed->likelier > sure && is_deep) return BesideShadow(*shadowed, samples);
    EndPlane either = plane;
    either.at_sigma_mm = std::hypot(plane.at_sigma_mm, apart_mm);
    either.slope_sigma = std::max(plane.slope_sigma, plane.Slope());
    either.slope_sigmas = 0;
    either.in_shadow = true;
    return either;
  }

  // How far a border lies before a plane, where most.
  double DeepestMm(const EndPlane& border, const Eigen::Vector3d& plane_mm) const {
    double deepest_mm = 0;
    for (const BorderPlace& place : border.border) {
      const double around_rad = place.around_deg * hal::kRadiansPerDegree;
      const Eigen::Vector3d row(1.0, std::cos(around_rad), std::sin(around_rad));
      const double off_mm = row.dot(plane_mm - border.Numbers(r_mm_)) - place.beyond_mm;
      deepest_mm = std::max(deepest_mm, off_mm);
    }
    return deepest_mm;
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
    plane.in_shadow = end.seen < kFit.all_seen;
    // A slope that a part of the turn shows may be another's.
    if (plane.in_shadow && plane.slope_sigmas > kEndPlane.may_be_oblique) {
      plane.slope_sigma *= plane.slope_sigmas / kEndPlane.may_be_oblique;
      plane.slope_sigmas = kEndPlane.may_be_oblique;
    }
    return plane;
  }

  // None: no border explains the samples better than a plane that they contradict.
  std::optional<EndPlane> Bordered(const EndPlane& plane, const EndEvidence& evidence,
                                   const Eigen::Vector2d& slope_mm) const {
    const EndSectors hidden = all_.hidden(plane.Numbers(r_mm_));
    auto curve =
        FitEndCurve(evidence, Eigen::Vector3d(0.0, slope_mm[0], slope_mm[1]), hidden, r_mm_);
    if (!curve) return std::nullopt;
    if (const auto level = LevelColumns(*curve, evidence)) {
      if (const auto better = FitEndCurve(*level, curve->mean, hidden, r_mm_)) curve = better;
    }
    return OfSeries(Eigen::Vector3d::Zero(), *curve, 0.0);
  }

  // Where a border rises across a column its samples stop where it is furthest out, not in its
  // middle. None: it is level enough.
  std::optional<EndEvidence> LevelColumns(const Posterior& curve,
                                          const EndEvidence& evidence) const {
    if (SteepestMm(curve) * evidence.width_rad < kFit.level * evidence.gap_mm) return std::nullopt;
    return EndColumnsAlong(of_columns_, window_mm_, smear_mm_, curve.mean, true);
  }

  RaggedAbout AboutRagged(const EndPlane& plane) const {
    RaggedAbout about;
    about.plane_mm = plane.Numbers(r_mm_);
    about.window_mm = std::min(window_mm_, depth_mm_);
    about.smear_mm = std::max(smear_mm_, sigma_mm_);
    about.hidden = all_.hidden(about.plane_mm);
    return about;
  }

  // None: the plane explains all samples.
  std::optional<EndPlane> Ragged(const EndPlane& plane, bool agrees) const {
    if (!is_scattered_) return std::nullopt;
    const RaggedAbout about = AboutRagged(plane);
    if (agrees && !MissesSamplesBefore(of_columns_, about, r_mm_)) return std::nullopt;
    const auto ragged = FitRaggedBorder(all_.every(OfLinesStride()), about, r_mm_);
    if (!ragged) return std::nullopt;
    const EndPlane found = OfSeries(about.plane_mm, ragged->series, ragged->ragged_mm);
    return ragged->all_round ? found : UnlessInShadow(found);
  }

  // `ragged_mm`: of the border beside its series.
  EndPlane OfSeries(const Eigen::Vector3d& from_mm, Posterior series, double ragged_mm) const {
    series.mean.head<3>() += from_mm;
    EndPlane found = PlaneOf(series, Eigen::Vector2d::Zero(), r_mm_);
    found.border = PlacesOf(series);
    for (BorderPlace& place : found.border) {
      place.sigma_mm = std::hypot(place.sigma_mm, ragged_mm);
    }
    found.border_terms = static_cast<int>(series.mean.size());
    return found;
  }

  SamplesAboutEnd all_;
  double r_mm_, window_mm_, sigma_mm_, smear_mm_;
  std::vector<EndSample> of_columns_;
  bool is_scattered_ = false;
  std::optional<EndPlane> unlike_lines_;  // of lines that it does not explain
  double depth_mm_ = 0;                   // along the tube, of the samples of columns
  EndDice& dice_;
};

}  // namespace

std::optional<EndPlanes> FitEndPlanes(SamplesAboutEnd samples, double pipe_radius_mm,
                                      double window_mm, double sigma_mm, EndDice& dice) {
  return EndFit(std::move(samples), pipe_radius_mm, window_mm, sigma_mm, dice).Fit();
}

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
  const auto planes = FitEndPlanes({samples.size(), knows_passes, every, band, hidden},
                                   pipe_radius_mm, window_mm, sigma_mm, dice);
  if (!planes) return std::nullopt;
  return planes->ragged ? planes->ragged : planes->plane;
}

}  // namespace bendloop::pipeline
