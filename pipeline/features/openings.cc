// SPDX-License-Identifier: Apache-2.0
#include "pipeline/features/openings.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include "hal/angles.h"
#include "pipeline/features/beside_border.h"
#include "pipeline/features/border_clumping.h"
#include "pipeline/features/opening_border.h"
#include "pipeline/features/opening_surroundings.h"
#include "pipeline/features/plane_samples.h"
#include "pipeline/features/sampling.h"
#include "pipeline/features/surface_cells.h"
#include "pipeline/features/unseen_wall.h"
#include "pipeline/math/quantiles.h"

namespace bendloop::pipeline {
namespace {

struct OpeningSettings {
  // [of r_P] From the surface, if that is more than kSampling.on_surface: samples of the wall
  // beside an opening.
  double on_surface_r = 0.05;
  // The place is looked at as far as this around its middle, in its own size, and [of r_P] further.
  double look = 1.3, look_more = 0.5;
  // [of r_P] Of a ball in which all that is looked at there is, across the wall.
  double look_deep = 2.5;
  // Places where the distance to the nearest sample is asked for, across the void.
  int probes = 24;
  // Samples that the wall would have there, as fewer may be missing by chance (e^-16). Of one that
  // is as narrow as gaps more must be, and places like it beside it must have samples.
  double least_missing = 16.0, least_missing_narrow = 25.0;
  // The same where so many rays of lines are known to have gone through: these say so themselves.
  double least_missing_through = 9.0;
  std::ptrdiff_t least_through_rays = 3;
  // [of its width] So far outside of what is roughly its border the face of the cut may be.
  double face = 0.15;
  // Of its area, where passes are known: so much was looked through by all of them.
  double least_through = 0.6;
  // Of these, so many may lie in it: fliers and mixed pixels. And below the wall: what is seen of
  // the face of the cut and of the bore; what fills an opening is seen all over it, and of a wall
  // that was pressed in what is not too deep.
  double most_inside = 0.04, most_below = 0.2;
  // How much larger it may be than the void that the wall leaves.
  double most_larger = 1.8;
  // [sigma] The plane that it is seen in may put it aside by so much.
  double aside = 0.15;
  int moves = 3;  // then it is seen in that of its own middle
  // A border that is so much longer than what was roughly it is looked for from there, so often.
  double grown = 1.15;
  int longer = 3;
  // [of r_P] The widest; a slot is no wider than this where nobody knows who looked, as what no
  // view showed is wide and long. And how much longer than wide it is.
  double widest = 1.7, widest_slot = 0.9, longest = 12.0;
  // [log] How much likelier a cut is than the edge of a shadow, at least, of one that is no wider
  // than gaps beside it; and by how much a shadow may be likelier of others.
  double narrow_odds = 1.3, shadow_odds = 1.5;
  // [log] How much likelier a cut is, at least, than that no view showed the wall; of one that
  // is no wider than gaps beside it; and of one beside which samples become fewer as at the edge of
  // a shadow, as they also do where another view ends beside a hole.
  double cut_odds = 11.0, cut_odds_narrow = 16.0, cut_odds_in_shadow = 200.0;
  // Of what is roughly the border of such a one, so much must be empty.
  double core = 0.6;
};
constexpr OpeningSettings kOpening;

// The void about the middle: how wide it is, where, and how long.
std::optional<OpeningBorder> RoughBorder(const PlaneSamples& present, double size_mm, double r_mm) {
  const double step_mm = 2.0 * size_mm / kOpening.probes;
  std::vector<Eigen::Vector2d> places;
  std::vector<double> free_mm;
  double widest_mm = 0;
  for (int i = 0; i <= kOpening.probes; ++i) {
    for (int k = 0; k <= kOpening.probes; ++k) {
      const Eigen::Vector2d place(step_mm * i - size_mm, step_mm * k - size_mm);
      if (place.norm() > size_mm || std::abs(place.y()) > kLimb * r_mm) continue;
      places.push_back(place);
      free_mm.push_back(present.NearestMm(place));
      widest_mm = std::max(widest_mm, free_mm.back());
    }
  }
  // The line about which it is cut is where it is nearly as wide as anywhere.
  Eigen::Vector2d middle = Eigen::Vector2d::Zero();
  double count = 0;
  for (std::size_t i = 0; i < places.size(); ++i) {
    if (free_mm[i] < 0.8 * widest_mm) continue;
    middle += places[i];
    count += 1;
  }
  if (count == 0) return std::nullopt;
  middle /= count;
  Eigen::Matrix2d spread = Eigen::Matrix2d::Zero();
  for (std::size_t i = 0; i < places.size(); ++i) {
    if (free_mm[i] < 0.8 * widest_mm) continue;
    spread += (places[i] - middle) * (places[i] - middle).transpose() / count;
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> eigen(spread);
  const Eigen::Vector2d axis = eigen.eigenvectors().col(1);
  OpeningBorder border;
  border.middle_mm = middle;
  border.width_mm = 2.0 * widest_mm;
  const double excess = std::max(0.0, eigen.eigenvalues()[1] - eigen.eigenvalues()[0]);
  border.length_mm = border.width_mm + std::sqrt(12.0 * excess);
  border.axis_rad = std::atan2(axis.y(), axis.x());
  return border;
}

// How an opening is looked at: so far around it, where samples beside it lie so far apart; and how
// much the void takes that the wall leaves there.
struct Look {
  double reach_mm, gap_mm, void_mm2;
};

double LeastMissing(const OpeningBorder& border, const Look& look) {
  return IsNarrow(border, look.gap_mm) ? kOpening.least_missing_narrow : kOpening.least_missing;
}

// Where rays that went through are known.
double LeastMissing(const OpeningBorder& border, const Look& look, const PassSurroundings& passes) {
  if (!passes.are_known || !passes.has_lines) return LeastMissing(border, look);
  const auto through = std::count_if(
      passes.missed.begin(), passes.missed.end(),
      [&](const MissedPlace& missed) { return border.DistanceMm(missed.place_mm) < 0; });
  return through >= kOpening.least_through_rays ? kOpening.least_missing_through
                                                : LeastMissing(border, look);
}

// How many of these lie in a border, and further in than this.
double CountInside(const OpeningBorder& border, std::span<const Eigen::Vector2d> places,
                   double deeper_mm) {
  return static_cast<double>(std::count_if(
      places.begin(), places.end(),
      [&](const Eigen::Vector2d& place) { return border.DistanceMm(place) < -deeper_mm; }));
}

// Whether what is roughly one, no wider than gaps beside it, may be one: nothing is in it, and
// places like it beside it are not empty.
bool MayBeNarrow(const OpeningBorder& rough, const Surroundings& around, const Look& look,
                 double r_mm) {
  const double core_mm = 0.5 * (1.0 - kOpening.core) * rough.width_mm;
  return CountInside(rough, around.present, core_mm) <= 1 &&
         !IsLikeItsSurroundings(rough, around.present, look.reach_mm, r_mm);
}

// Where nobody knows who looked: how much likelier a cut must be than wall that no view showed
// [log]; none: samples beside it do not end as at a cut.
std::optional<double> LeastOddsOfCut(const OpeningBorder& border, const Surroundings& around,
                                     const Look& look, double r_mm) {
  if (!border.is_hole() && border.width_mm > kOpening.widest_slot * r_mm) return std::nullopt;
  const double shadow = LogOddsOfShadow(border, around.wall, look.gap_mm, r_mm);
  if (!IsNarrow(border, look.gap_mm)) {
    return shadow < kOpening.shadow_odds ? kOpening.cut_odds : kOpening.cut_odds_in_shadow;
  }
  if (shadow < -kOpening.narrow_odds) return kOpening.cut_odds_narrow;
  return std::nullopt;
}

// Whether an opening with this border leaves these samples: none in it, and some on all its sides
// but an eighth of them, no further from it than they are from each other.
bool IsCut(const OpeningBorder& border, const Surroundings& around, const PassSurroundings& passes,
           const Look& look) {
  if (passes.are_known && passes.PartThrough(border) < kOpening.least_through) return false;
  const bool are_scattered = passes.are_known && !passes.has_lines;
  const double missing =
      DensityBeside(border, are_scattered ? passes.scattered : around.wall).per_mm2 *
      border.AreaMm2();
  const double clear_mm = 0.1 * border.width_mm;
  if (!(missing >= LeastMissing(border, look, passes))) return false;
  if (CountInside(border, around.present, clear_mm) >
          std::max(1.0, kOpening.most_inside * missing) ||
      CountInside(border, around.below, clear_mm) > std::max(1.0, kOpening.most_below * missing)) {
    return false;
  }
  // Where rays are known to have passed, sides need be no shorter than lines lie apart.
  const BorderSides sides = SidesOf(border, around.all, clear_mm, 2.0 * look.gap_mm + clear_mm,
                                    passes.are_known ? 2.0 * look.gap_mm : 0.0);
  return sides.AreAllButByChance();
}

// What a place that cells show turned out to be.
struct LookedAtPlace {
  OpeningFound opening;
  bool may_be_unseen = false;  // nobody knows whether it is one
};

// One place where cells of the surface are empty, looked at closely.
class Candidate {
 public:
  // `segments`: of sharp bends, by which places are counted.
  Candidate(const LookedAtTube& tube, std::span<const hal::SpineSegment> segments, double sigma_mm)
      : tube_(tube),
        r_mm_(tube.pipe_radius_mm),
        segments_(segments),
        sigma_mm_(sigma_mm),
        wall_mm_(std::max(kSampling.on_surface * sigma_mm, kOpening.on_surface_r * r_mm_)) {}

  // `frame`: of the place.
  std::optional<LookedAtPlace> LookAt(const EmptyPlace& place, hal::SurfaceFrame frame) const {
    const double size_mm = 0.5 * place.size_mm;
    const double reach_mm = kOpening.look * 2.0 * size_mm + kOpening.look_more * r_mm_;
    for (int round = 0; round < 2; ++round) {
      const Surroundings around = tube_.LookAt(frame, reach_mm, wall_mm_);
      if (around.wall.size() < 20) return std::nullopt;
      const PlaneSamples present(around.present);
      const auto rough = RoughBorder(present, size_mm, r_mm_);
      if (!rough || rough->width_mm > kOpening.widest * r_mm_) return std::nullopt;
      // About its own middle, across whose normal it is round.
      if (round == 0) {
        frame = FrameOf(frame, rough->middle_mm);
        continue;
      }
      if (rough->length_mm > kOpening.longest * rough->width_mm) return std::nullopt;
      const Look look{reach_mm, GapBeside(*rough, present, r_mm_), rough->AreaMm2()};
      const SampleDensity density = DensityBeside(*rough, around.wall);
      if (density.per_mm2 * rough->AreaMm2() < LeastMissing(*rough, look)) return std::nullopt;
      if (IsNarrow(*rough, look.gap_mm) && !MayBeNarrow(*rough, around, look, r_mm_))
        return std::nullopt;
      OpeningBorder about = *rough;
      // What a lean leaves of a wall is known of a round one: in a bend none is told.
      about.pipe_radius_mm = r_mm_;
      about.is_bent = IsInBend(frame, *rough);
      return Fit(frame, about, around, look, kOpening.moves);
    }
    return std::nullopt;
  }

 private:
  // `around`: with faces. `moves`: so often at most the place is moved to the middle that is found.
  std::optional<LookedAtPlace> Fit(const hal::SurfaceFrame& frame, OpeningBorder about,
                                   const Surroundings& around, const Look& look, int moves) const {
    PassSurroundings passes;
    Surroundings wall;
    FittedOpening fitted;
    for (int longer = 0;; ++longer) {
      wall = WithoutFace(around, about, look);
      passes = tube_.FindPasses(frame, wall, about);
      if (passes.has_lines && passes.fair.empty()) return std::nullopt;
      fitted = FitOpening(passes.has_lines ? passes.fair : wall.wall, about,
                          kSampling.SmearMm(sigma_mm_, r_mm_), passes.missed, passes.scattered);
      // Of a void that a few samples part a piece was seen: it goes on.
      if (fitted.border.length_mm < kOpening.grown * about.length_mm) break;
      if (longer == kOpening.longer) return std::nullopt;
      about = fitted.border;
    }
    const OpeningBorder& border = fitted.border;
    if (border.AreaMm2() > kOpening.most_larger * look.void_mm2) return std::nullopt;
    if (!IsCut(border, wall, passes, look)) return std::nullopt;
    const std::optional<double> least_odds =
        passes.are_known ? 0.0 : LeastOddsOfCut(border, wall, look, r_mm_);
    if (!least_odds) return std::nullopt;
    // Its drill goes across the wall at its own middle: from beside, its border lies further aside
    // where the wall is lower.
    const double low_mm = border.length_mm * border.length_mm / (8.0 * r_mm_);
    const double aside_mm = low_mm * border.middle_mm.norm() / r_mm_;
    if (moves > 0 && border.lean.isZero() &&
        aside_mm > kOpening.aside * fitted.sigma.middle_mm.minCoeff()) {
      const hal::SurfaceFrame own = FrameOf(frame, border.middle_mm);
      OpeningBorder moved = border;
      moved.middle_mm.setZero();
      const Surroundings there = tube_.LookAt(own, look.reach_mm, wall_mm_);
      if (auto found = Fit(own, moved, there, look, moves - 1)) return found;
      // From there it may be lost beside a dent: then it stays as it is seen from here, but for
      // what is a gap or a shadow from there.
      const PassSurroundings from_there =
          tube_.FindPasses(own, WithoutFace(there, moved, look), moved);
      if (from_there.are_known && from_there.PartThrough(moved) < kOpening.least_through)
        return std::nullopt;
    }
    const Clumping wider = ClumpingBeside(border, passes.scattered);
    // Asked last, as it takes longest.
    const bool may_be_unseen = !passes.are_known && LogOddsOfCut(tube_, frame, border, wall.wall,
                                                                 look.reach_mm) < *least_odds;
    return LookedAtPlace{Found(frame, fitted, wider), may_be_unseen};
  }

  static Surroundings WithoutFace(const Surroundings& around, const OpeningBorder& border,
                                  const Look& look) {
    return around.WithoutFace(border, kOpening.face * border.width_mm + 2.0 * look.gap_mm);
  }

  // Whether any of its border is on a bend.
  bool IsInBend(const hal::SurfaceFrame& frame, const OpeningBorder& border) const {
    const double half_mm = 0.5 * border.length_mm;
    return std::any_of(segments_.begin(), segments_.end(), [&](const hal::SpineSegment& segment) {
      if (!segment.is_arc()) return false;
      const double along_mm = PlaceOf(frame, border.middle_mm).first - segment.from_start_mm;
      return along_mm > -half_mm && along_mm < segment.length_mm + half_mm;
    });
  }
  // The frame of a place in the plane of another.
  hal::SurfaceFrame FrameOf(const hal::SurfaceFrame& frame, const Eigen::Vector2d& place_mm) const {
    const auto [along_mm, around_deg] = PlaceOf(frame, place_mm);
    return hal::FrameAt(segments_, along_mm, around_deg);
  }
  std::pair<double, double> PlaceOf(const hal::SurfaceFrame& frame,
                                    const Eigen::Vector2d& place_mm) const {
    const double height_mm = std::sqrt(std::max(0.0, r_mm_ * r_mm_ - place_mm.y() * place_mm.y()));
    const Eigen::Vector3d point = frame.spine_mm + place_mm.x() * frame.tangent +
                                  place_mm.y() * frame.sideways() + height_mm * frame.outward;
    double nearest_mm = 1e300, along_mm = 0;
    for (const hal::SpineSegment& segment : segments_) {
      double on_mm = (point - segment.start_mm).dot(segment.tangent);
      if (segment.is_arc()) {
        const Eigen::Vector3d from = point - segment.center_mm();
        on_mm =
            segment.bend_radius_mm *
            std::atan2(from.dot(segment.tangent), -from.dot(segment.normal.cross(segment.tangent)));
      }
      on_mm = std::clamp(on_mm, 0.0, segment.length_mm);
      const double away_mm = (point - segment.PointAt(on_mm)).norm();
      if (away_mm < nearest_mm) nearest_mm = away_mm, along_mm = segment.from_start_mm + on_mm;
    }
    const hal::SurfaceFrame there = hal::FrameAt(segments_, along_mm, 0.0);
    return {along_mm, hal::AroundDeg(there.outward, there.tangent, point - there.spine_mm)};
  }

  // `wider`: than `fitted` its sigmas are.
  OpeningFound Found(const hal::SurfaceFrame& frame, const FittedOpening& fitted,
                     const Clumping& wider) const {
    const OpeningBorder& border = fitted.border;
    const auto [along_mm, around_deg] = PlaceOf(frame, border.middle_mm);
    const hal::SurfaceFrame own = hal::FrameAt(segments_, along_mm, around_deg);
    OpeningFound found;
    const double axis_deg = std::remainder(border.axis_rad * hal::kDegreesPerRadian, 180.0);
    found.opening = {along_mm, around_deg, border.length_mm, border.width_mm,
                     border.is_hole() ? 0.0 : axis_deg};
    const double cosine = std::cos(border.axis_rad), sine = std::sin(border.axis_rad);
    const double of_along = std::hypot(wider.along * cosine, wider.across * sine);
    const double of_around = std::hypot(wider.along * sine, wider.across * cosine);
    const double degrees = of_around * hal::kDegreesPerRadian;
    found.sigma = {of_along * fitted.sigma.middle_mm.x(),
                   degrees * fitted.sigma.middle_mm.y() / r_mm_,
                   wider.along * fitted.sigma.length_mm, wider.across * fitted.sigma.width_mm,
                   wider.across * hal::kDegreesPerRadian * fitted.sigma.axis_rad};
    if (!border.lean.isZero()) {
      // About its own normal, which is as far around as its middle is.
      const Eigen::Vector3d drill =
          frame.outward + border.lean.x() * frame.tangent + border.lean.y() * frame.sideways();
      const double out = drill.dot(own.outward);
      found.opening.lean_along_deg =
          std::atan2(drill.dot(own.tangent), out) * hal::kDegreesPerRadian;
      found.opening.lean_around_deg =
          std::atan2(-drill.dot(own.sideways()), out) * hal::kDegreesPerRadian;
    }
    found.sigma.lean_along_deg =
        degrees * fitted.sigma.lean.x() / (1.0 + std::pow(border.lean.x(), 2));
    found.sigma.lean_around_deg =
        degrees * fitted.sigma.lean.y() / (1.0 + std::pow(border.lean.y(), 2));
    found.position_mm = own.spine_mm + r_mm_ * own.outward;
    const double axis = found.opening.axis_deg * hal::kRadiansPerDegree;
    found.direction = std::cos(axis) * own.tangent + std::sin(axis) * own.sideways();
    return found;
  }

  const LookedAtTube& tube_;
  double r_mm_;
  std::span<const hal::SpineSegment> segments_;
  double sigma_mm_;
  double wall_mm_;  // from the surface: samples of the wall
};

}  // namespace

std::vector<Ball> BallsAbout(const hal::Tube& tube, std::span<const EmptyPlace> places) {
  const auto segments = hal::SpineSegments(tube.program, tube.X_WT);
  const double r_mm = tube.pipe_radius_mm;
  std::vector<Ball> balls;
  for (const EmptyPlace& place : places) {
    const hal::SurfaceFrame frame = hal::FrameAt(segments, place.along_mm, place.around_deg);
    // Its middle is found within it, and looked at as far around, from the wall to beyond it.
    const double reach_mm = (1.0 + kOpening.look) * place.size_mm + kOpening.look_more * r_mm;
    balls.push_back(
        {frame.spine_mm + r_mm * frame.outward, std::hypot(reach_mm, kOpening.look_deep * r_mm)});
  }
  return balls;
}

std::vector<OpeningFound> FindOpenings(const hal::Tube& tube, const WallSpine& wall,
                                       const TubeEnds& ends, double sigma_mm,
                                       std::span<const PointBlock> blocks,
                                       std::span<const EmptyPlace> places) {
  const auto segments = hal::SpineSegments(tube.program, tube.X_WT);
  std::vector<OpeningFound> openings, may_be_unseen;
  if (places.empty()) return openings;
  const std::vector<SegmentFrame> frames = SegmentFrames(wall.spine, 0.0, {});
  const LookedAtTube looked_at{tube.pipe_radius_mm, sigma_mm, wall.spine.segments, frames, blocks};
  const Candidate candidate(looked_at, segments, sigma_mm);
  // The same one is seen at several sizes of cells.
  const auto is_known = [&](const Eigen::Vector3d& position_mm) {
    const auto is_there = [&](const OpeningFound& other) {
      return (other.position_mm - position_mm).norm() < 0.5 * other.opening.length_mm;
    };
    return std::any_of(openings.begin(), openings.end(), is_there) ||
           std::any_of(may_be_unseen.begin(), may_be_unseen.end(), is_there);
  };
  for (const EmptyPlace& place : places) {
    const hal::SurfaceFrame frame = hal::FrameAt(segments, place.along_mm, place.around_deg);
    if (is_known(frame.spine_mm + tube.pipe_radius_mm * frame.outward)) continue;
    const auto looked = candidate.LookAt(place, frame);
    if (!looked || is_known(looked->opening.position_mm)) continue;
    if (looked->may_be_unseen) {
      may_be_unseen.push_back(looked->opening);
      continue;
    }
    OpeningFound found = looked->opening;
    const bool from_end = 2.0 * found.opening.along_mm > hal::SpineLength(tube.program);
    found.sigma.along_mm =
        std::hypot(found.sigma.along_mm, from_end ? ends.last_sigma_mm : ends.first_sigma_mm);
    openings.push_back(found);
  }
  const PlacesOnWall places_on_wall(wall);
  for (OpeningFound& found : openings) {
    const hal::SurfaceFrame zero = hal::FrameAt(segments, found.opening.along_mm, 0.0);
    found.opening.around_deg = hal::AroundDeg(
        zero.outward, zero.tangent, places_on_wall.FrameTo(found.position_mm).first.outward);
  }
  std::sort(openings.begin(), openings.end(), [](const OpeningFound& a, const OpeningFound& b) {
    return a.opening.along_mm < b.opening.along_mm;
  });
  return openings;
}

}  // namespace bendloop::pipeline
