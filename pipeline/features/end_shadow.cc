// SPDX-License-Identifier: Apache-2.0
#include "pipeline/features/end_shadow.h"

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <numbers>
#include <tuple>
#include <vector>

namespace bendloop::pipeline {
namespace {

struct ShadowSettings {
  // Slopes before the scan: most cuts are square to so much, and some are steep (Cauchy).
  double square_slope = 0.05;
  // Planes through columns that are so far apart, of the turn, twice.
  std::array<double, 3> apart = {1.0 / 12.0, 1.0 / 6.0, 1.0 / 4.0};
  // [of the mean gap] What a plane is compared with is moved by up to so much to where it is
  // likeliest, in such steps.
  double moved = 3.0, step = 0.1;
  int walk = 1500;
  // [of its mean gap] A column that stops so far before a plane does not stop at it.
  double stops_before = 4.0;
  // Three columns side by side stop so far before a plane that chance does not do it, on average;
  // one that shows nothing, or that stops farther, does by so much.
  double neighbours_before = 3.5, most_before = 8.0;
  // Of the mean gap: a plane that rises by less across a column is level in it.
  double level = 0.25;
};
constexpr ShadowSettings kShadow;

// How far the border lies along the tube, by the direction from its axis.
using BorderAt = std::function<double(double cosine, double sine)>;

BorderAt PlaneAt(const Eigen::Vector3d& plane_mm) {
  return [plane_mm](double cosine, double sine) {
    return plane_mm[0] + cosine * plane_mm[1] + sine * plane_mm[2];
  };
}

double LogOfSlope(const Eigen::Vector3d& plane_mm, double r_mm) {
  return -1.5 *
         std::log1p(plane_mm.tail<2>().squaredNorm() / std::pow(kShadow.square_slope * r_mm, 2));
}

// Columns along the tube, about a slope so that the border is level within each.
class ShadowColumns {
 public:
  ShadowColumns(std::span<const EndSample> samples, const EndInDoubt& doubt,
                const Eigen::Vector2d& slope_mm)
      : slope_mm_(slope_mm),
        evidence_(EndColumnsAbout(samples, doubt.window_mm, doubt.smear_mm, slope_mm)) {}

  bool AreEnough() const { return evidence_.has_value() && evidence_->gap_mm > 0; }
  const EndEvidence& evidence() const { return *evidence_; }
  double Count() const {
    return 0.5 * static_cast<double>(evidence_->sides.size()) +
           static_cast<double>(evidence_->columns.size());
  }
  bool AreLevelFor(const Eigen::Vector3d& plane_mm) const {
    return (plane_mm.tail<2>() - slope_mm_).norm() * evidence_->width_rad <
           kShadow.level * evidence_->gap_mm;
  }

  // The logarithm of the likelihood of a border before which some may be hidden.
  double Log(const BorderAt& border) const {
    hits_.clear(), misses_.clear(), beyond_.clear();
    for (const EndSide& side : evidence_->sides) {
      const double off_mm = Level(border, side.cosine, side.sine) - side.at_mm;
      const double clear = (side.is_beyond ? off_mm : -off_mm) / side.sigma_mm;
      (side.is_beyond ? hits_ : misses_).push_back(clear + evidence_->lines_greatest);
    }
    for (const EndStop& stop : evidence_->columns) {
      beyond_.push_back((Level(border, stop.cosine, stop.sine) - stop.last_mm) / stop.mean_gap_mm);
    }
    return LogOfHits(hits_) + LogOfMisses(misses_) +
           (evidence_->stops_or_hidden ? evidence_->stops_or_hidden->Sum(beyond_) : 0.0);
  }

  // Of the likeliest border of those that lie a little before or beyond it, of each column.
  double LogOfOne(const BorderAt& border) const {
    double best = -1e300;
    const double step_mm = kShadow.step * evidence_->gap_mm;
    const int steps = static_cast<int>(kShadow.moved / kShadow.step);
    for (int i = -steps; i <= steps; ++i) {
      best = std::max(best, Log([&](double cosine, double sine) {
                        return border(cosine, sine) + step_mm * i;
                      }));
    }
    return best / Count();
  }

  // Part of the turn on which samples stop at the plane.
  double Seen(const Eigen::Vector3d& plane_mm) const {
    double seen = 0;
    for (const RoughEndPlace& place : evidence_->RoughPlaces()) {
      const double off_mm = Level(PlaneAt(plane_mm), place.cosine, place.sine) - place.at_mm;
      if (std::abs(off_mm) < kShadow.stops_before * evidence_->gap_mm) seen += 1;
    }
    return seen * evidence_->width_rad / (2.0 * std::numbers::pi);
  }

 private:
  double Level(const BorderAt& border, double cosine, double sine) const {
    return border(cosine, sine) - slope_mm_[0] * cosine - slope_mm_[1] * sine;
  }

