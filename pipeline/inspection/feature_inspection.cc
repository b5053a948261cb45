// SPDX-License-Identifier: Apache-2.0
#include "pipeline/inspection/feature_inspection.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "hal/angles.h"
#include "hal/bend_program.h"

namespace bendloop::pipeline {
namespace {

struct FeatureSettings {
  // An opening is the nominal's that it lies near: within so many tolerances of its place, or half
  // its size, or so far [mm].
  double near_tolerances = 3.0, near_sizes = 0.5, near_mm = 2.0;
  // The wall is looked for in the opening made smaller by this, and what is usual there around it,
  // from and to where it is made larger by these.
  double inside = 0.7, around_from = 1.2, around_to = 2.5;
  // Samples inside, at least, and their density over that around: then the wall is there.
  double least_inside = 3.0, least_density = 0.3;
  // [of r_P] From the surface.
  double on_surface = 0.3;
};
constexpr FeatureSettings kFeatures;

Deviation CompareFeature(double nominal, double deviation, double sigma,
                         std::optional<double> tolerance, double decision_sigmas) {
  return {nominal, nominal + deviation, deviation,
          sigma,   tolerance,           Judge(deviation, sigma, tolerance, decision_sigmas)};
}

// How far a place in the plane of the opening, across its axis, lies outside of it [its half
// width]: 1 on its border.
double WidthsFrom(const hal::WallOpening& opening, const hal::SurfaceFrame& frame,
                  const Eigen::Vector3d& from_mm) {
  const double axis = opening.axis_deg * hal::kRadiansPerDegree;
  const Eigen::Vector3d along = std::cos(axis) * frame.tangent + std::sin(axis) * frame.sideways();
  const double half_line_mm = 0.5 * (opening.length_mm - opening.width_mm);
  const double off_mm = std::max(0.0, std::abs(from_mm.dot(along)) - half_line_mm);
  return std::hypot(off_mm, from_mm.dot(frame.outward.cross(along))) / (0.5 * opening.width_mm);
}

// Openings and ends of a measurement on the tube in the nominal's order.
class Inspector {
 public:
  Inspector(const Measurement& measurement, const hal::Tube& measured, bool reversed,
            double decision_sigmas)
      : measurement_(measurement),
        segments_(hal::SpineSegments(measured.program, measured.X_WT)),
        scanned_(hal::SpineSegments(measurement.tube.program, measurement.tube.X_WT)),
        length_mm_(hal::SpineLength(measured.program)),
        pipe_radius_mm_(measured.pipe_radius_mm),
        reversed_(reversed),
        decision_sigmas_(decision_sigmas),
        is_taken_(measurement.features.openings.size(), false) {}

  OpeningInspection Inspect(const NominalOpening& nominal) {
    OpeningInspection out;
    out.name = nominal.name;
    out.named = out.found_as = KindOf(nominal.opening);
    hal::WallOpening expected = nominal.opening;
    if (nominal.from_end) expected.along_mm = length_mm_ - expected.along_mm;
    const std::optional<std::size_t> found = Nearest(nominal, expected);
    hal::WallOpening measured = expected, sigma;
    NominalOpening judged = nominal;
    if (found) {
      is_taken_[*found] = true;
      out.found = *found;
      measured = InNominalOrder(measurement_.features.openings[*found]);
      sigma = measurement_.features.openings[*found].sigma;
      out.found_as = KindOf(measured);
    } else {
      judged.place_tolerance_mm = judged.around_tolerance_deg = std::nullopt;
      judged.size_tolerance_mm = judged.axis_tolerance_deg = std::nullopt;
    }
    out.state = found                 ? OpeningState::kFound
                : ShowsWall(expected) ? OpeningState::kMissing
                                      : OpeningState::kNotSeen;
    const double k = decision_sigmas_;
    const double along_mm = measured.along_mm - expected.along_mm;
    out.along_mm = CompareFeature(nominal.opening.along_mm, nominal.from_end ? -along_mm : along_mm,
                                  sigma.along_mm, judged.place_tolerance_mm, k);
    out.around_deg = CompareFeature(expected.around_deg,
                                    hal::WrapRotationDeg(measured.around_deg - expected.around_deg),
                                    sigma.around_deg, judged.around_tolerance_deg, k);
    CompareShapes(judged, measured, sigma, out);
    return out;
  }

