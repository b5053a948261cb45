// SPDX-License-Identifier: Apache-2.0
#include "pipeline/features/beside_border.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <utility>
#include <vector>

#include "pipeline/math/quantiles.h"

namespace bendloop::pipeline {
namespace {

struct BesideSettings {
  double most_gap_probes = 400;
  double narrow = 2.2;  // how often as wide as the widest gap
  // Sides are as many as have so many samples each, at most and at least so many.
  double of_side = 5.0;
  int most_sides = 24, least_sides = 8;
  // Bands beside a border whose densities are compared: how wide [of its width] the nearer one is
  // at least, and how many times as wide the further one. Each is read in so many sectors, by
  // so many places all around and one behind the other over the nearer band.
  double band = 0.12, further = 1.5, around = 128, of_band = 4;
  int sectors = 8;
  // What is left of the density beside the edge of what nobody saw.
  double left = 0.7;
  // Places like an opening beside it: as wide as this part of it, so many at least. They are looked
  // for at so many, and where a long opening leaves little room beside it four times as many again
  // and again, up to so many, as long as there are no more than this. Of them so many may have no
  // more than this part of what the middle one of them has.
  double like = 0.5;
  std::size_t least_likes = 10, enough_likes = 20;
  double likes = 200, most_likes = 12'800;
  double most_empty = 0.05, is_empty = 0.1;
};
constexpr BesideSettings kBeside;

// Places spread evenly over a disc about the middle of a border (Vogel's spiral).
template <class Take>
void SpreadOver(const OpeningBorder& border, double reach_mm, double count, Take take) {
  for (double i = 0.5; i < count; i += 1.0) {
    const double radius = reach_mm * std::sqrt(i / count);
    const double turn = i * std::numbers::pi * (3.0 - std::sqrt(5.0));
    take(Eigen::Vector2d(border.middle_mm +
                         radius * Eigen::Vector2d(std::cos(turn), std::sin(turn))));
  }
}

// How far along a border the place of it that is nearest lies, of its whole length.
double TurnOf(const OpeningBorder& border, const Eigen::Vector2d& place) {
  constexpr double kPi = std::numbers::pi;
  const Eigen::Vector2d from = place - border.middle_mm;
  const double along = from.dot(border.Axis()), across = from.dot(border.Across());
  const double round_mm = 0.5 * border.width_mm, line_mm = border.length_mm - border.width_mm;
  const double beyond = std::abs(along) - 0.5 * line_mm;
  // Of half a border, from the middle of one of its lines to that of the other: over the round end.
  const double turned = beyond > 0 ? std::atan2(beyond, std::abs(across)) : 0.0;
  double half_mm = 0.5 * line_mm + std::min(0.0, beyond) + round_mm * turned;
  if (across < 0) half_mm = line_mm + kPi * round_mm - half_mm;
  const double part = 0.5 * half_mm / (line_mm + kPi * round_mm);
  return along < 0 ? 1.0 - part : part;
}

// A place of the line about which a border is cut and the way from it to the border: across the
// line, or all ways from its ends.
struct WayOut {
  Eigen::Vector2d from_mm, way;
  bool is_round = false;
};
WayOut WayOutAt(const OpeningBorder& border, double turn) {
  constexpr double kPi = std::numbers::pi;
  const double round_mm = 0.5 * border.width_mm, line_mm = border.length_mm - border.width_mm;
  const double side = turn > 0.5 ? -1.0 : 1.0;
  const double half_mm = 2.0 * (turn > 0.5 ? 1.0 - turn : turn) * (line_mm + kPi * round_mm);
  const double on_round_mm = half_mm - 0.5 * line_mm;
  const double turned = std::clamp(on_round_mm / round_mm, 0.0, kPi);
  const double along_mm =
      0.5 * line_mm + std::min(0.0, on_round_mm) - std::max(0.0, on_round_mm - kPi * round_mm);
  return {border.middle_mm + side * along_mm * border.Axis(),
          side * std::sin(turned) * border.Axis() + std::cos(turned) * border.Across(),
          turned > 0.0 && turned < kPi};
}

// Places spread over what lies in a border and up to `reach_mm` beside it, each with the area it
// stands for: as many all around, one behind the other each `step_mm` from the border on.
template <class Take>
void SpreadBeside(const OpeningBorder& border, double reach_mm, double step_mm, Take take) {
  const double round_mm = 0.5 * border.width_mm;
  const double around_mm =
      2.0 * (std::numbers::pi * round_mm + border.length_mm - border.width_mm) / kBeside.around;
  // A lean makes an oval of it, and more where the wall turns away.
  const double most_mm = border.lean.isZero() ? round_mm + reach_mm : 4.0 * (round_mm + reach_mm);
  const double from_mm = round_mm - step_mm * std::floor(round_mm / step_mm);
  for (double i = 0.5; i < kBeside.around; i += 1.0) {
    const WayOut out = WayOutAt(border, i / kBeside.around);
    for (double off_mm = from_mm + 0.5 * step_mm; off_mm < most_mm; off_mm += step_mm) {
      const double wide_mm = out.is_round ? around_mm * off_mm / round_mm : around_mm;
      const Eigen::Vector2d place = out.from_mm + off_mm * out.way;
      if (off_mm > round_mm && border.DistanceMm(place) > reach_mm) break;
      take(place, wide_mm * step_mm);
    }
  }
}

// How many samples each of the places has that are like a border beside it, of `likes` spread about
// it those where that can be told.
std::vector<double> CountsOfLikes(const OpeningBorder& border,
                                  std::span<const Eigen::Vector2d> present, double reach_mm,
                                  double pipe_radius_mm, double least_sides, double likes) {
  OpeningBorder like = border;
  like.width_mm *= kBeside.like;
  like.length_mm -= border.width_mm - like.width_mm;
  const Eigen::Vector2d line_mm = 0.5 * (like.length_mm - like.width_mm) * like.Axis();
  std::vector<double> counts;
  SpreadOver(border, reach_mm, likes, [&](const Eigen::Vector2d& place) {
    like.middle_mm = place;
    // None of it in the opening, nor where nothing was looked at.
    for (const double end : {-1.0, -0.5, 0.0, 0.5, 1.0}) {
      const Eigen::Vector2d of_line = place + end * line_mm;
      if (border.DistanceMm(of_line) < 0.5 * like.width_mm) return;
      if (of_line.norm() + 0.5 * like.width_mm > reach_mm) return;
      if (std::abs(of_line.y()) + 0.5 * like.width_mm > kLimb * pipe_radius_mm) return;
    }
    if (least_sides > 0) {
      const BorderSides sides = SidesOf(like, present, 0.0, border.width_mm, 0.0);
      if (sides.with_samples < least_sides * sides.all) return;
    }
    counts.push_back(static_cast<double>(
        std::count_if(present.begin(), present.end(),
                      [&](const Eigen::Vector2d& sample) { return like.DistanceMm(sample) < 0; })));
  });
  return counts;
}

}  // namespace

double GapBeside(const OpeningBorder& border, const PlaneSamples& present, double pipe_radius_mm) {
  std::vector<double> gaps;
  const double from_mm = 0.25 * border.width_mm, to_mm = from_mm + 0.5 * border.width_mm;
  const double reach_mm = 0.5 * border.length_mm + to_mm;
  SpreadOver(border, reach_mm, kBeside.most_gap_probes, [&](const Eigen::Vector2d& place) {
    const double off_mm = border.DistanceMm(place);
    if (std::abs(place.y()) > kLimb * pipe_radius_mm) return;
    if (off_mm > from_mm && off_mm < to_mm) gaps.push_back(present.NearestMm(place));
  });
  return Quantile(std::move(gaps), 0.98);
}

bool IsNarrow(const OpeningBorder& border, double gap_mm) {
  return border.width_mm < 2.0 * kBeside.narrow * gap_mm;
}

BorderSides SidesOf(const OpeningBorder& border, std::span<const Eigen::Vector2d> wall,
                    double clear_mm, double reach_mm, double least_side_mm) {
  std::vector<double> turns;
  for (const Eigen::Vector2d& place : wall) {
    const double off_mm = border.DistanceMm(place);
    if (off_mm < -clear_mm || off_mm > reach_mm) continue;
    turns.push_back(TurnOf(border, place));
  }
  const double around_mm =
      std::numbers::pi * border.width_mm + 2.0 * (border.length_mm - border.width_mm);
  const double most = std::min(static_cast<double>(turns.size()) / kBeside.of_side,
                               around_mm / std::max(least_side_mm, 1e-9));
  const int sides = std::clamp(static_cast<int>(std::min<double>(most, kBeside.most_sides)),
                               kBeside.least_sides, kBeside.most_sides);
  std::vector<bool> has(static_cast<std::size_t>(sides), false);
  for (const double turn : turns) {
    has[std::min(static_cast<std::size_t>(turn * sides), has.size() - 1)] = true;
  }
  return {static_cast<int>(std::count(has.begin(), has.end(), true)), sides};
}

double LogOddsOfShadow(const OpeningBorder& border, std::span<const Eigen::Vector2d> wall,
                       double gap_mm, double pipe_radius_mm) {
  const double band_mm = std::max(gap_mm, kBeside.band * border.width_mm);
  struct Band {
    double samples = 0, mm2 = 0;
  };
  std::vector<std::array<Band, 2>> sectors(static_cast<std::size_t>(kBeside.sectors));
  // The band of a place: the nearer one, the further one, or none.
  const auto at = [&](const Eigen::Vector2d& place) -> Band* {
    const double off_mm = border.DistanceMm(place);
    if (off_mm <= 0 || off_mm >= (1.0 + kBeside.further) * band_mm) return nullptr;
    if (std::abs(place.y()) > kLimb * pipe_radius_mm) return nullptr;
    const auto sector = static_cast<std::size_t>(TurnOf(border, place) * kBeside.sectors);
    return &sectors[std::min(sector, sectors.size() - 1)][off_mm < band_mm ? 0 : 1];
  };
  for (const Eigen::Vector2d& place : wall) {
    if (Band* band = at(place)) band->samples += 1;
  }
  const double reach_mm = (1.0 + kBeside.further) * band_mm;
  SpreadBeside(border, reach_mm, band_mm / kBeside.of_band,
               [&](const Eigen::Vector2d& place, double mm2) {
                 // Of the wall, which is seen from the side further out.
                 const double side = place.y() / pipe_radius_mm;
                 if (Band* band = at(place)) band->mm2 += mm2 / std::sqrt(1.0 - side * side);
               });
  // Of a sample in either band it is known in which it would lie, were they as dense as each other,
  // or the nearer one as thin as beside an edge.
  double log_odds = 0, most = 0;
  for (const auto& [near, far] : sectors) {
    if (!(near.mm2 > 0) || !(far.mm2 > 0)) continue;
    const double cut = near.mm2 / (near.mm2 + far.mm2);
    const double edge = kBeside.left * near.mm2 / (kBeside.left * near.mm2 + far.mm2);
    const double log =
        near.samples * std::log(edge / cut) + far.samples * std::log((1.0 - edge) / (1.0 - cut));
    log_odds += log;
    most = std::max(most, log);
  }
  return log_odds - most;
}

bool IsLikeItsSurroundings(const OpeningBorder& border, std::span<const Eigen::Vector2d> present,
                           double reach_mm, double pipe_radius_mm, double least_sides) {
  std::vector<double> counts;
  for (double likes = kBeside.likes;
       likes <= kBeside.most_likes && counts.size() < kBeside.enough_likes; likes *= 4.0) {
    counts = CountsOfLikes(border, present, reach_mm, pipe_radius_mm, least_sides, likes);
  }
  if (counts.size() < kBeside.least_likes) return true;
  const double most = std::max(1.0, kBeside.is_empty * Quantile(counts, 0.5));
  const auto empty = static_cast<double>(
      std::count_if(counts.begin(), counts.end(), [&](double count) { return count <= most; }));
  return empty > kBeside.most_empty * static_cast<double>(counts.size());
}

}  // namespace bendloop::pipeline
