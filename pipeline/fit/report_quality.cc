// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/report_quality.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <span>
#include <string>
#include <vector>

#include "hal/angles.h"
#include "hal/spine.h"
#include "pipeline/math/text.h"
#include "pipeline/points/input_checks.h"
#include "pipeline/tube/easing.h"

namespace bendloop::pipeline {
namespace {

// When a result is doubted.
struct Doubts {
  // Margin of the structure where there was nothing to compare with: as sure as can be said in a
  // table.
  double most_margin = 1e6;
  // [sigma] Between two halves; of some twenty values the greatest is beyond 5 once in 10^5 scans.
  double halves_differ = 5.0;
  // [of r_P] 1 sigma of the pipe radius; tubes, noisy wires included, stay below 0.005.
  double vague_radius = 0.02;
  // [of r_P] 1 sigma of the distances; beyond it only noisy wires are tubes.
  double rough = 0.04;
  // [of r_P] A clamp does not hold a shorter straight between two bends.
  double clamped = 0.9;
  // [of r_P] Nor one that is hardly longer: a slight bend so near another one, and in its plane,
  // may be a part of it.
  double beside = 2.5, slight_deg = 5.0, in_plane_deg = 3.0, in_plane_sigmas = 2.5;
  // [of a straight's length] and [sigma] Bows of more: EN 10305-1 lets precision tube have 0.0015,
  // and benders leave L / 300, with one that changes sides on it.
  double bow = 1.0 / 220.0, bow_sigmas = 6.0;
  // [of r_P] and [times that of independent points] 1 sigma of the distances, and the variance of
  // what places have in common: a noisy wire is as rough, but place by place on its surface.
  double off_together = 0.05, together = 10.0;
  // [of 1 sigma that sides of straights which do not agree leave the pipe radius] Of an end, as
  // seen by passes that are displaced; from such tubes.
  double along_sides = 2.5;
  // [of r_P] Dents deeper than this are told as doubtful: on tubes that are sold they are less.
  double deep_dent = 0.21;
  // [of r_P] Before an end beyond which samples go on, a shorter straight may be more of the bend.
  double shows_direction = 2.0;
  // [of the usual samples a length] So few beyond a slight bend may be another part's of the tube.
  double sparse = 0.25;
  // [of r_P] So near beside the last bend a dent may be what looks like one.
  double dent_beside = 1.5;
  // [sigma] A bend of a smaller angle may be none.
  double least_bend = 1.5;
  // [of how far sides of straights disagree] What leads less far aside may be passes that were
  // displaced.
  double aside = 3.0;
};
constexpr Doubts kDoubts;

// What easings leave of the sigmas beyond what the fit says.
struct EasedSettings {
  // [of the easing's variance] Of bends that have no room to ease further, by this much more of it:
  // they run into each other, and what they ease over is not known.
  double crowded = 0.5, crowded_from = 1.1;
  // [of the variance that a Gaussian would have beyond the room there is] So much of it the fit may
  // have taken for more of the arc, or the other way round. By trial.
  double cut_off = 0.21;
  double widest_rad = 2.6;  // of wider bends the corner runs away
  double least_sine = 0.2;  // of slighter bends the plane is not known anyway
  double least = 0.1;       // [of r_P] Of less no straight loses its form
};
constexpr EasedSettings kEased;

// The place on the straight nearest to the node, from the straight's start [mm].
double AlongStraight(const hal::SpineSegment& straight, const Eigen::Vector3d& node_mm) {
  return std::clamp((node_mm - straight.start_mm).dot(straight.tangent), 0.0, straight.length_mm);
}

// How far an unseen end goes on nobody knows: the tube ends at the nodes.
void EndAtNodes(const TubeEnds& ends, const Eigen::Vector3d& first_node_mm,
                const Eigen::Vector3d& last_node_mm, hal::Tube& tube) {
  const auto segments = hal::SpineSegments(tube.program, tube.X_WT);
  if (!ends.last_seen) {
    tube.program.rows.back().length_mm = AlongStraight(segments.back(), last_node_mm);
  }
  if (!ends.first_seen) {
    const double unseen_mm = AlongStraight(segments.front(), first_node_mm);
    tube.X_WT.position_mm += unseen_mm * segments.front().tangent;
    tube.program.rows.front().length_mm -= unseen_mm;
  }
}

// A bend whose outer straight no sample shows, or too few, may go on behind what hides it.
void DoubtBend(std::size_t bend, const std::string& samples, Measurement& measurement) {
  double& sigma_deg = measurement.sigma.rows[bend].angle_deg;
  sigma_deg = std::max(sigma_deg, 0.5 * measurement.tube.program.rows[bend].angle_deg);
  measurement.warnings.push_back(samples +
                                 " straight: the bend beside it may be longer than seen; scan "
                                 "that end again");
}

// Where samples go on beyond the end found, what looks like the straight may be more of the bend.
void DoubtBendThatGoesOn(bool at_start, double fitting_mm, Measurement& measurement) {
  const auto& rows = measurement.tube.program.rows;
  const std::size_t bends = measurement.tube.program.bend_count();
  const double straight_mm = (at_start ? rows.front() : rows.back()).length_mm - fitting_mm;
  if (bends == 0 || straight_mm > kDoubts.shows_direction * measurement.tube.pipe_radius_mm) return;
  DoubtBend(at_start ? 0 : bends - 1,
            "too few samples on the " + std::string(at_start ? "first" : "last"), measurement);
}

// How far a bend's corner lies beside the line between the middles of its straights.
double AsideMm(const hal::BendProgram& program, std::size_t bend) {
  const hal::BendRow& row = program.rows[bend];
  const double turn = std::min(row.angle_deg, 90.0) / hal::kDegreesPerRadian;
  const double tangent_mm = row.bend_radius_mm.value_or(0.0) * std::tan(0.5 * turn);
  const double before_mm = tangent_mm + 0.5 * row.length_mm;
  const double after_mm = tangent_mm + 0.5 * program.rows[bend + 1].length_mm;
  return before_mm + after_mm > 0 ? before_mm * after_mm / (before_mm + after_mm) * turn : 0.0;
}

// Whether a bend has no room to ease further.
bool IsCrowded(const hal::BendProgram& program, const Easing& easing, std::size_t bend) {
  Easing more = easing;
  more.variance_mm2[bend] *= kEased.crowded_from;
  return EasingWithin(program, more).variance_mm2[bend] < 0.99 * more.variance_mm2[bend];
}

// 1 sigma of a bend's arc [mm] that a crowded easing leaves. Smoothed curvature tells the arc by
// its variance along the spine, which is arc^2 / 12 and that of the easing: what is not known of
// the one is not known of the other.
double ArcDoubtMm(const hal::BendProgram& program, const Easing& easing, std::size_t bend) {
  if (!IsCrowded(program, easing, bend)) return 0.0;
  const double variance_mm2 = easing.variance_mm2[bend];
  const double arc_mm = std::max(1e-3, program.rows[bend].bend_radius_mm.value_or(0.0) *
                                           program.rows[bend].angle_deg / hal::kDegreesPerRadian);
  // As much as the tube's other bends ease over.
  const double usual_mm2 =
      *std::max_element(easing.variance_mm2.begin(), easing.variance_mm2.end());
  const double unknown_mm2 = std::max(kEased.crowded * variance_mm2, usual_mm2 - variance_mm2);
  return std::min(6.0 * unknown_mm2 / arc_mm, std::sqrt(12.0 * unknown_mm2));
}

// Part of a Gaussian's variance that lies further from its middle than `z` standard deviations.
double VarianceBeyond(double z) {
  const double density = std::exp(-0.5 * z * z) / std::sqrt(2.0 * std::numbers::pi);
  return 2.0 * z * density + std::erfc(z / std::numbers::sqrt2);
}

// 1 sigma of a bend's radius [mm] that a kernel leaves which has no room for its tails: what those
// would turn the fit has given to arc and kernel.
std::vector<double> CutOffDoubtsMm(const hal::BendProgram& program, const Easing& easing) {
  const Easing within = EasingWithin(program, easing);
  std::vector<double> doubts_mm(program.bend_count(), 0.0);
  for (std::size_t i = 0; i < within.variance_mm2.size(); ++i) {
    const double variance_mm2 = within.variance_mm2[i];
    if (!(variance_mm2 > 0)) continue;
    const double unknown_mm2 = kEased.cut_off *
                               VarianceBeyond(within.room_of_mm(i) / std::sqrt(variance_mm2)) *
                               variance_mm2;
    const double angle = std::max(1e-3, program.rows[i].angle_deg / hal::kDegreesPerRadian);
    const double arc_mm = std::max(1e-3, program.rows[i].bend_radius_mm.value_or(0.0) * angle);
    doubts_mm[i] = std::min(6.0 * unknown_mm2 / arc_mm, std::sqrt(12.0 * unknown_mm2)) / angle;
  }
  return doubts_mm;
}

// The same of bends of one die: the more one turns, the more it has a say.
double OfAll(const hal::BendProgram& program, std::span<const double> doubts_mm) {
  double sum = 0, weights = 0;
  for (std::size_t i = 0; i < doubts_mm.size(); ++i) {
    const double weight = std::pow(program.rows[i].angle_deg, 4);
    sum += weight * doubts_mm[i];
    weights += weight;
  }
  return weights > 0 ? sum / weights : 0.0;
}

// How far [rad] bends turn the middle of a straight that is too short for what they ease over:
// there our kernel has to end, and nobody knows how the bend does. Of a bend whose curvature is
// smoothed over `sigma_mm` so much of its angle comes after `beyond_mm`.
double TailRad(double beyond_mm, double sigma_mm, double bend_radius_mm) {
  const double z = beyond_mm / sigma_mm;
  const double density = std::exp(-0.5 * z * z) / std::sqrt(2.0 * std::numbers::pi);
  return sigma_mm / bend_radius_mm * (density - 0.5 * z * std::erfc(z / std::numbers::sqrt2));
}

// Both straights beside a bend, by it.
std::vector<std::array<double, 2>> TailsRad(const hal::BendProgram& program, const Easing& easing) {
  const auto& variance_mm2 = easing.variance_mm2;
  std::vector<std::array<double, 2>> tails(program.bend_count(), {0.0, 0.0});
  if (variance_mm2.empty()) return tails;
  const double sigma_mm = std::sqrt(*std::max_element(variance_mm2.begin(), variance_mm2.end()));
  for (std::size_t i = 0; sigma_mm > 0 && i < tails.size(); ++i) {
    const double angle = program.rows[i].angle_deg / hal::kDegreesPerRadian;
    const double radius_mm = std::max(1e-3, program.rows[i].bend_radius_mm.value_or(0.0));
    for (const std::size_t side : {std::size_t{0}, std::size_t{1}}) {
      const double half_mm = 0.5 * program.rows[i + side].length_mm;
      tails[i][side] = std::min(TailRad(half_mm, sigma_mm, radius_mm), 0.5 * angle);
    }
  }
  return tails;
}

// A bend turns the straights beside it in its own plane, which changes its angle, and that of the
// next bend; their planes it tilts as far as they are not its own.
void WidenByTails(Measurement& measurement) {
  const hal::BendProgram& program = measurement.tube.program;
  const auto tails = TailsRad(program, measurement.easing);
  auto& rows = measurement.sigma.rows;
  const auto tail_deg = [&](std::size_t bend, std::size_t side) {
    return bend < tails.size() ? tails[bend][side] * hal::kDegreesPerRadian : 0.0;
  };
  for (std::size_t i = 0; i < tails.size(); ++i) {
    const double before_deg = i > 0 ? tail_deg(i - 1, 1) : 0.0, after_deg = tail_deg(i + 1, 0);
    const double own_deg = std::hypot(tail_deg(i, 0), tail_deg(i, 1));
    const double others_deg = std::hypot(before_deg, after_deg);
    rows[i].angle_deg = std::hypot(rows[i].angle_deg, own_deg, others_deg);
    const double sine = std::sin(program.rows[i].angle_deg / hal::kDegreesPerRadian);
    const auto across = [&](std::size_t row) {
      return row < tails.size()
                 ? std::abs(std::sin(program.rows[row].rotation_deg / hal::kDegreesPerRadian))
                 : 0.0;
    };
    const double plane_deg = std::hypot(before_deg * across(i), after_deg * across(i + 1)) /
                             std::max(kEased.least_sine, sine);
    // Of the rotations before and after it.
    if (i > 0) rows[i].rotation_deg = std::hypot(rows[i].rotation_deg, plane_deg);
    if (i + 1 < tails.size()) {
      rows[i + 1].rotation_deg = std::hypot(rows[i + 1].rotation_deg, plane_deg);
    }
  }
}

// What bends ease over that have no room to, nobody knows. The corner stays, and the tangent points
// move along the straights beside it; of one die all the same way.
void WidenByEasing(bool radii_alike, Measurement& measurement) {
  auto& rows = measurement.sigma.rows;
  const hal::BendProgram& program = measurement.tube.program;
  const std::size_t bends = std::min(measurement.easing.variance_mm2.size(), program.bend_count());
  std::vector<double> more_mm(rows.size(), 0.0), radius_mm(bends, 0.0);
  const auto angle = [&](std::size_t i) {
    return std::max(1e-3, program.rows[i].angle_deg / hal::kDegreesPerRadian);
  };
  for (std::size_t i = 0; i < bends; ++i) {
    radius_mm[i] = ArcDoubtMm(program, measurement.easing, i) / angle(i);
  }
  std::vector<double> cut_off_mm = CutOffDoubtsMm(program, measurement.easing);
  if (radii_alike && bends > 0) {
    cut_off_mm.assign(cut_off_mm.size(), OfAll(program, cut_off_mm));
    // One that had to ease less than it would have leads all of them astray.
    radius_mm.assign(bends, *std::max_element(radius_mm.begin(), radius_mm.end()));
  }
  for (std::size_t i = 0; i < bends; ++i) {
    radius_mm[i] = std::hypot(radius_mm[i], cut_off_mm[i]);
    if (rows[i].bend_radius_mm) {
      rows[i].bend_radius_mm = std::hypot(*rows[i].bend_radius_mm, radius_mm[i]);
    }
    const double tangent_mm = radius_mm[i] * std::tan(0.5 * std::min(angle(i), kEased.widest_rad));
    for (const std::size_t beside : {i, i + 1}) {
      more_mm[beside] =
          radii_alike ? more_mm[beside] + tangent_mm : std::hypot(more_mm[beside], tangent_mm);
    }
  }
  for (std::size_t i = 0; i < rows.size(); ++i) {
    rows[i].length_mm = std::hypot(rows[i].length_mm, more_mm[i]);
  }
}

// A bend that is dented, or eases further than its arc is long, looks like two with next to nothing
// between them, or like one with a slight one beside it, in its plane.
bool LooksLikeOne(const SurfaceFit& fit, std::size_t bend) {
  const auto& rows = fit.tube.program.rows;
  const double straight = rows[bend].length_mm / fit.tube.pipe_radius_mm;
  if (straight < kDoubts.clamped) return true;
  const double in_plane_deg =
      std::max(kDoubts.in_plane_deg, kDoubts.in_plane_sigmas * fit.sigma.rows[bend].rotation_deg);
  return straight < kDoubts.beside &&
         std::min(rows[bend - 1].angle_deg, rows[bend].angle_deg) < kDoubts.slight_deg &&
         std::abs(rows[bend].rotation_deg) < in_plane_deg;
}

void DoubtBendUponBend(const SurfaceFit& fit, Measurement& measurement) {
  for (std::size_t i = 1; i < fit.tube.program.bend_count(); ++i) {
    if (!LooksLikeOne(fit, i)) continue;
    measurement.warnings.push_back(
        "bends " + std::to_string(i) + " and " + std::to_string(i + 1) + " have " +
        Mm(std::max(0.0, fit.tube.program.rows[i].length_mm)) +
        " of straight between them, too little for a clamp: they may be one, dented or eased; "
        "compare the number of bends with the drawing");
    return;
  }
}

// Curvature that rises and falls all along has no straights: lines between such bends are nowhere
// on the tube.
void DoubtStraights(std::span<const StraightForm> straights, Measurement& measurement) {
  const bool is_any = std::any_of(straights.begin(), straights.end(),
                                  [](const StraightForm& of) { return of.length_mm > 0; });
  const double least_mm2 = std::pow(kEased.least * measurement.tube.pipe_radius_mm, 2);
  const auto eases = [least_mm2](double variance_mm2) { return variance_mm2 > least_mm2; };
  const auto& variance_mm2 = measurement.easing.variance_mm2;
  if (is_any || std::none_of(variance_mm2.begin(), variance_mm2.end(), eases)) return;
  measurement.warnings.push_back(
      "the bends ease over all of the straights between them: the tube may be bent freely, as a "
      "hose is, and its rows are of lines that no part of it follows; compare it with the drawing");
}

}  // namespace

bool LiesOffTogether(const SurfaceFit& fit) {
  return fit.sigma_mm > kDoubts.off_together * fit.tube.pipe_radius_mm &&
         fit.design_effect > kDoubts.together;
}

hal::Result<void> CheckShowsTube(const SurfaceFit& fit) {
  const double r_mm = fit.tube.pipe_radius_mm;
  if (fit.tube.program.bend_count() == 0 && LiesOffTogether(fit)) {
    return hal::Fail(hal::ErrorKind::kBadInput,
                     "no tube: the points lie " + Mm(fit.sigma_mm) +
                         " (1 sigma) off one of pipe radius " + Mm(r_mm) +
                         ", those of a place together: a coil, a flat or another shape");
  }
  if (fit.pipe_radius_sigma_mm < kDoubts.vague_radius * r_mm ||
      fit.sigma_mm < kDoubts.rough * r_mm) {
    return {};
  }
  return hal::Fail(hal::ErrorKind::kBadInput, "no tube: the points lie " + Mm(fit.sigma_mm) +
                                                  " (1 sigma) off one of pipe radius " + Mm(r_mm) +
                                                  " and tell that only to " +
                                                  Mm(fit.pipe_radius_sigma_mm) + kCloserLines);
}

void ReportQuality(const SurfaceFit& structure, const SurfaceFit& fit, const HalvesDiffer& halves,
                   std::optional<std::size_t> nominal_bends, Measurement& measurement) {
  const double r_mm = fit.tube.pipe_radius_mm;
  const std::size_t bends = fit.tube.program.bend_count();
  if (nominal_bends && bends != *nominal_bends) {
    measurement.warnings.push_back("the samples show " + std::to_string(bends) +
                                   " bends, the nominal has " + std::to_string(*nominal_bends) +
                                   ": another part, or one that was bent wrongly");
  }
  if (!nominal_bends) DoubtBendUponBend(fit, measurement);
  for (std::size_t i = 0; i < fit.flattening.size(); ++i) {
    const Flattening& f = fit.flattening[i];
    const FlatteningSigma& sigma = fit.flattening_sigma[i];
    measurement.bend_shapes.push_back({100.0 * f.OvalityPart(), 100.0 * sigma.ovality_part,
                                       r_mm * f.OuterWallPart(), r_mm * sigma.outer_wall_part});
  }
  measurement.flattening = fit.flattening;
  measurement.easing = EasingWithin(fit.tube.program, fit.easing);
  for (std::size_t i = 0; i < fit.easing.variance_mm2.size(); ++i) {
    const double length_mm = std::sqrt(12.0 * measurement.easing.variance_mm2[i]);
    measurement.bend_easings.push_back(
        {length_mm, 6.0 * fit.easing_sigma_mm2[i] / std::max(1e-9, length_mm)});
  }
  measurement.structure_margin = std::clamp(structure.margin, 0.0, kDoubts.most_margin);
  if (measurement.structure_margin < kCloseCall) {
    measurement.warnings.push_back(
        "the number of bends is a close call (margin " + Fixed(measurement.structure_margin, 1) +
        ", clear from 10 on): " +
        (nominal_bends == bends ? "it is the nominal's, which the samples alone do not show"
                                : "compare it with the drawing, or scan again with more points"));
  }
  if (LiesOffTogether(fit)) {
    measurement.warnings.push_back("the points lie " + Mm(fit.sigma_mm) +
                                   " (1 sigma) off the tube, those of a place together: "
                                   "this is no tube of lines and arcs, and its values are as "
                                   "uncertain as that. Nothing is told "
                                   "of cuts and holes.");
  }
  measurement.halves_differ_sigma = halves.sigmas;
  if (halves.sigmas > kDoubts.halves_differ) {
    measurement.warnings.push_back("two halves of the samples disagree on the " + halves.what +
                                   " (" + Fixed(halves.sigmas, 1) + " sigma): scan again");
  }
}

void ReportEnds(const SurfaceFit& fit, const TubeEnds& ends, const Eigen::Vector3d& first_node_mm,
                const Eigen::Vector3d& last_node_mm, Measurement& measurement) {
  measurement.tube = ends.tube;
  EndAtNodes(ends, first_node_mm, last_node_mm, measurement.tube);
  measurement.sigma = fit.sigma;
  auto& sigma_rows = measurement.sigma.rows;
  if (sigma_rows.size() == 1) {
    sigma_rows.front().length_mm = std::hypot(ends.first_sigma_mm, ends.last_sigma_mm);
  } else {
    sigma_rows.front().length_mm = std::hypot(sigma_rows.front().length_mm, ends.first_sigma_mm);
    sigma_rows.back().length_mm = std::hypot(sigma_rows.back().length_mm, ends.last_sigma_mm);
  }
  const std::size_t bends = measurement.tube.program.bend_count();
  if (bends > 0 && !ends.first_seen) DoubtBend(0, "no samples on the first", measurement);
  if (bends > 0 && !ends.last_seen) DoubtBend(bends - 1, "no samples on the last", measurement);
}

void ReportEndForm(bool at_start, const FoundEnd& found, Measurement& measurement) {
  const EndForm& form = found.form;
  (at_start ? measurement.first_end : measurement.last_end) = form;
  const std::string which = at_start ? "first" : "last";
  auto& rows = measurement.tube.program.rows;
  const std::size_t row = at_start ? 0 : rows.size() - 1;
  double& sigma_mm = measurement.sigma.rows[row].length_mm;
  if (form.length_mm > 0) {
    if (at_start) {
      hal::Pose& X_WT = measurement.tube.X_WT;
      X_WT.position_mm -= form.length_mm * (X_WT.orientation * Eigen::Vector3d::UnitX());
    }
    rows[row].length_mm += form.length_mm;
    sigma_mm = std::hypot(sigma_mm, found.sigma_mm);
    measurement.warnings.push_back(
        "something thicker than the tube sits on its " + which + " end: " + Mm(form.length_mm) +
        " long, " + Mm(form.outside_mm) +
        " proud; the length is up to its end, the plain tube ends that much before");
  }
  if (form.continues_mm > 0) {
    sigma_mm = std::hypot(sigma_mm, form.continues_mm);
    measurement.warnings.push_back("samples go on for " + Mm(form.continues_mm) + " beyond the " +
                                   which +
                                   " end found, too thin to follow: scan that end again, or take "
                                   "away what is there");
    DoubtBendThatGoesOn(at_start, form.length_mm, measurement);
  }
}

void ReportForm(const SurfaceForm& form, bool radii_alike, Measurement& measurement) {
  measurement.straights = form.straights;
  DoubtStraights(form.straights, measurement);
  for (std::size_t i = 0; i < form.straights.size(); ++i) {
    const StraightForm& straight = form.straights[i];
    if (straight.height_mm < kDoubts.bow_sigmas * straight.sigma_mm ||
        straight.height_mm < kDoubts.bow * straight.length_mm || !(straight.length_mm > 0)) {
      continue;
    }
    measurement.warnings.push_back(
        "straight " + std::to_string(i + 1) + " bows by " + Mm(straight.height_mm) + " (L/" +
        std::to_string(std::lround(straight.length_mm / straight.height_mm)) +
        "), more than benders leave: it may hide a slight bend; compare the number of bends with "
        "the drawing");
  }
  WidenByEasing(radii_alike, measurement);
  WidenByTails(measurement);
  measurement.dents = form.dents;
  // What moves sides of straights across moves what is scanned with them along, too.
  for (hal::BendRow* end : {&measurement.sigma.rows.front(), &measurement.sigma.rows.back()}) {
    end->length_mm = std::hypot(end->length_mm, kDoubts.along_sides * std::sqrt(form.sides_mm2));
  }
  measurement.pipe_radius_sigma_mm =
      std::hypot(measurement.pipe_radius_sigma_mm, std::sqrt(form.sides_mm2));
}

void SayUnsureBends(double sides_mm, Measurement& measurement) {
  const auto& rows = measurement.tube.program.rows;
  for (std::size_t i = 0; i + 1 < rows.size(); ++i) {
    const double sigma_deg = measurement.sigma.rows[i].angle_deg;
    const std::string turn = "bend " + std::to_string(i + 1) + " turns by " +
                             Fixed(rows[i].angle_deg, 2) + " +- " + Fixed(sigma_deg, 2) +
                             " degrees";
    constexpr const char* kMayBeNone =
        ": it may be none; compare the number of bends with the drawing, or scan again ";
    if (rows[i].angle_deg < kDoubts.least_bend * sigma_deg) {
      measurement.warnings.push_back(turn + kMayBeNone + "with more points");
    } else if (const double aside_mm = AsideMm(measurement.tube.program, i);
               aside_mm < kDoubts.aside * sides_mm) {
      measurement.warnings.push_back(turn + ", which leads " + Mm(aside_mm) +
                                     " aside, hardly more than the sides of the tube disagree by" +
                                     kMayBeNone + "in one pass");
    }
  }
}

void SayDoubtfulEndBends(const SurfaceFit& fit, std::optional<std::size_t> nominal_bends,
                         Measurement& measurement) {
  const auto& rows = measurement.tube.program.rows;
  const std::size_t bends = measurement.tube.program.bend_count();
  if (bends == 0 || nominal_bends == bends || fit.segment_used.empty()) return;
  const double r_mm = measurement.tube.pipe_radius_mm;
  const auto segments = hal::SpineSegments(measurement.tube.program, measurement.tube.X_WT);
  const EasedSpine eased = SpineOf(measurement.tube.program, measurement.tube.X_WT, fit.easing);
  const double usual_per_mm =
      static_cast<double>(fit.used) / std::max(r_mm, hal::SpineLength(fit.tube.program));
  for (const bool at_start : {true, false}) {
    const std::size_t bend = at_start ? 0 : bends - 1;
    const double leg_mm = (at_start ? rows.front() : rows.back()).length_mm;
    const double used = at_start ? fit.segment_used.front() : fit.segment_used.back();
    const std::string turn = "bend " + std::to_string(bend + 1) + " turns by " +
                             Fixed(rows[bend].angle_deg, 2) + " degrees, and ";
    // Of a short one what the bend eases into it is not told from it.
    const double straight_mm =
        (at_start ? eased.segments.front() : eased.segments.back()).length_mm;
    if (rows[bend].angle_deg < kDoubts.slight_deg && straight_mm > kDoubts.shows_direction * r_mm &&
        used < kDoubts.sparse * usual_per_mm * straight_mm) {
      measurement.warnings.push_back(
          turn + "next to no samples show the straight beyond it: the tube may end before it");
      continue;
    }
    const hal::SpineSegment& arc = segments[2 * bend + 1];
    const double near_mm = kDoubts.dent_beside * r_mm;
    const bool is_dented =
        std::any_of(measurement.dents.begin(), measurement.dents.end(), [&](const DentFound& dent) {
          return dent.along_mm > arc.from_start_mm - near_mm &&
                 dent.along_mm < arc.from_start_mm + arc.length_mm + near_mm;
        });
    if (is_dented && leg_mm < kDoubts.shows_direction * r_mm) {
      measurement.warnings.push_back(turn + "a dent lies there, " + Mm(leg_mm) +
                                     " before the tube's end: it may be none; compare the number "
                                     "of bends with the drawing");
    }
  }
}

void SayDeepDents(Measurement& measurement) {
  const double r_mm = measurement.tube.pipe_radius_mm;
  for (const DentFound& dent : measurement.dents) {
    if (dent.depth_mm < kDoubts.deep_dent * r_mm) continue;
    measurement.warnings.push_back(
        "a dent at " + Mm(dent.along_mm) + " is " + Mm(dent.depth_mm) +
        " deep, more than a fifth of the pipe radius: it may hide a bend that was not found; look "
        "at "
        "the tube there, and compare the number of bends with the drawing");
    return;
  }
}

void ReportPasses(const Registration& registration, const PassDrift& drift,
                  Measurement& measurement) {
  measurement.passes = registration.passes;
  const auto furthest = FurthestPass(measurement.passes, drift);
  if (!furthest || !furthest->is_moved()) return;
  measurement.warnings.push_back(furthest->Text() + ": " + kMovedTube);
}

}  // namespace bendloop::pipeline
