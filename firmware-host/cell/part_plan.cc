// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cell/part_plan.h"

#include "config/digest.h"
#include "hal/spine.h"
#include "pipeline/tube/representations.h"

namespace bendloop::host {
namespace {

pipeline::DirectionChoice ChoiceOf(config::ScanDirection direction) {
  switch (direction) {
    case config::ScanDirection::kForward:
      return pipeline::DirectionChoice::kForward;
    case config::ScanDirection::kReverse:
      return pipeline::DirectionChoice::kReverse;
    case config::ScanDirection::kAuto:
      break;
  }
  return pipeline::DirectionChoice::kAuto;
}

pipeline::PerAxis AxesOf(const config::CorrectionLimits& limits) {
  return {limits.length_mm, limits.rotation_deg, limits.angle_deg};
}

pipeline::CorrectionOptions CorrectionOf(const config::CellConfig& cell) {
  const config::CorrectionConfig& from = cell.correction;
  pipeline::CorrectionOptions options;
  options.material = MaterialOf(cell.part);
  options.gain = {from.correct_lengths ? from.gain_length : 0.0,
                  from.correct_rotations ? from.gain_rotation : 0.0,
                  from.correct_angles ? from.gain_angle : 0.0};
  options.deadband_sigmas = from.deadband_sigmas;
  options.hold_sigma = AxesOf(cell.interlocks.max_sigma);
  const config::Tolerances& tolerance = cell.part.tolerance;
  options.tolerance = {tolerance.length_mm, tolerance.rotation_deg, tolerance.angle_deg};
  options.step_limit = AxesOf(from.max_step);
  options.total_limit = AxesOf(from.max_total);
  return options;
}

std::string WhereOf(const config::PartConfig& part) {
  return part.file.empty() ? "part '" + part.name + "'" : part.file.string();
}

}  // namespace

pipeline::Material MaterialOf(const config::PartConfig& part) {
  return {part.material.springback_at_20_deg, part.material.springback_at_120_deg,
          part.material.elongation_percent};
}

hal::Result<hal::BendProgram> NominalProgram(const config::PartConfig& part) {
  hal::BendProgram program = part.rows;
  if (!part.xyz_mm.empty()) {
    pipeline::ControlPolygon polygon{part.xyz_mm, {}};
    polygon.bend_radii_mm.assign(part.xyz_mm.size() < 2 ? 0 : part.xyz_mm.size() - 2,
                                 part.bend_radius_mm);
    auto tube = pipeline::TubeFromPolygon(polygon);
    if (!tube)
      return hal::Fail(hal::ErrorKind::kBadInput, WhereOf(part) + ": " + tube.error().message);
    program = std::move(tube->program);
  }
  if (auto checked = pipeline::CheckProgram(program); !checked) {
    return hal::Fail(hal::ErrorKind::kBadInput, WhereOf(part) + ": " + checked.error().message);
  }
  return program;
}

pipeline::NominalFeatures FeaturesOf(const config::PartConfig& part) {
  pipeline::NominalFeatures features;
  const auto add = [&](const config::OpeningConfig& opening, const std::string& name) {
    pipeline::NominalOpening nominal;
    nominal.name = name;
    nominal.from_end = opening.from_end_mm.has_value();
    nominal.opening = {nominal.from_end ? *opening.from_end_mm : opening.from_start_mm.value_or(0),
                       opening.around_deg,
                       opening.length_mm,
                       opening.width_mm,
                       opening.axis_deg,
                       opening.lean_along_deg,
                       opening.lean_around_deg};
    nominal.place_tolerance_mm = opening.place_tolerance_mm;
    nominal.around_tolerance_deg = opening.around_tolerance_deg;
    nominal.size_tolerance_mm = opening.size_tolerance_mm;
    nominal.axis_tolerance_deg = opening.axis_tolerance_deg;
    features.openings.push_back(std::move(nominal));
  };
  for (std::size_t i = 0; i < part.holes.size(); ++i) {
    add(part.holes[i], "hole " + std::to_string(i + 1));
  }
  for (std::size_t i = 0; i < part.slots.size(); ++i) {
    add(part.slots[i], "slot " + std::to_string(i + 1));
  }
  features.first_end = part.ends.first;
  features.last_end = part.ends.last;
  features.obliquity_tolerance_deg = part.ends.obliquity_tolerance_deg;
  return features;
}

hal::TubeFeatures CutsOf(const config::PartConfig& part, double length_mm) {
  hal::TubeFeatures cuts;
  cuts.first_end = part.ends.first;
  cuts.last_end = part.ends.last;
  for (const pipeline::NominalOpening& nominal : FeaturesOf(part).openings) {
    cuts.openings.push_back(nominal.opening);
    if (nominal.from_end) cuts.openings.back().along_mm = length_mm - nominal.opening.along_mm;
  }
  return cuts;
}

hal::Result<PartPlan> MakePartPlan(const config::CellConfig& cell) {
  auto nominal = NominalProgram(cell.part);
  if (!nominal) return hal::Fail(nominal.error());
  if (auto checked = pipeline::Check(MaterialOf(cell.part)); !checked) {
    return hal::Fail(hal::ErrorKind::kBadInput,
                     WhereOf(cell.part) + ": " + checked.error().message);
  }
  PartPlan plan;
  plan.part = cell.part.name;
  plan.part_number = cell.part.part_number;
  plan.nominal = std::move(*nominal);
  plan.pipe_radius_mm = cell.part.pipe_radius_mm;
  plan.nominal_length_mm = hal::SpineLength(plan.nominal);
  plan.corrects = cell.correction.enabled;
  plan.tubes_between = static_cast<unsigned>(cell.scan.parts_between.value_or(0));
  plan.config_digest = config::Digest(cell);

  plan.reconstruction.pipe_radius_mm = plan.pipe_radius_mm;
  plan.reconstruction.nominal = plan.nominal;
  plan.reconstruction.max_points = kMostPoints;
  plan.reconstruction.max_line_points = kMostLinePoints;
  plan.reconstruction.pass_drift = {cell.scan.pass_drift_mm, cell.scan.pass_drift_deg};

  const config::Tolerances& tolerance = cell.part.tolerance;
  plan.inspection.tolerances.length_mm = tolerance.length_mm;
  plan.inspection.tolerances.rotation_deg = tolerance.rotation_deg;
  plan.inspection.tolerances.angle_deg = tolerance.angle_deg;
  plan.inspection.tolerances.envelope_mm = tolerance.envelope_mm;
  plan.inspection.tolerances.surface_mm = tolerance.surface_mm;
  plan.inspection.tolerances.straightness_mm = tolerance.straightness_mm;
  plan.inspection.tolerances.dent_depth_mm = tolerance.dent_depth_mm;
  plan.inspection.features = FeaturesOf(cell.part);
  plan.inspection.decision_sigmas =
      cell.verdict.rule == config::VerdictRule::kGuarded ? cell.verdict.guard_factor : 0.0;
  plan.inspection.direction.choice = ChoiceOf(cell.scan.direction);

  plan.correction = CorrectionOf(cell);

  const config::InterlockConfig& locks = cell.interlocks;
  plan.interlocks.least_coverage = locks.min_coverage;
  plan.interlocks.longest_gap_mm = locks.max_gap_mm;
  plan.interlocks.most_rms_mm = locks.max_fit_rms_mm;
  plan.interlocks.most_sigma = AxesOf(locks.max_sigma);
  plan.interlocks.oldest_session_s = locks.max_session_age_s;
  plan.interlocks.pass_drift = plan.reconstruction.pass_drift;

  plan.commit.reply_timeout = cell.bender.commit_timeout;
  plan.commit.allow_non_atomic = cell.bender.allow_non_atomic;
  return plan;
}

}  // namespace bendloop::host
