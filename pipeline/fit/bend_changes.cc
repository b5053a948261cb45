// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/bend_changes.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <limits>
#include <span>
#include <utility>
#include <vector>

namespace bendloop::pipeline {
namespace {

// By trial where nothing else is said.
struct BendChangeSettings {
  // [degrees] A machine makes no slighter bend (StructureOptions).
  double least_deg = 0.5;
  // Two bends may be one: [of r_P] the straight between them, [degrees] and [sigma] the rotation;
  // a slight one has hardly a plane, and may undo what a dent made of the other.
  double between = 4.0, turned_deg = 3.0, turned_sigmas = 2.0;
  double slight_deg = 10.0, slight_turned_deg = 60.0;
  // [degrees] Bends of less may stand in for bows: one of L / N looks like sqrt(24) / N rad, and
  // L / 220 is the worst that is no bend.
  double as_bow_deg = 1.3;
  // [of a straight's length] Bows from which on it may be a slight bend: sold as straight is
  // L / 300, and one that changes sides on it.
  double bow = 1.0 / 220.0;
  // [of r_P] As much again as a bend costs where no clamp holds what is between it and the one that
  // it may be, and that eases or is dented.
  double clamp = 1.0;
};
constexpr BendChangeSettings kChanges;
constexpr double kNoRadius = std::numeric_limits<double>::infinity();

// Where the lines from `a` to `b` and from `c` to `d` are nearest to each other.
Eigen::Vector3d Between(const Eigen::Vector3d& a, const Eigen::Vector3d& b,
                        const Eigen::Vector3d& c, const Eigen::Vector3d& d) {
  const Eigen::Vector3d u = b - a, v = d - c, normal = u.cross(v);
  const double n2 = std::max(1e-30, normal.squaredNorm());
  const double s = (c - a).cross(v).dot(normal) / n2, t = (c - a).cross(u).dot(normal) / n2;
  return 0.5 * (a + s * u + c + t * v);
}

// Corners `first`, from 1 on, to `last` become one.
ControlPolygon Merged(ControlPolygon polygon, std::size_t first, std::size_t last,
                      double radius_mm) {
  auto& points = polygon.points_mm;
  auto& radii = polygon.bend_radii_mm;
  const auto at = [](std::size_t i) { return static_cast<std::ptrdiff_t>(i); };
  points[first] = Between(points[first - 1], points[first], points[last], points[last + 1]);
  points.erase(points.begin() + at(first) + 1, points.begin() + at(last) + 1);
  radii[first - 1] = radius_mm;
  radii.erase(radii.begin() + at(first), radii.begin() + at(last));
  return polygon;
}

ControlPolygon Without(ControlPolygon polygon, std::size_t corner) {
  polygon.points_mm.erase(polygon.points_mm.begin() + static_cast<std::ptrdiff_t>(corner));
  polygon.bend_radii_mm.erase(polygon.bend_radii_mm.begin() + static_cast<std::ptrdiff_t>(corner) -
                              1);
  return polygon;
}

// A straight gets a corner in the middle of its bow.
ControlPolygon Bent(ControlPolygon polygon, std::size_t straight, const hal::SpineSegment& line,
                    const Bow& bow, double radius_mm) {
  const Eigen::Vector2d off_mm = bow.Beside(0.0) - 0.5 * (bow.Beside(-1.0) + bow.Beside(1.0));
  const Eigen::Matrix3d axes = line.axes();
  polygon.points_mm.insert(polygon.points_mm.begin() + static_cast<std::ptrdiff_t>(straight) + 1,
                           line.PointAt(0.5 * line.length_mm) +
                               1.3 * (off_mm[0] * axes.col(1) + off_mm[1] * axes.col(2)));
  polygon.bend_radii_mm.insert(
      polygon.bend_radii_mm.begin() + static_cast<std::ptrdiff_t>(straight), radius_mm);
  return polygon;
}

// Which bends may be one. [of r_P] The straight between them is shorter; and whether one may undo
// what a dent made of the other.
struct RunRule {
  double between = kChanges.between;
  bool may_undo = false;
};

bool MayBeOne(const SurfaceFit& fit, std::size_t bend, const RunRule& rule) {
  const auto& rows = fit.tube.program.rows;
  const double r_mm = fit.tube.pipe_radius_mm, between_mm = rows[bend].length_mm;
  if (between_mm > rule.between * r_mm) return false;
  const bool is_slight =
      std::min(rows[bend - 1].angle_deg, rows[bend].angle_deg) < kChanges.slight_deg ||
      (rule.may_undo && between_mm < kChanges.clamp * r_mm);
  const double turned_deg = std::abs(rows[bend].rotation_deg);
  const double least_deg = (is_slight ? kChanges.slight_turned_deg : kChanges.turned_deg) +
                           kChanges.turned_sigmas * fit.sigma.rows[bend].rotation_deg;
  return turned_deg < least_deg || (rule.may_undo && is_slight && turned_deg > 180.0 - least_deg);
}

// Bends that follow each other and may all be one, from the first to the last.
struct Run {
  std::size_t first = 0, last = 0;
  bool operator==(const Run&) const = default;
};

std::vector<Run> Runs(const SurfaceFit& fit, const RunRule& rule) {
  std::vector<Run> runs;
  for (std::size_t i = 1; i < fit.tube.program.bend_count(); ++i) {
    if (!MayBeOne(fit, i, rule)) continue;
    if (!runs.empty() && runs.back().last + 1 == i) {
      runs.back().last = i;
    } else {
      runs.push_back({i - 1, i});
    }
  }
  return runs;
}

// The radius of the widest of the run's bends.
double RadiusOf(const hal::BendProgram& program, const Run& run) {
  const auto* const widest = std::max_element(
      &program.rows[run.first], &program.rows[run.last] + 1,
      [](const hal::BendRow& a, const hal::BendRow& b) { return a.angle_deg < b.angle_deg; });
  return widest->bend_radius_mm.value_or(0.0);
}

// Every run as one bend; a run of one bend as none.
BendChange WithRunsMerged(const SurfaceFit& fit, const ControlPolygon& polygon,
                          std::span<const Run> runs) {
  BendChange change{polygon};
  // From the last on, so that those before it keep their places.
  for (std::size_t k = runs.size(); k-- > 0;) {
    const Run& run = runs[k];
    if (run.first == run.last) {
      change.corners = Without(change.corners, run.first + 1);
      continue;
    }
    change.corners =
        Merged(change.corners, run.first + 1, run.last + 1, RadiusOf(fit.tube.program, run));
    for (std::size_t i = run.first + 1; i <= run.last; ++i) {
      const double between_mm = fit.tube.program.rows[i].length_mm;
      change.unmade += between_mm < kChanges.clamp * fit.tube.pipe_radius_mm ? 1.0 : 0.0;
    }
  }
  return change;
}

// Bends that follow each other as one, those of all places at once before those of one: bends that
// ease are alike in that, and one that does not for once hides it of the others. Those that no
// clamp holds apart by themselves, too: one that does may part two that are none. `may_undo`: see
// RunRule.
std::vector<BendChange> MergeRuns(const SurfaceFit& fit, const ControlPolygon& polygon,
                                  bool may_undo) {
  const std::vector<Run> unclamped = Runs(fit, {kChanges.clamp, may_undo});
  const std::vector<Run> runs = Runs(fit, {kChanges.between, may_undo});
  std::vector<BendChange> list;
  const auto add = [&](std::span<const Run> of) {
    list.push_back(WithRunsMerged(fit, polygon, of));
  };
  if (!runs.empty()) add(runs);
  if (!unclamped.empty() && unclamped != runs) add(unclamped);
  for (const Run& run : runs) {
    if (runs.size() > 1) add({&run, 1});
  }
  for (const Run& run : runs) {
    for (std::size_t i = run.first; run.last > run.first + 1 && i < run.last; ++i) {
      const Run two{i, i + 1};
      add({&two, 1});
    }
  }
  return list;
}

// Those that a bow may look like, where straights are taken for straight or once they are bowed:
// one that stood in for a bow may be anything then.
std::vector<std::size_t> SlightBends(const BowedSolution& now) {
  const auto &as_straight = now.straight.program.rows, &as_bowed = now.fit.tube.program.rows;
  std::vector<std::size_t> slight;
  for (std::size_t i = 0; i + 1 < as_straight.size(); ++i) {
    if (std::min(as_straight[i].angle_deg, as_bowed[i].angle_deg) < kChanges.as_bow_deg) {
      slight.push_back(i);
    }
  }
  return slight;
}

// Every run as one bend and every slight bend as none: what stands in for bows at two places hides
// at either that the other is none.
BendChange WithoutAllInDoubt(const BowedSolution& now, const ControlPolygon& polygon,
                             std::span<const std::size_t> slight) {
  std::vector<Run> all = Runs(now.fit, {.between = kChanges.clamp});
  const std::size_t runs = all.size();
  if (runs == 0) return {};
  for (const std::size_t bend : slight) {
    const bool is_in_run = std::any_of(all.begin(), all.end(), [bend](const Run& run) {
      return run.first <= bend && bend <= run.last;
    });
    if (!is_in_run) all.push_back({bend, bend});
  }
  if (all.size() == runs) return {};
  std::sort(all.begin(), all.end(), [](const Run& a, const Run& b) { return a.first < b.first; });
  return WithRunsMerged(now.fit, polygon, all);
}

}  // namespace

bool IsMoreThanBendersLeave(const Bow& bow, double straight_mm) {
  const double height_mm = 1.5 * bow.HeightMm(0).norm();
  return !bow.is_none() && height_mm >= kChanges.bow * bow.LengthMm(straight_mm);
}

std::vector<BendChange> BendChanges(const BowedSolution& now,
                                    std::optional<std::size_t> nominal_bends) {
  std::vector<BendChange> changes;
  // Best-fit lines of bowed straights pass each other: a tube made of them leaves its points.
  const auto polygon = PolygonFromTube(now.straight);
  if (!polygon) return changes;
  const auto& rows = now.fit.tube.program.rows;
  const std::size_t bends = now.fit.tube.program.bend_count();
  const bool fewer = !nominal_bends || bends > *nominal_bends,
             more = !nominal_bends || bends < *nominal_bends;
  const auto add = [&](BendChange change) {
    const std::size_t then = change.corners.bend_radii_mm.size();
    if (then < bends && nominal_bends && then < *nominal_bends) return;
    changes.push_back(std::move(change));
  };
  if (fewer) {
    for (BendChange& change : MergeRuns(now.fit, *polygon, false)) add(std::move(change));
  }
  const std::vector<std::size_t> slight = SlightBends(now);
  if (fewer && slight.size() > 1) {
    // From the last on, so that those before it keep their places.
    ControlPolygon without = *polygon;
    for (std::size_t i = slight.size(); i-- > 0;) without = Without(without, slight[i] + 1);
    add({std::move(without)});
  }
  for (std::size_t i = 0; fewer && i < slight.size(); ++i) {
    const bool is_none = rows[slight[i]].angle_deg < kChanges.least_deg;
    add({Without(*polygon, slight[i] + 1), is_none});
  }
  if (fewer) {
    BendChange change = WithoutAllInDoubt(now, *polygon, slight);
    if (!change.corners.points_mm.empty()) add(std::move(change));
    if (Runs(now.fit, {.may_undo = true}) != Runs(now.fit, {})) {
      for (BendChange& undone : MergeRuns(now.fit, *polygon, true)) add(std::move(undone));
    }
  }
  const EasedSpine spine = SpineOf(now.bows.state);
  double radius_mm = kNoRadius;
  for (std::size_t i = 0; i + 1 < rows.size(); ++i) {
    radius_mm = std::min(radius_mm, rows[i].bend_radius_mm.value_or(kNoRadius));
  }
  for (std::size_t k = 0; more && k < now.bows.state.bows.size(); ++k) {
    const Bow& bow = now.bows.state.bows[k];
    if (!IsMoreThanBendersLeave(bow, spine.segments[k].length_mm)) continue;
    add({Bent(*polygon, spine.row(k), spine.segments[k], bow, radius_mm)});
  }
  return changes;
}

}  // namespace bendloop::pipeline
