// SPDX-License-Identifier: Apache-2.0
#include "pipeline/structure.h"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <optional>

#include "pipeline/arc_line_spline.h"
#include "pipeline/simplify.h"
#include "pipeline/statistics.h"
#include "pipeline/structure_score.h"

namespace bendloop::pipeline {
namespace {

// Tolerances of the simplification, in pipe radii; the arcs get twice as much (section 4.5 gives
// both the same, but the simplified vertices already used up one).
constexpr std::array<double, 3> kTolerances = {0.04, 0.08, 0.16};
constexpr double kArcTolerance = 2.0;
constexpr double kReach = 0.35;  // of r_P: how far a sample may be from a wrong model
// The price of a parameter is this many times the criterion's log(n) variances: systematic errors
// reach further than the blocks in which they are estimated.
constexpr double kPrice = 1.2;
// Two straights joined by less than this are one, unless the samples insist.
constexpr double kSlightDeg = 1.0;
constexpr double kSlightPrice = 8;  // in parameters, above those of the bend
constexpr double kTruncated = 6.0;  // sigma
constexpr double kDropAngleDeg = 3.0;
constexpr double kSplitRadius = 0.4;  // of the old arc's
constexpr double kSuspicious = 1.5;   // mean square of an arc's distances over the median segment's
constexpr std::size_t kMaxSplits = 4;
constexpr std::size_t kMaxAdded = 16;  // bends
constexpr int kMaxCycles = 3;          // of adding and simplifying
constexpr double kAsk = 20.0;          // gain, in variances, at which one more bend is tried
constexpr int kMaxTries = 4;           // places
constexpr double kNearArc = 1.5;       // of r_P: a place from where the arc beside it is meant too
// A bend with less than this beyond it (arc and straight, in pipe radii) cannot be told from the
// cap, burr or fixture at the border of a scan: the tube goes straight on there.
constexpr double kBorder = 1.0;
constexpr double kTightBorder = 2.0;
constexpr double kTight = 1.05;          // bend radius, in pipe radii: where the fit is held
constexpr double kDoubtfulBorder = 8.0;  // up to here the samples are asked
// The number of bends does not need every sample; the comparison sees at most about so many.
constexpr std::size_t kEnoughSamples = 8000;
constexpr std::size_t kAllSamples = 60'000;
// The live view has milliseconds: one tolerance, few samples, no comparisons.
constexpr double kGlanceTolerance = 0.1;
constexpr std::size_t kGlanceSamples = 2000;
constexpr int kSteps = 15;
constexpr double kTolerance = 3e-4;  // of chi square, far below the price of a parameter

// Vertices and tangent lines of the simplified polygon. A line follows the nodes under its edge
// where there are enough of them, which steadies it against the noise of the two end nodes.
ArcLineSpline InitialSpline(const SpinePolygon& polygon, double epsilon_mm) {
  std::vector<Eigen::Vector3d> chain;
  chain.reserve(polygon.size());
  for (const SpineNode& node : polygon) chain.push_back(node.position_mm);
  const std::vector<std::size_t> kept = Simplify(chain, epsilon_mm);
  std::vector<Eigen::Vector3d> vertices;
  std::vector<TangentLine> tangents;
  for (const std::size_t k : kept) vertices.push_back(chain[k]);
  for (std::size_t e = 0; e + 1 < kept.size(); ++e) {
    const Eigen::Vector3d chord = (vertices[e + 1] - vertices[e]).normalized();
    TangentLine line{vertices[e], chord};
    if (kept[e + 1] - kept[e] >= 8) {
      Eigen::Vector3d mean = Eigen::Vector3d::Zero();
      Eigen::Matrix3d outer = Eigen::Matrix3d::Zero();
      double count = 0;
      for (std::size_t k = kept[e] + 1; k < kept[e + 1]; ++k) {
        mean += chain[k];
        outer += chain[k] * chain[k].transpose();
        ++count;
      }
      mean /= count;
      Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen;
      eigen.computeDirect(outer / count - mean * mean.transpose());
      Eigen::Vector3d direction = eigen.eigenvectors().col(2);
      if (direction.dot(chord) < 0) direction = -direction;
      if (direction.dot(chord) > 0.99) {
        line = {mean + (vertices[e] - mean).dot(direction) * direction, direction};
      }
    }
    tangents.push_back(line);
  }
  return ApproximateByArcLineSpline(vertices, tangents, kArcTolerance * epsilon_mm);
}

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

// Takes the last bend away if it and the straight beyond it are shorter than `border_mm`: the
// straight before it goes on as far.
bool DropLast(ArcLineSpline& spline, double border_mm) {
  if (spline.arcs.empty()) return false;
  const SplineArc& last = spline.arcs.back();
  const double beyond_mm = last.radius_mm * last.angle_rad + (spline.end_mm - last.end_mm).norm();
  if (beyond_mm >= border_mm) return false;
  spline.end_mm = last.begin_mm + beyond_mm * last.tangent_in;
  spline.arcs.pop_back();
  return true;
}

// The same at the start.
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

// Without bends that only the border of the samples pretends; false: there were none. Around a cap
// they are as tight as the pipe is thick, which no machine bends.
bool TrimBorders(ArcLineSpline& spline, double pipe_radius_mm) {
  const auto border_mm = [pipe_radius_mm](const SplineArc& arc) {
    return (arc.radius_mm < kTight * pipe_radius_mm ? kTightBorder : kBorder) * pipe_radius_mm;
  };
  bool trimmed = false;
  while (!spline.arcs.empty() && DropLast(spline, border_mm(spline.arcs.back()))) trimmed = true;
  while (!spline.arcs.empty() && DropFirst(spline, border_mm(spline.arcs.front()))) trimmed = true;
  return trimmed;
}

// One arc in place of two that follow each other.
std::optional<SplineArc> MergedArc(const SplineArc& a, const SplineArc& b) {
  SplineArc arc;
  arc.tangent_in = a.tangent_in;
  arc.tangent_out = b.tangent_out;
  const Eigen::Vector3d cross = a.tangent_in.cross(b.tangent_out);
  const double sine = cross.norm();
  if (sine < 1e-4) return std::nullopt;
  arc.angle_rad = std::atan2(sine, a.tangent_in.dot(b.tangent_out));
  arc.normal = cross / sine;
  if (a.angle_rad + b.angle_rad > std::numbers::pi && a.normal.dot(b.normal) > 0 &&
      arc.normal.dot(a.normal) < 0) {
    arc.angle_rad = 2.0 * std::numbers::pi - arc.angle_rad;
    arc.normal = -arc.normal;
  }
  // Where the two outer lines come nearest to each other is the corner; the arc is as far from it
  // as the outer touching points are on the average.
  const Eigen::Vector3d w = b.end_mm - a.begin_mm;
  const double c = a.tangent_in.dot(b.tangent_out);
  const double det = 1.0 - c * c;
  const double u = (w.dot(a.tangent_in) - c * w.dot(b.tangent_out)) / det;
  const double v = (c * w.dot(a.tangent_in) - w.dot(b.tangent_out)) / det;
  const double tangent_mm = 0.5 * (u - v);  // v is negative: before the end
  arc.radius_mm = std::abs(tangent_mm / std::tan(0.5 * arc.angle_rad));
  arc.begin_mm = a.begin_mm + (u - tangent_mm) * a.tangent_in;
  arc.end_mm = b.end_mm + (v + tangent_mm) * b.tangent_out;
  if (!arc.begin_mm.allFinite() || !(arc.radius_mm > 0)) return std::nullopt;
  return arc;
}

// Two arcs of half the angle in place of one, with a straight between them that touches the old arc
// in its middle.
std::array<SplineArc, 2> SplitArc(const SplineArc& arc) {
  const double half = 0.5 * arc.angle_rad;
  const double radius = kSplitRadius * arc.radius_mm;
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
  arc.angle_rad = std::clamp(across.norm(), 1e-3, 0.5);
  arc.normal = across.normalized();
  const Eigen::Matrix3d turn = Eigen::AngleAxisd(arc.angle_rad, arc.normal).toRotationMatrix();
  arc.tangent_out = turn * arc.tangent_in;
  arc.radius_mm = radii.empty()
                      ? 3.0 * pipe_radius_mm
                      : std::clamp(Median(radii), 1.5 * pipe_radius_mm, 8.0 * pipe_radius_mm);
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

// Splines with one bend more, to start the fit from.
std::vector<ArcLineSpline> WithBend(const ArcLineSpline& spline, const hal::Tube& tube,
                                    const MissingBend& missing, const SpinePolygon& polygon) {
  const auto segments = hal::SpineSegments(tube.program, tube.X_WT);
  const hal::SpineSegment& segment = segments[missing.segment];
  const std::size_t before = missing.segment / 2;  // arcs before the place
  std::vector<ArcLineSpline> list;
  const double near_mm = kNearArc * tube.pipe_radius_mm;
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
  if (segment.is_arc()) {
    const double middle_mm = 0.5 * segment.length_mm;
    if (missing.along_mm > 0) part(before, missing.along_mm);
    if (std::abs(missing.along_mm - middle_mm) > near_mm) part(before, middle_mm);
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

class Search {
 public:
  Search(const SpinePolygon& polygon, double pipe_radius_mm, std::span<const PointBlock> blocks,
         std::size_t enough_samples)
      : radius_mm_(pipe_radius_mm),
        polygon_(&polygon),
        blocks_(Thinned(blocks, CountPoints(blocks) / enough_samples + 1)),
        samples_(blocks_.point_count()) {}

  SurfaceFit Glance(const SpinePolygon& polygon) const {
    return Fit(TubeFromSpline(InitialSpline(polygon, kGlanceTolerance * radius_mm_), radius_mm_));
  }

  SurfaceFit Run(const SpinePolygon& polygon) {
    std::optional<SurfaceFit> best;
    std::size_t last_bends = static_cast<std::size_t>(-1);
    for (const double tolerance : kTolerances) {
      const hal::Tube tube =
          TubeFromSpline(InitialSpline(polygon, tolerance * radius_mm_), radius_mm_);
      if (best && tube.program.bend_count() == last_bends) continue;
      last_bends = tube.program.bend_count();
      SurfaceFit fit = Fit(tube);
      if (!best || IsBetter(fit, *best)) best = std::move(fit);
    }
    // Adding first: what was one by mistake is found before what is two by mistake is joined.
    for (std::size_t i = 0; i < kMaxSplits && Split(*best); ++i) {
    }
    Refine(*best);
    return *best;
  }

  // Adds what the samples ask for and takes away what they do not mind to lose.
  void Refine(SurfaceFit& best) const {
    for (int cycle = 0; cycle < kMaxCycles; ++cycle) {
      bool added = false;
      for (std::size_t i = 0; i < kMaxAdded && Added(best); ++i) added = true;
      if (cycle > 0 && !added) break;
      while (Simplified(best)) {
      }
    }
  }

  // The same tube with the samples of this search.
  SurfaceFit Again(const SurfaceFit& fit) const { return Fit(fit.tube); }

 private:
  SurfaceFit Fit(const hal::Tube& tube) const {
    SurfaceFit fit = FitOnce(tube);
    ArcLineSpline spline = SplineFromTube(fit.tube);
    if (TrimBorders(spline, radius_mm_)) {
      fit = FitOnce(TubeFromSpline(spline, fit.tube.pipe_radius_mm));
    }
    return fit;
  }

  SurfaceFit FitOnce(const hal::Tube& tube) const {
    return FitSurface(
        tube, blocks_,
        {.reach_mm = kReach * radius_mm_, .max_steps = kSteps, .tolerance = kTolerance});
  }

  // Bayesian information criterion, the variance taken from the better fit of the two. Every sample
  // costs at most kTruncated sigma: what neither model explains must not decide between them.
  bool IsBetter(const SurfaceFit& a, const SurfaceFit& b) const {
    const double variance = std::min(a.sigma_mm * a.sigma_mm * a.design_effect,
                                     b.sigma_mm * b.sigma_mm * b.design_effect);
    const double price = kPrice * std::log(static_cast<double>(samples_)) * variance;
    const double limit_mm = kTruncated * std::min(a.sigma_mm, b.sigma_mm);
    return Cost(a, limit_mm) + Parameters(a) * price < Cost(b, limit_mm) + Parameters(b) * price;
  }

  static double Parameters(const SurfaceFit& fit) {
    double count = fit.parameters;
    for (std::size_t i = 0; i < fit.tube.program.bend_count(); ++i) {
      if (fit.tube.program.rows[i].angle_deg < kSlightDeg) count += kSlightPrice;
    }
    return count;
  }

  static double Cost(const SurfaceFit& fit, double limit_mm) {
    double cost = static_cast<double>(fit.points - fit.distances_mm.size()) * limit_mm * limit_mm;
    for (const double d : fit.distances_mm) cost += std::min(d * d, limit_mm * limit_mm);
    return cost;
  }

  // Splits the arc that explains its samples worst, if two arcs do so better. False: none does.
  bool Split(SurfaceFit& fit) const {
    const ArcLineSpline spline = SplineFromTube(fit.tube);
    const double suspicious = kSuspicious * Median(fit.segment_mean_square_mm2);
    std::vector<std::pair<double, std::size_t>> worst;
    for (std::size_t i = 0; i < spline.arcs.size(); ++i) {
      const double mean_square = fit.segment_mean_square_mm2[2 * i + 1];
      if (mean_square > suspicious) worst.emplace_back(-mean_square, i);
    }
    std::sort(worst.begin(), worst.end());
    for (const auto& [mean_square, i] : worst) {
      ArcLineSpline finer = spline;
      const auto arcs = SplitArc(spline.arcs[i]);
      finer.arcs[i] = arcs[0];
      finer.arcs.insert(finer.arcs.begin() + static_cast<std::ptrdiff_t>(i) + 1, arcs[1]);
      SurfaceFit candidate = Fit(TubeFromSpline(finer, fit.tube.pipe_radius_mm));
      if (!IsBetter(candidate, fit)) continue;
      fit = std::move(candidate);
      return true;
    }
    return false;
  }

  // One bend more where the samples ask for it most. False: they are content.
  bool Added(SurfaceFit& fit) const {
    const ArcLineSpline spline = SplineFromTube(fit.tube);
    int tries = 0;
    for (const MissingBend& missing : FindMissingBends(fit, blocks_, kReach * radius_mm_)) {
      if (missing.gain < kAsk || ++tries > kMaxTries) return false;
      for (const ArcLineSpline& with : WithBend(spline, fit.tube, missing, *polygon_)) {
        SurfaceFit candidate = Fit(TubeFromSpline(with, fit.tube.pipe_radius_mm));
        if (!IsBetter(candidate, fit)) continue;
        fit = std::move(candidate);
        return true;
      }
    }
    return false;
  }

  // One step: the cheapest merge or drop that is no worse. False: none is.
  bool Simplified(SurfaceFit& fit) const {
    const ArcLineSpline spline = SplineFromTube(fit.tube);
    std::optional<SurfaceFit> best;
    const auto consider = [&](const ArcLineSpline& simpler) {
      SurfaceFit candidate = Fit(TubeFromSpline(simpler, fit.tube.pipe_radius_mm));
      if (IsBetter(candidate, fit) && (!best || IsBetter(candidate, *best))) {
        best = std::move(candidate);
      }
    };
    for (std::size_t i = 0; i < spline.arcs.size(); ++i) {
      for (std::size_t j = i + 1; j < std::min(i + 3, spline.arcs.size()); ++j) {
        const auto merged = MergedArc(spline.arcs[i], spline.arcs[j]);
        if (!merged) continue;
        ArcLineSpline simpler = spline;
        simpler.arcs[i] = *merged;
        simpler.arcs.erase(simpler.arcs.begin() + static_cast<std::ptrdiff_t>(i) + 1,
                           simpler.arcs.begin() + static_cast<std::ptrdiff_t>(j) + 1);
        consider(simpler);
      }
      // Bends that undo each other, as nodes disturbed by a clamp pretend them.
      for (std::size_t j = i; j < std::min(i + 4, spline.arcs.size()); ++j) {
        const double turn = std::acos(
            std::clamp(spline.arcs[i].tangent_in.dot(spline.arcs[j].tangent_out), -1.0, 1.0));
        if (turn * 180.0 / std::numbers::pi > kDropAngleDeg) continue;
        ArcLineSpline simpler = spline;
        simpler.arcs.erase(simpler.arcs.begin() + static_cast<std::ptrdiff_t>(i),
                           simpler.arcs.begin() + static_cast<std::ptrdiff_t>(j) + 1);
        consider(simpler);
      }
    }
    // A bend near the border that clutter beside it pretends: the tube that goes straight on.
    const double border_mm = kDoubtfulBorder * radius_mm_;
    ArcLineSpline without = spline;
    if (DropLast(without, border_mm)) consider(without);
    without = spline;
    if (DropFirst(without, border_mm)) consider(without);
    if (!best) return false;
    fit = std::move(*best);
    return true;
  }

  double radius_mm_;
  const SpinePolygon* polygon_;
  OwnedBlocks blocks_;
  std::size_t samples_;
};

}  // namespace

SurfaceFit GlanceAtStructure(const SpinePolygon& polygon, double pipe_radius_mm,
                             std::span<const PointBlock> blocks) {
  return Search(polygon, pipe_radius_mm, blocks, kGlanceSamples).Glance(polygon);
}

SurfaceFit FindStructure(const SpinePolygon& polygon, double pipe_radius_mm,
                         std::span<const PointBlock> blocks) {
  SurfaceFit fit = Search(polygon, pipe_radius_mm, blocks, kEnoughSamples).Run(polygon);
  std::size_t samples = 0;
  for (const PointBlock& block : blocks) samples += block.points.size();
  if (samples <= kEnoughSamples) return fit;
  // Small bends are seen in more samples than the way there needed.
  const Search fine(polygon, pipe_radius_mm, blocks, kAllSamples);
  fit = fine.Again(fit);
  fine.Refine(fit);
  return fit;
}

}  // namespace bendloop::pipeline