  Eigen::Vector2d slope_mm_;
  std::optional<EndEvidence> evidence_;
  mutable std::vector<double> hits_, misses_, beyond_;
};

// Planes that may be the likeliest: square ones at each column, and those through three.
std::vector<Eigen::Vector3d> SomePlanes(const EndEvidence& columns) {
  std::vector<RoughEndPlace> places = columns.RoughPlaces();
  std::sort(places.begin(), places.end(), [](const RoughEndPlace& a, const RoughEndPlace& b) {
    return std::atan2(a.sine, a.cosine) < std::atan2(b.sine, b.cosine);
  });
  const std::size_t n = places.size();
  std::vector<Eigen::Vector3d> planes;
  for (std::size_t k = 0; k < n; ++k) {
    planes.emplace_back(places[k].at_mm, 0.0, 0.0);
    for (const double apart : kShadow.apart) {
      const auto step = static_cast<std::size_t>(apart * static_cast<double>(n));
      if (step == 0) continue;
      Eigen::Matrix3d rows;
      Eigen::Vector3d at_mm;
      for (Eigen::Index i = 0; i < 3; ++i) {
        const RoughEndPlace& place = places[(k + static_cast<std::size_t>(i) * step) % n];
        rows.row(i) << 1.0, place.cosine, place.sine;
        at_mm[i] = place.at_mm;
      }
      const Eigen::Vector3d plane = rows.partialPivLu().solve(at_mm);
      if (plane.allFinite()) planes.push_back(plane);
    }
  }
  return planes;
}

// How far a border lies beyond its plane, between the places where that is said.
double BeyondPlane(std::span<const BorderPlace> border, double cosine, double sine) {
  const double turn = std::atan2(sine, cosine) / (2.0 * std::numbers::pi);
  const auto n = static_cast<double>(border.size());
  const double at = (turn - std::floor(turn)) * n;
  const auto k = std::min(border.size() - 1, static_cast<std::size_t>(at));
  const double part = at - static_cast<double>(k);
  return (1.0 - part) * border[k].beyond_mm + part * border[(k + 1) % border.size()].beyond_mm;
}

// Of each column, of where samples were taken to stop before.
double LogOfDoubtful(const ShadowColumns& columns, const EndInDoubt& doubt) {
  const BorderAt plane = PlaneAt(doubt.plane_mm);
  if (doubt.border.empty()) return columns.LogOfOne(plane);
  return columns.LogOfOne([&](double cosine, double sine) {
    return plane(cosine, sine) + BeyondPlane(doubt.border, cosine, sine);
  });
}

}  // namespace

std::optional<ShadowedEnd> FindEndInShadow(std::span<const EndSample> samples,
                                           const EndInDoubt& doubt, WalkDice& dice) {
  const double r_mm = doubt.pipe_radius_mm;
  const ShadowColumns doubtful(samples, doubt, doubt.plane_mm.tail<2>());
  ShadowColumns columns(samples, doubt, Eigen::Vector2d::Zero());
  if (!doubtful.AreEnough() || !columns.AreEnough()) return std::nullopt;
  Eigen::Vector3d best = doubt.plane_mm;
  double most = -1e300;
  for (const Eigen::Vector3d& plane : SomePlanes(columns.evidence())) {
    const double log = columns.Log(PlaneAt(plane)) + LogOfSlope(plane, r_mm);
    if (log > most) std::tie(most, best) = std::tie(log, plane);
  }
  if (!columns.AreLevelFor(best)) {
    columns = ShadowColumns(samples, doubt, best.tail<2>());
    if (!columns.AreEnough()) return std::nullopt;
  }
  const double gap_mm = columns.evidence().gap_mm;
  const Posterior from{best, std::pow(0.3 * gap_mm, 2) * Eigen::Matrix3d::Identity()};
  ShadowedEnd end;
  end.plane = SamplePosterior(from, kShadow.walk, dice, [&](const Eigen::VectorXd& x) {
    return columns.Log(PlaneAt(x)) + LogOfSlope(x, r_mm);
  });
  end.columns = columns.Count();
  end.seen = columns.Seen(end.plane.mean);
  const double log = columns.LogOfOne(PlaneAt(end.plane.mean));
  end.likelier = columns.Count() * (log - LogOfDoubtful(doubtful, doubt)) +
                 LogOfSlope(end.plane.mean, r_mm) - LogOfSlope(doubt.plane_mm, r_mm) +
                 0.5 * (doubt.terms - 3) * std::log(columns.Count());
  return end;
}

EndSectors SectorsInShadow(const EndEvidence& columns, const Eigen::Vector2d& slope_mm,
                           const Eigen::Vector3d& plane_mm) {
  const double turn_rad = 2.0 * std::numbers::pi;
  const auto n = static_cast<std::size_t>(std::lround(turn_rad / columns.width_rad));
  std::vector<double> before(n, kShadow.most_before);  // [of the mean gap]
  for (const RoughEndPlace& place : columns.RoughPlaces()) {
    const double turn = std::atan2(place.sine, place.cosine) / turn_rad;
    const auto k = static_cast<std::size_t>((turn - std::floor(turn)) * static_cast<double>(n));
    const Eigen::Vector3d row(1.0, place.cosine, place.sine);
    const double level_mm = row.dot(plane_mm) - row.tail<2>().dot(slope_mm);
    before[std::min(k, n - 1)] =
        std::clamp((level_mm - place.at_mm) / columns.gap_mm + 0.5, -1.0, kShadow.most_before);
  }
  EndSectors early{}, hidden{};
  for (std::size_t k = 0; k < n; ++k) {
    const double mean = (before[(k + n - 1) % n] + before[k] + before[(k + 1) % n]) / 3.0;
    if (mean < kShadow.neighbours_before || before[k] < 1.0) continue;
    const double first = static_cast<double>(k) * columns.width_rad;
    for (double at = 0.1; at < 1.0; at += 0.2) {
      early[EndSectorOf(first + at * columns.width_rad)] = true;
    }
  }
  // Those beside it may be half in shadow.
  for (std::size_t i = 0; i < kEndSectors; ++i) {
    hidden[i] =
        early[i] || early[(i + 1) % kEndSectors] || early[(i + kEndSectors - 1) % kEndSectors];
  }
  return hidden;
}

}  // namespace bendloop::pipeline
