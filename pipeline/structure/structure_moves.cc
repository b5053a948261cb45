// SPDX-License-Identifier: Apache-2.0
#include "pipeline/structure/structure_moves.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "hal/spine.h"
#include "pipeline/math/quantiles.h"

namespace bendloop::pipeline {
namespace {

// By trial where nothing else is said.
struct MoveSettings {
  // [of the old arc's radius] Of the two arcs that one is split into.
  double split_radius = 0.4;
  // [of r_P] So near to an arc the samples' wish for a bend may mean the arc too.
  double near_arc = 1.5;
  // [of r_P] A bend with less than this beyond it (arc and straight) is not told from the cap, burr
  // or fixture at the border of a scan: the tube goes straight on there. The latter: of a bend that
  // is as tight as the fit lets it be.
  double border = 1.0, tight_border = 2.0;
  // [of the usual number of samples a length] Less is not seen, but for so many samples of a bend
  // and of the straight beyond it, [sigma] root mean square, that lie there as well as others do
  // elsewhere: a scan may grow thin; or for so many of the bend alone, where others are not. What
  // lies beside a tube's end by chance is off by a fifth of a pipe radius (the fit's reach).
  double seen = 0.4, thin_samples = 8, thin_beyond = 4, thin_arc = 20, thin_sigmas = 2.5;
  // Or, [of r_P] beyond a straight of more than that, for such a part of them all that lies there.
  double thin_straight = 4.0, thin_part = 0.5;
  // [of r_P] and [sigma] 1 sigma of an outermost bend's samples, and of them together with those
  // beyond it: fittings and caps leave 0.07 and more, and 0.19; a dent in the bend leaves less.
  double unexplained = 0.06, unexplained_beyond = 0.1, unexplained_sigmas = 5.0;
  // [of r_P] So much of a tube from an arc on is no fitting, nor what leads so far away from the
  // straight before it in a bend so wide: fittings sit about the tube's axis.
  double fitting = 8.0, fitting_aside = 2.0, fitting_bend = 4.0;
  // [of r_P] A bend radius of less stands where the fit holds it (FitBounds).
  double tight = 1.05;
  // A small bend that is put into a line. [rad] Its angle.
  double least_small_rad = 1e-3, most_small_rad = 0.5;
  // [of r_P] Its radius where no other bend tells one, and the limits of what others tell: what
  // common dies make.
  double small_radius = 3.0, tightest_small = 1.5, widest_small = 8.0;
};
constexpr MoveSettings kMoves;

// All that comes after the first `count` arcs, turned about a place.
void MoveRest(ArcLineSpline& spline, std::size_t count, const Eigen::Vector3d& about,
              const Eigen::Matrix3d& turn) {
  for (std::size_t i = count; i < spline.arcs.size(); ++i) {
    SplineArc& arc = spline.arcs[i];
    arc.begin_mm = about + turn * (arc.begin_mm - about);
    arc.end_mm = about + turn * (arc.end_mm - about);
    arc.tangent_in = turn * arc.tangent_in;
    arc.tangent_out = turn * arc.tangent_out;
    arc.normal = turn * arc.normal;
  }
  spline.end_mm = about + turn * (spline.end_mm - about);
}

// The arc as two of the same circle: the fit finds how they differ.
ArcLineSpline WithArcParted(const ArcLineSpline& spline, std::size_t index, double along_mm) {
  ArcLineSpline with = spline;
  SplineArc& second = with.arcs[index];
  SplineArc first = second;
  first.angle_rad = along_mm / first.radius_mm;
  const Eigen::Matrix3d turn = Eigen::AngleAxisd(first.angle_rad, first.normal).toRotationMatrix();
  const Eigen::Vector3d center =
      first.begin_mm + first.radius_mm * first.normal.cross(first.tangent_in);
  first.end_mm = center + turn * (first.begin_mm - center);
  first.tangent_out = turn * first.tangent_in;
  second.begin_mm = first.end_mm;
  second.tangent_in = first.tangent_out;
  second.angle_rad -= first.angle_rad;
  with.arcs.insert(with.arcs.begin() + static_cast<std::ptrdiff_t>(index), first);
  return with;
}

// A small bend in a line, as tight as the others; the rest of the tube turns with it.
ArcLineSpline WithSmallBend(const ArcLineSpline& spline, std::size_t arcs_before,
                            const hal::SpineSegment& line, double along_mm,
                            const Eigen::Vector3d& turn_rad, double pipe_radius_mm) {
  const Eigen::Vector3d at = line.PointAt(along_mm);
  const Eigen::Vector3d across = turn_rad - turn_rad.dot(line.tangent) * line.tangent;
  std::vector<double> radii;
  for (const SplineArc& other : spline.arcs) radii.push_back(other.radius_mm);
  SplineArc arc;
  arc.tangent_in = line.tangent;
  arc.angle_rad = std::clamp(across.norm(), kMoves.least_small_rad, kMoves.most_small_rad);
  arc.normal = across.normalized();
  const Eigen::Matrix3d turn = Eigen::AngleAxisd(arc.angle_rad, arc.normal).toRotationMatrix();
  arc.tangent_out = turn * arc.tangent_in;
  arc.radius_mm = radii.empty() ? kMoves.small_radius * pipe_radius_mm
                                : std::clamp(Median(radii), kMoves.tightest_small * pipe_radius_mm,
                                             kMoves.widest_small * pipe_radius_mm);
  const double reach_mm = arc.radius_mm * std::tan(0.5 * arc.angle_rad);
  arc.begin_mm = at - reach_mm * arc.tangent_in;
  arc.end_mm = at + reach_mm * arc.tangent_out;
  ArcLineSpline with = spline;
  MoveRest(with, arcs_before, at, turn);
  with.arcs.insert(with.arcs.begin() + static_cast<std::ptrdiff_t>(arcs_before), arc);
  return with;
}

// Two arcs in place of one, with the straight between them through a place of the spine; none: the
// lines do not meet in this order.
std::optional<std::array<SplineArc, 2>> SplitVia(const SplineArc& arc, const SpineNode& node) {
  const auto corner = [&node](const Eigen::Vector3d& point, const Eigen::Vector3d& direction) {
    const double c = direction.dot(node.tangent);
    const Eigen::Vector3d w = node.position_mm - point;
    // Where the node's line comes nearest to the other.
    return (c * w.dot(direction) - w.dot(node.tangent)) / std::max(1e-9, 1.0 - c * c);
  };
  const double at1 = corner(arc.begin_mm, arc.tangent_in);
  const double at2 = corner(arc.end_mm, arc.tangent_out);
  const double length_mm = at2 - at1;
  const auto between = [](const Eigen::Vector3d& from, const Eigen::Vector3d& to) {
    return std::atan2(from.cross(to).norm(), from.dot(to));
  };
  const double angle1 = between(arc.tangent_in, node.tangent);
  const double angle2 = between(node.tangent, arc.tangent_out);
  if (!(length_mm > 0) || length_mm > 2.0 * arc.radius_mm * arc.angle_rad || angle1 < 1e-3 ||
      angle2 < 1e-3) {
    return std::nullopt;
  }
  const double radius_mm =
      std::min(arc.radius_mm, 0.9 * length_mm / (std::tan(0.5 * angle1) + std::tan(0.5 * angle2)));
  const auto make = [&](double at, const Eigen::Vector3d& in, const Eigen::Vector3d& out,
                        double angle) {
    const Eigen::Vector3d place = node.position_mm + at * node.tangent;
    const double reach_mm = radius_mm * std::tan(0.5 * angle);
    return SplineArc{place - reach_mm * in,
                     place + reach_mm * out,
                     in,
                     out,
                     in.cross(out).normalized(),
                     radius_mm,
                     angle};
  };
  return std::array{make(at1, arc.tangent_in, node.tangent, angle1),
                    make(at2, node.tangent, arc.tangent_out, angle2)};
}

}  // namespace

ArcLineSpline SplineFromTube(const hal::Tube& tube) {
  const auto segments = hal::SpineSegments(tube.program, tube.X_WT);
  ArcLineSpline spline;
  spline.start_mm = segments.front().start_mm;
  spline.tangent = segments.front().tangent;
  spline.end_mm = segments.back().PointAt(segments.back().length_mm);
  for (std::size_t k = 1; k < segments.size(); k += 2) {
    const auto& arc = segments[k];
    spline.arcs.push_back({arc.start_mm, arc.PointAt(arc.length_mm), arc.tangent,
                           arc.TangentAt(arc.length_mm), arc.normal, arc.bend_radius_mm,
                           arc.angle_rad()});
  }
  return spline;
}

bool DropLast(ArcLineSpline& spline, double border_mm) {
  if (spline.arcs.empty()) return false;
  const SplineArc& last = spline.arcs.back();
  const double beyond_mm = last.radius_mm * last.angle_rad + (spline.end_mm - last.end_mm).norm();
  if (beyond_mm >= border_mm) return false;
  spline.end_mm = last.begin_mm + beyond_mm * last.tangent_in;
  spline.arcs.pop_back();
  return true;
}

bool DropFirst(ArcLineSpline& spline, double border_mm) {
  if (spline.arcs.empty()) return false;
  const SplineArc& first = spline.arcs.front();
  const double before_mm =
      first.radius_mm * first.angle_rad + (first.begin_mm - spline.start_mm).norm();
  if (before_mm >= border_mm) return false;
  spline.tangent = first.tangent_out;
  spline.start_mm = first.end_mm - before_mm * first.tangent_out;
  spline.arcs.erase(spline.arcs.begin());
  return true;
}

bool TrimBorders(ArcLineSpline& spline, double pipe_radius_mm) {
  const auto border_mm = [pipe_radius_mm](const SplineArc& arc) {
    return (arc.radius_mm < kMoves.tight * pipe_radius_mm ? kMoves.tight_border : kMoves.border) *
           pipe_radius_mm;
  };
  bool trimmed = false;
  while (!spline.arcs.empty() && DropLast(spline, border_mm(spline.arcs.back()))) trimmed = true;
  while (!spline.arcs.empty() && DropFirst(spline, border_mm(spline.arcs.front()))) trimmed = true;
  return trimmed;
}

double FewSamplesPerMm(const SurfaceFit& fit, std::span<const hal::SpineSegment> segments) {
  std::vector<double> densities;
  for (std::size_t k = 0; k < segments.size(); ++k) {
    if (segments[k].length_mm < fit.tube.pipe_radius_mm) continue;
    densities.push_back(fit.segment_samples[k] / segments[k].length_mm);
  }
  return kMoves.seen * Median(std::move(densities));
}

double UsualSamplesPerMm(const SurfaceFit& fit) {
  return FewSamplesPerMm(fit, hal::SpineSegments(fit.tube.program, fit.tube.X_WT)) / kMoves.seen;
}

bool DropUnseen(ArcLineSpline& spline, const SurfaceFit& fit) {
  if (spline.arcs.empty()) return false;
  const auto segments = hal::SpineSegments(fit.tube.program, fit.tube.X_WT);
  const double few = FewSamplesPerMm(fit, segments);
  // What sits on a thin end, and lies off the straight there, says nothing of the arc.
  const double thin_mm = kMoves.thin_sigmas * std::hypot(fit.sigma_mm, fit.form_mm);
  const auto lie_on_it = [&](double least, double samples, double squares_mm2) {
    return samples >= least && squares_mm2 < thin_mm * thin_mm * samples;
  };
  const auto lies_there = [&](std::size_t arc, std::size_t outer) {
    const double of_arc = fit.segment_samples[arc], beyond = fit.segment_samples[outer];
    if (beyond < kMoves.thin_beyond) return false;
    const double arc_mm2 = of_arc * fit.segment_mean_square_mm2[arc];
    const double beyond_mm2 = beyond * fit.segment_mean_square_mm2[outer];
    if (lie_on_it(kMoves.thin_arc, of_arc, arc_mm2) ||
        lie_on_it(kMoves.thin_samples, of_arc + beyond, arc_mm2 + beyond_mm2)) {
      return true;
    }
    // Nor is there none because something sits on the end of a straight that goes on for long.
    const double used = fit.segment_used[arc] + fit.segment_used[outer];
    return segments[outer].length_mm > kMoves.thin_straight * fit.tube.pipe_radius_mm &&
           used >= kMoves.thin_samples && used > kMoves.thin_part * (of_arc + beyond);
  };
  const auto unseen = [&](std::size_t arc, std::size_t outer) {
    const bool few_are_there =
        fit.segment_samples[outer] < few * fit.tube.pipe_radius_mm &&
        (fit.segment_samples[arc] < few * segments[arc].length_mm ||
         segments[arc].length_mm < kMoves.border * fit.tube.pipe_radius_mm ||
         segments[arc].bend_radius_mm < kMoves.tight * fit.tube.pipe_radius_mm);
    return few_are_there && !lies_there(arc, outer);
  };
  const std::size_t last = segments.size() - 1;
  const bool drop_last = unseen(last - 1, last);
  const bool drop_first = unseen(1, 0) && (!drop_last || spline.arcs.size() > 1);
  constexpr double kAll = std::numeric_limits<double>::infinity();
  if (drop_last) DropLast(spline, kAll);
  if (drop_first) DropFirst(spline, kAll);
  return drop_last || drop_first;
}

bool DropUnexplained(ArcLineSpline& spline, const SurfaceFit& fit) {
  if (spline.arcs.empty()) return false;
  const double r_mm = fit.tube.pipe_radius_mm;
  const double fitting_samples = kMoves.fitting * r_mm * UsualSamplesPerMm(fit);
  const auto is_unexplained = [&](std::size_t arc, std::size_t outer) {
    const double of_arc = fit.segment_samples[arc], beyond = fit.segment_samples[outer];
    if (!(of_arc + beyond > 0) || of_arc + beyond > fitting_samples) return false;
    const double arc_mm2 = fit.segment_mean_square_mm2[arc];
    const double both_mm2 =
        (of_arc * arc_mm2 + beyond * fit.segment_mean_square_mm2[outer]) / (of_arc + beyond);
    const double least_mm = kMoves.unexplained_sigmas * fit.sigma_mm;
    // One as tight as the pipe is made by no machine, however well its few samples lie on it.
    const bool is_tight = *fit.tube.program.rows[arc / 2].bend_radius_mm < kMoves.tight * r_mm;
    const bool bends = of_arc == 0 || is_tight ||
                       arc_mm2 > std::pow(std::max(least_mm, kMoves.unexplained * r_mm), 2);
    return bends && both_mm2 > std::pow(std::max(least_mm, kMoves.unexplained_beyond * r_mm), 2);
  };
  // As far as its samples reach where they are as thin as is still seen: the straight beyond it may
  // go on for as long as the fit likes.
  const double few_per_mm = kMoves.seen * UsualSamplesPerMm(fit);
  const auto seen_end = [&](std::size_t outer, const Eigen::Vector3d& arc_mm,
                            const Eigen::Vector3d& end_mm) {
    const double seen_mm = fit.segment_samples[outer] / std::max(1e-9, few_per_mm);
    const double long_mm = (end_mm - arc_mm).norm();
    return Eigen::Vector3d(arc_mm +
                           std::min(1.0, seen_mm / std::max(1e-9, long_mm)) * (end_mm - arc_mm));
  };
  const auto leads_aside = [&](const SplineArc& arc, const Eigen::Vector3d& end_mm,
                               const Eigen::Vector3d& from_mm, const Eigen::Vector3d& direction) {
    return arc.radius_mm > kMoves.fitting_bend * r_mm &&
           (end_mm - from_mm).cross(direction).norm() > kMoves.fitting_aside * r_mm;
  };
  const SplineArc &first_arc = spline.arcs.front(), &last_arc = spline.arcs.back();
  const std::size_t last = fit.segment_samples.size() - 1;
  const bool drop_last = is_unexplained(last - 1, last) &&
                         !leads_aside(last_arc, seen_end(last, last_arc.end_mm, spline.end_mm),
                                      last_arc.begin_mm, last_arc.tangent_in);
  const bool drop_first = is_unexplained(1, 0) && (!drop_last || spline.arcs.size() > 1) &&
                          !leads_aside(first_arc, seen_end(0, first_arc.begin_mm, spline.start_mm),
                                       first_arc.end_mm, first_arc.tangent_out);
  // Straight on; where the samples stop is found later.
  const double short_mm = kMoves.tight_border * r_mm;
  if (drop_last) {
    const SplineArc arc = spline.arcs.back();
    spline.arcs.pop_back();
    spline.end_mm = arc.begin_mm + short_mm * arc.tangent_in;
  }
  if (drop_first) {
    const SplineArc arc = spline.arcs.front();
    spline.arcs.erase(spline.arcs.begin());
    spline.tangent = arc.tangent_out;
    spline.start_mm = arc.end_mm - short_mm * arc.tangent_out;
  }
  return drop_last || drop_first;
}

bool ReachEnds(ArcLineSpline& spline, const SpinePolygon& polygon, double least_mm) {
  const Eigen::Vector3d ahead =
      spline.arcs.empty() ? spline.tangent : spline.arcs.back().tangent_out;
  const auto nearer = [](const SpineNode& a, const SpineNode& b, const Eigen::Vector3d& to) {
    return (a.position_mm - to).squaredNorm() < (b.position_mm - to).squaredNorm();
  };
  const bool forward = nearer(polygon.front(), polygon.back(), spline.start_mm);
  const SpineNode& first = forward ? polygon.front() : polygon.back();
  const SpineNode& last = forward ? polygon.back() : polygon.front();
  const double before_mm = (spline.start_mm - first.position_mm).dot(spline.tangent);
  const double after_mm = (last.position_mm - spline.end_mm).dot(ahead);
  if (before_mm > 0) spline.start_mm -= before_mm * spline.tangent;
  if (after_mm > 0) spline.end_mm += after_mm * ahead;
  return before_mm >= least_mm || after_mm >= least_mm;
}

std::optional<SplineArc> MergedArc(const SplineArc& a, const SplineArc& b) {
  SplineArc arc;
  arc.tangent_in = a.tangent_in;
  arc.tangent_out = b.tangent_out;
  const Eigen::Vector3d cross = a.tangent_in.cross(b.tangent_out);
  const double sine = cross.norm();
  arc.angle_rad = std::atan2(sine, a.tangent_in.dot(b.tangent_out));
  if (sine > 1e-4) {
    arc.normal = cross / sine;
  } else {  // straight on, or half a turn, whose plane the two arcs tell
    if (arc.angle_rad < 1.0) return std::nullopt;
    const Eigen::Vector3d between = a.normal + b.normal;
    arc.normal = (between - between.dot(a.tangent_in) * a.tangent_in).normalized();
  }
  if (a.angle_rad + b.angle_rad > std::numbers::pi && a.normal.dot(b.normal) > 0 &&
      arc.normal.dot(a.normal) < 0) {
    arc.angle_rad = 2.0 * std::numbers::pi - arc.angle_rad;
    arc.normal = -arc.normal;
  }
  // As long as both together; then the least change of radius and beginning with which it meets the
  // second line. (The corner of the two lines is nowhere for half a turn.)
  const double between_mm = (b.begin_mm - a.end_mm).norm();
  const double radius_mm =
      (a.radius_mm * a.angle_rad + b.radius_mm * b.angle_rad + between_mm) / arc.angle_rad;
  const Eigen::Vector3d inward = arc.normal.cross(a.tangent_in);
  const Eigen::Vector3d chord =  // of an arc of radius 1
      std::sin(arc.angle_rad) * a.tangent_in + (1.0 - std::cos(arc.angle_rad)) * inward;
  const Eigen::Vector3d across = arc.normal.cross(b.tangent_out);
  const Eigen::Vector2d feels(across.dot(a.tangent_in), across.dot(chord));
  const double off_mm = across.dot(b.end_mm - a.begin_mm - radius_mm * chord);
  const Eigen::Vector2d change = off_mm / feels.squaredNorm() * feels;
  arc.radius_mm = radius_mm + change[1];
  arc.begin_mm = a.begin_mm + change[0] * a.tangent_in;
  arc.end_mm = arc.begin_mm + arc.radius_mm * chord;
  if (!arc.begin_mm.allFinite() || !(arc.radius_mm > 0)) return std::nullopt;
  return arc;
}

ArcLineSpline WithoutArcs(const ArcLineSpline& spline, std::size_t first, std::size_t last) {
  ArcLineSpline without = spline;
  without.arcs.erase(without.arcs.begin() + static_cast<std::ptrdiff_t>(first),
                     without.arcs.begin() + static_cast<std::ptrdiff_t>(last) + 1);
  return without;
}

std::optional<ArcLineSpline> WithOneArc(const ArcLineSpline& spline, std::size_t first,
                                        std::size_t last) {
  const auto merged = MergedArc(spline.arcs[first], spline.arcs[last]);
  if (!merged) return std::nullopt;
  ArcLineSpline simpler = WithoutArcs(spline, first + 1, last);
  simpler.arcs[first] = *merged;
  return simpler;
}

std::array<SplineArc, 2> SplitArc(const SplineArc& arc) {
  const double half = 0.5 * arc.angle_rad;
  const double radius = kMoves.split_radius * arc.radius_mm;
  const double tangent_mm = std::tan(0.5 * half);
  const Eigen::Vector3d middle = Eigen::AngleAxisd(half, arc.normal) * arc.tangent_in;
  const Eigen::Vector3d corner1 = arc.begin_mm + arc.radius_mm * tangent_mm * arc.tangent_in;
  const Eigen::Vector3d corner2 = arc.end_mm - arc.radius_mm * tangent_mm * arc.tangent_out;
  const double reach_mm = radius * tangent_mm;
  return {SplineArc{corner1 - reach_mm * arc.tangent_in, corner1 + reach_mm * middle,
                    arc.tangent_in, middle, arc.normal, radius, half},
          SplineArc{corner2 - reach_mm * middle, corner2 + reach_mm * arc.tangent_out, middle,
                    arc.tangent_out, arc.normal, radius, half}};
}

std::vector<ArcLineSpline> WithBend(const ArcLineSpline& spline, const hal::Tube& tube,
                                    const MissingBend& missing, const SpinePolygon& polygon) {
  const auto segments = hal::SpineSegments(tube.program, tube.X_WT);
  const hal::SpineSegment& segment = segments[missing.segment];
  const std::size_t before = missing.segment / 2;  // arcs before the place
  std::vector<ArcLineSpline> list;
  const double near_mm = kMoves.near_arc * tube.pipe_radius_mm;
  const auto part = [&](std::size_t arc, double along_mm) {
    const Eigen::Vector3d at = segments[2 * arc + 1].PointAt(along_mm);
    const auto node = std::min_element(
        polygon.begin(), polygon.end(), [&at](const SpineNode& a, const SpineNode& b) {
          return (a.position_mm - at).squaredNorm() < (b.position_mm - at).squaredNorm();
        });
    SpineNode forward = *node;
    if (forward.tangent.dot(segments[2 * arc + 1].TangentAt(along_mm)) < 0) {
      forward.tangent = -forward.tangent;
    }
    if (const auto two = SplitVia(spline.arcs[arc], forward)) {
      ArcLineSpline with = spline;
      with.arcs[arc] = (*two)[0];
      with.arcs.insert(with.arcs.begin() + static_cast<std::ptrdiff_t>(arc) + 1, (*two)[1]);
      list.push_back(std::move(with));
    }
    list.push_back(WithArcParted(spline, arc, along_mm));
  };
  // In the line beside the arc, where it meets the arc or, in a short line, in its middle.
  const auto beside = [&](std::size_t line, bool at_its_end) {
    const double off_mm = std::min(tube.pipe_radius_mm, 0.5 * segments[line].length_mm);
    list.push_back(WithSmallBend(spline, line / 2, segments[line],
                                 at_its_end ? segments[line].length_mm - off_mm : off_mm,
                                 missing.turn_rad, tube.pipe_radius_mm));
  };
  if (segment.is_arc()) {
    const double middle_mm = 0.5 * segment.length_mm;
    if (missing.along_mm > 0) part(before, missing.along_mm);
    if (missing.along_mm <= 0 || std::abs(missing.along_mm - middle_mm) > near_mm) {
      part(before, middle_mm);
    }
    if (missing.along_mm < near_mm) beside(missing.segment - 1, true);
    if (segment.length_mm - missing.along_mm < near_mm) beside(missing.segment + 1, false);
    return list;
  }
  list.push_back(WithSmallBend(spline, before, segment, missing.along_mm, missing.turn_rad,
                               tube.pipe_radius_mm));
  if (missing.along_mm < near_mm && before > 0) {
    part(before - 1, 0.5 * segments[missing.segment - 1].length_mm);
  }
  if (segment.length_mm - missing.along_mm < near_mm && before < spline.arcs.size()) {
    part(before, 0.5 * segments[missing.segment + 1].length_mm);
  }
  return list;
}

}  // namespace bendloop::pipeline