  EndInspection InspectEnd(bool at_start, const NominalFeatures& nominal) const {
    EndInspection out;
    const std::optional<EndCutFound>& found =
        at_start != reversed_ ? measurement_.features.first_end : measurement_.features.last_end;
    const hal::EndCut& cut = at_start ? nominal.first_end : nominal.last_end;
    out.obliquity_deg.nominal = out.obliquity_deg.measured = cut.obliquity_deg;
    if (!found) return out;
    out.is_known = true;
    const double away_deg = AngleBetween(cut, at_start, *found);
    out.obliquity_deg = {cut.obliquity_deg,
                         found->cut.obliquity_deg,
                         away_deg,
                         found->obliquity_sigma_deg,
                         nominal.obliquity_tolerance_deg,
                         Judge(away_deg, found->obliquity_sigma_deg,
                               nominal.obliquity_tolerance_deg, decision_sigmas_)};
    return out;
  }

 private:
  // A hole is as wide any way as its diameter says, so what is no hole is judged both ways where a
  // hole is named, and a hole both ways where a slot is.
  void CompareShapes(const NominalOpening& nominal, const hal::WallOpening& measured,
                     const hal::WallOpening& sigma_of, OpeningInspection& out) const {
    const double k = decision_sigmas_;
    const OpeningShape named = ShapeOf(nominal.opening), is = ShapeOf(measured);
    OpeningShape sigma = ShapeSigma(measured, sigma_of);
    // As long as the drill that is named leaves it where samples do not say how it leans.
    if (out.named == OpeningKind::kLeaningHole && out.found_as == OpeningKind::kHole) {
      sigma.length_mm = std::hypot(sigma.length_mm, LongerByLeanMm(measured, sigma_of));
    }
    const auto size = nominal.size_tolerance_mm;
    const bool both_holes = out.named == OpeningKind::kHole && out.found_as == OpeningKind::kHole;
    const bool both_slots = out.named == OpeningKind::kSlot && out.found_as == OpeningKind::kSlot;
    const auto across = both_holes ? std::nullopt : size;
    out.length_mm =
        CompareFeature(named.length_mm, is.length_mm - named.length_mm, sigma.length_mm, size, k);
    out.width_mm =
        CompareFeature(named.width_mm, is.width_mm - named.width_mm, sigma.width_mm, across, k);
    const double named_mm = named.length_mm - named.width_mm;
    out.out_of_round_mm =
        CompareFeature(named_mm, is.length_mm - is.width_mm - named_mm,
                       both_holes ? 0.0 : std::hypot(sigma.length_mm, sigma.width_mm),
                       both_slots ? std::nullopt : across, k);
    // What is round has no axis; how an oval lies is told and not judged.
    const bool has_axis = out.named == OpeningKind::kSlot && out.found_as != OpeningKind::kHole;
    out.axis_deg = CompareFeature(
        named.axis_deg, has_axis ? std::remainder(is.axis_deg - named.axis_deg, 180.0) : 0.0,
        sigma.axis_deg, has_axis ? nominal.axis_tolerance_deg : std::nullopt, k);
    out.lean_deg = {named.lean_deg, is.lean_deg,  AngleBetweenDrillsDeg(nominal.opening, measured),
                    sigma.lean_deg, std::nullopt, ToleranceState::kNotJudged};
  }

  // The same place counted on the tube in the nominal's order.
  hal::WallOpening InNominalOrder(const OpeningFound& found) const {
    hal::WallOpening opening = found.opening;
    if (!reversed_) return opening;
    opening.along_mm = length_mm_ - opening.along_mm;
    const hal::SurfaceFrame frame = hal::FrameAt(segments_, opening.along_mm, 0.0);
    // About the wall's own axis, beside which the tube's may lie (found.position_mm).
    const Eigen::Vector3d outward =
        hal::FrameAt(scanned_, found.opening.along_mm, found.opening.around_deg).outward;
    opening.around_deg = hal::AroundDeg(frame.outward, frame.tangent, outward);
    // With the feed turn both directions that leans are counted to.
    opening.lean_along_deg = -opening.lean_along_deg;
    opening.lean_around_deg = -opening.lean_around_deg;
    if (opening.is_hole()) return opening;
    const double axis = std::atan2(found.direction.dot(outward.cross(frame.tangent)),
                                   found.direction.dot(frame.tangent));
    opening.axis_deg = std::remainder(axis * hal::kDegreesPerRadian, 180.0);
    return opening;
  }

  std::optional<std::size_t> Nearest(const NominalOpening& nominal,
                                     const hal::WallOpening& expected) const {
    double nearest_mm =
        std::max({kFeatures.near_tolerances * nominal.place_tolerance_mm.value_or(0),
                  kFeatures.near_sizes * expected.length_mm, kFeatures.near_mm});
    std::optional<std::size_t> nearest;
    for (std::size_t i = 0; i < is_taken_.size(); ++i) {
      if (is_taken_[i]) continue;
      const hal::WallOpening opening = InNominalOrder(measurement_.features.openings[i]);
      const double turn = hal::WrapRotationDeg(opening.around_deg - expected.around_deg);
      const double off_mm = std::hypot(opening.along_mm - expected.along_mm,
                                       pipe_radius_mm_ * turn * hal::kRadiansPerDegree);
      if (off_mm < nearest_mm) nearest = i, nearest_mm = off_mm;
    }
    return nearest;
  }

  // Whether samples lie where the opening should be, as densely as around it.
  bool ShowsWall(const hal::WallOpening& expected) const {
    const hal::SurfaceFrame frame = hal::FrameAt(segments_, expected.along_mm, expected.around_deg);
    double inside = 0, around = 0;
    for (const SurfaceSample& sample : measurement_.surface) {
      const Eigen::Vector3d from_mm = sample.position_mm - frame.spine_mm;
      if (from_mm.dot(frame.outward) < 0) continue;
      if (std::abs(sample.distance_mm) > kFeatures.on_surface * pipe_radius_mm_) continue;
      const double widths = WidthsFrom(expected, frame, from_mm);
      if (widths < kFeatures.inside) inside += 1;
      if (widths > kFeatures.around_from && widths < kFeatures.around_to) around += 1;
    }
    const double area = std::numbers::pi * 0.25 * expected.width_mm * expected.width_mm;
    const double line = (expected.length_mm - expected.width_mm) * expected.width_mm;
    const auto area_to = [&](double widths) { return widths * widths * area + widths * line; };
    const double usual = around / (area_to(kFeatures.around_to) - area_to(kFeatures.around_from));
    return inside >= kFeatures.least_inside &&
           inside / area_to(kFeatures.inside) > kFeatures.least_density * usual;
  }

  // Of both planes: their normals' tangents lie in the cross-section.
  double AngleBetween(const hal::EndCut& cut, bool at_start, const EndCutFound& found) const {
    const auto slope = [](const hal::EndCut& of, const Eigen::Vector3d& zero,
                          const Eigen::Vector3d& tangent) -> Eigen::Vector3d {
      return std::tan(of.obliquity_deg * hal::kRadiansPerDegree) *
             (Eigen::AngleAxisd(of.around_deg * hal::kRadiansPerDegree, tangent) * zero);
    };
    const std::size_t at = at_start ? 0 : segments_.size() - 1;
    const Eigen::Vector3d nominal =
        slope(cut, hal::AroundZero(segments_, at), segments_[at].tangent);
    const std::size_t same = at_start != reversed_ ? 0 : scanned_.size() - 1;
    const Eigen::Vector3d measured =
        slope(found.cut, hal::AroundZero(scanned_, same), scanned_[same].tangent);
    return std::atan((nominal - measured).norm()) * hal::kDegreesPerRadian;
  }

  const Measurement& measurement_;
  std::vector<hal::SpineSegment> segments_, scanned_;  // in the nominal's order, and as measured
  double length_mm_, pipe_radius_mm_;
  bool reversed_;
  double decision_sigmas_;
  std::vector<bool> is_taken_;
};

}  // namespace

std::string_view Name(OpeningState state) {
  switch (state) {
    case OpeningState::kFound:
      return "found";
    case OpeningState::kMissing:
      return "missing";
    case OpeningState::kNotSeen:
      return "not seen";
  }
  return "unknown";
}

FeatureInspection InspectFeatures(const Measurement& measurement, const NominalFeatures& nominal,
                                  const hal::Tube& measured, bool reversed,
                                  double decision_sigmas) {
  Inspector inspector(measurement, measured, reversed, decision_sigmas);
  FeatureInspection out;
  for (const NominalOpening& opening : nominal.openings) {
    out.openings.push_back(inspector.Inspect(opening));
  }
  out.first_end = inspector.InspectEnd(true, nominal);
  out.last_end = inspector.InspectEnd(false, nominal);
  return out;
}

}  // namespace bendloop::pipeline
