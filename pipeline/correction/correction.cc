// SPDX-License-Identifier: Apache-2.0
#include "pipeline/correction/correction.h"

#include <algorithm>
#include <cmath>

#include "pipeline/math/text.h"
#include "pipeline/tube/row_names.h"

namespace bendloop::pipeline {
namespace {

// A part this many sigma off what its lot predicts is worth a word, once the lot has this many.
constexpr double kUnexpectedSigmas = 6.0;
constexpr std::uint32_t kPartsToExpect = 3;

bool IsFinite(const hal::BendProgram& program) {
  return std::all_of(program.rows.begin(), program.rows.end(), [](const hal::BendRow& row) {
    return std::isfinite(row.length_mm) && std::isfinite(row.rotation_deg) &&
           std::isfinite(row.angle_deg) && std::isfinite(row.bend_radius_mm.value_or(0.0));
  });
}

// Stretch of straight `row` by the bends beside it, whose angles are `angles_deg`.
double StretchMm(const hal::BendProgram& radii_of, const std::vector<double>& angles_deg,
                 std::size_t row, const Material& material) {
  double stretch_mm = 0;
  const std::size_t bends = radii_of.bend_count();
  const auto add = [&](std::size_t bend) {
    stretch_mm += material.StretchOfStraightMm(radii_of.rows[bend].bend_radius_mm.value_or(0.0),
                                               angles_deg[bend]);
  };
  if (row > 0) add(row - 1);
  if (row < bends) add(row);
  return stretch_mm;
}

std::vector<double> Angles(const hal::BendProgram& program) {
  std::vector<double> angles_deg;
  for (const hal::BendRow& row : program.rows) angles_deg.push_back(row.angle_deg);
  return angles_deg;
}

// What one axis may do: the options, taken apart by axis.
struct AxisRule {
  double gain;
  double scatter_sigma;
  double step_limit;
  double total_limit;
  const char* unit;
};

// One axis of one row on its way from innovation to the change of command.
class AxisSolver {
 public:
  AxisSolver(const CorrectionOptions& options, const AxisRule& rule, std::uint32_t parts,
             std::string name, Correction& out)
      : options_(options), rule_(rule), parts_(parts), name_(std::move(name)), out_(out) {}

  // Takes the part into the estimate: a Kalman update whose gain is held between the least and the
  // configured one (Joseph's form, right for any gain).
  OffsetEstimate Learn(const OffsetEstimate& before, double innovation, double sigma,
                       AxisCorrection& axis) const {
    const double noise = rule_.scatter_sigma * rule_.scatter_sigma + sigma * sigma;
    const double total = before.variance + noise;
    axis.gain = rule_.gain;
    if (options_.decaying_gain && total > 0) {
      axis.gain = std::clamp(before.variance / total, std::min(options_.least_gain, rule_.gain),
                             rule_.gain);
    }
    if (parts_ >= kPartsToExpect &&
        innovation * innovation > kUnexpectedSigmas * kUnexpectedSigmas * total) {
      axis.flags |= kFlagUnexpected;
      out_.notices.push_back(name_ + " is " + Fixed(std::abs(innovation), 2) + " " + rule_.unit +
                             " off what the lot's parts so far predict (1 sigma " +
                             Fixed(std::sqrt(total), 2) +
                             "): if tube, tool or setting changed, start a new lot");
    }
    const double g = axis.gain;
    const double kept = (1.0 - g) * (1.0 - g);
    return {before.offset + g * innovation, kept * before.variance + g * g * noise,
            kept * before.noise_variance + g * g * noise};
  }

  // Deadband and limits; `axis.wanted` and `axis.sigma` are set.
  void Limit(double base, AxisCorrection& axis) const {
    axis.applied = axis.wanted;
    if (std::abs(axis.wanted) <= options_.deadband_sigmas * axis.sigma) {
      axis.flags |= kFlagDeadband;
      axis.applied = 0;
    } else if (std::abs(axis.wanted) > rule_.step_limit) {
      axis.flags |= kFlagStepLimit;
      axis.applied = std::copysign(rule_.step_limit, axis.wanted);
      out_.notices.push_back(name_ + ": a change of " + Fixed(axis.wanted, 2) + " " + rule_.unit +
                             " is cut to the limit of one step, " + Fixed(axis.applied, 2));
    }
    axis.corrected = axis.active + axis.applied;
    const double from_base = axis.corrected - base;
    if (!(std::abs(from_base) <= rule_.total_limit)) {
      axis.flags |= kFlagTotalLimit;
      out_.refusals.push_back(
          name_ + ": the corrected program would be " + Fixed(std::abs(from_base), 2) + " " +
          rule_.unit + " from the lot's first program, limit " + Fixed(rule_.total_limit, 2) +
          " (check tube, die, clamp and nominal)");
    }
  }

  void Impossible(const std::string& why, AxisCorrection& axis) const {
    axis.flags |= kFlagImpossible;
    out_.refusals.push_back(name_ + ": the corrected program would need " +
                            Fixed(axis.corrected, 2) + " " + rule_.unit + ", " + why);
  }

 private:
  const CorrectionOptions& options_;
  const AxisRule& rule_;
  std::uint32_t parts_;
  std::string name_;
  Correction& out_;
};

AxisCorrection Keep(double commanded, double active, double deviation, std::uint32_t flag) {
  AxisCorrection axis;
  axis.commanded = commanded;
  axis.active = axis.corrected = active;
  axis.deviation = deviation;
  axis.flags = flag;
  return axis;
}

hal::Result<void> CheckInput(const CorrectionInput& input, const LotState& lot,
                             const CorrectionOptions& options) {
  const auto bad = [](const std::string& message) {
    return hal::Fail(hal::ErrorKind::kBadInput, "correction: " + message);
  };
  if (const auto ok = Check(options.material); !ok) return ok;
  const std::size_t rows = input.nominal.rows.size();
  for (const auto& [name, program] :
       {std::pair{"commanded program", &input.commanded}, {"measured tube", &input.measured}}) {
    if (program->rows.size() == rows && rows > 0) continue;
    return bad(std::string("the ") + name + " has " + std::to_string(program->rows.size()) +
               " rows, the nominal " + std::to_string(rows) +
               "; expected the same number, corrections never add or remove rows");
  }
  if (!input.active.rows.empty() && input.active.rows.size() != rows) {
    return bad("the active program has " + std::to_string(input.active.rows.size()) +
               " rows, the nominal " + std::to_string(rows) + "; expected the same number");
  }
  if (!input.sigma.rows.empty() && input.sigma.rows.size() != rows) {
    return bad("uncertainties for " + std::to_string(input.sigma.rows.size()) + " rows of " +
               std::to_string(rows));
  }
  if (!lot.rows.empty() && (lot.rows.size() != rows || lot.base.rows.size() != rows)) {
    return bad("the lot was started with " + std::to_string(lot.base.rows.size()) +
               " rows, the nominal has " + std::to_string(rows) + "; start a new lot");
  }
  if (!IsFinite(input.nominal) || !IsFinite(input.commanded) || !IsFinite(input.measured) ||
      !IsFinite(input.sigma) || !IsFinite(input.active) || !IsFinite(lot.base)) {
    return bad("a value that is not a finite number in nominal, commanded or measured rows");
  }
  return {};
}

}  // namespace

LotState StartLot(const hal::BendProgram& nominal, const hal::BendProgram& base,
                  const CorrectionOptions& options) {
  LotState lot;
  lot.base = base;
  const std::size_t bends = nominal.bend_count();
  const std::vector<double> angles_deg = Angles(nominal);
  for (std::size_t i = 0; i < std::min(nominal.rows.size(), base.rows.size()); ++i) {
    const hal::BendRow& n = nominal.rows[i];
    const hal::BendRow& b = base.rows[i];
    const auto square = [](double x) { return x * x; };
    LotRow row;
    row.length_mm = {
        n.length_mm - b.length_mm - StretchMm(nominal, angles_deg, i, options.material),
        square(options.lot_sigma.length_mm), 0};
    if (i < bends) {
      row.rotation_deg = {hal::WrapRotationDeg(n.rotation_deg - b.rotation_deg),
                          square(options.lot_sigma.rotation_deg), 0};
      row.angle_deg = {n.angle_deg - options.material.AngleAfterDeg(b.angle_deg),
                       square(options.lot_sigma.angle_deg), 0};
    }
    lot.rows.push_back(row);
  }
  return lot;
}

hal::Result<Correction> Correct(const CorrectionInput& input, const LotState& lot,
                                const CorrectionOptions& options) {
  if (const auto ok = CheckInput(input, lot, options); !ok) return hal::Fail(ok.error());
  const Material& material = options.material;
  const auto& [nominal, commanded, measured, sigma_or_none, active_or_none] = input;
  const hal::BendProgram& active = active_or_none.rows.empty() ? commanded : active_or_none;
  const std::size_t bends = nominal.bend_count();
  hal::BendProgram sigma = sigma_or_none;
  sigma.rows.resize(nominal.rows.size());
  const AxisRule length_rule{options.gain.length_mm, options.scatter_sigma.length_mm,
                             options.step_limit.length_mm, options.total_limit.length_mm, "mm"};
  const AxisRule rotation_rule{options.gain.rotation_deg, options.scatter_sigma.rotation_deg,
                               options.step_limit.rotation_deg, options.total_limit.rotation_deg,
                               "degrees"};
  const AxisRule angle_rule{options.gain.angle_deg, options.scatter_sigma.angle_deg,
                            options.step_limit.angle_deg, options.total_limit.angle_deg, "degrees"};

  Correction out;
  out.next = lot.rows.empty() ? StartLot(nominal, commanded, options) : lot;
  const LotState before = out.next;
  out.next.parts = before.parts + 1;
  out.corrected = active;
  out.rows.resize(nominal.rows.size());

  // Rotations and angles first: the lengths depend on what the angles will become.
  std::vector<double> expected_angles_deg(nominal.rows.size(), 0.0);
  for (std::size_t i = 0; i < nominal.rows.size(); ++i) {
    const hal::BendRow& n = nominal.rows[i];
    const hal::BendRow& c = commanded.rows[i];
    const hal::BendRow& a = active.rows[i];
    const hal::BendRow& m = measured.rows[i];
    RowCorrection& row = out.rows[i];

    const double turn_deg = hal::WrapRotationDeg(n.rotation_deg - m.rotation_deg);
    const double smallest = i == 0 ? 0.0
                                   : std::min({nominal.rows[i - 1].angle_deg, n.angle_deg,
                                               measured.rows[i - 1].angle_deg, m.angle_deg});
    if (i == 0 || i == bends || rotation_rule.gain <= 0) {
      row.rotation_deg = Keep(c.rotation_deg, a.rotation_deg, i == 0 || i == bends ? 0.0 : turn_deg,
                              kFlagNotCorrected);
    } else if (smallest < options.least_angle_deg) {
      row.rotation_deg = Keep(c.rotation_deg, a.rotation_deg, turn_deg, kFlagNoMeaning);
    } else {
      AxisCorrection& axis = row.rotation_deg;
      const AxisSolver solver(options, rotation_rule, before.parts, RotationName(i), out);
      axis.commanded = c.rotation_deg;
      axis.active = a.rotation_deg;
      axis.deviation = turn_deg;
      OffsetEstimate& estimate = out.next.rows[i].rotation_deg;
      const double innovation =
          hal::WrapRotationDeg(m.rotation_deg - c.rotation_deg - estimate.offset);
      estimate = solver.Learn(estimate, innovation, sigma.rows[i].rotation_deg, axis);
      axis.wanted = hal::WrapRotationDeg(n.rotation_deg - estimate.offset - a.rotation_deg);
      axis.sigma = std::sqrt(estimate.noise_variance);
      // The base on the turn nearest to the command.
      const double base_deg =
          a.rotation_deg - hal::WrapRotationDeg(a.rotation_deg - before.base.rows[i].rotation_deg);
      solver.Limit(base_deg, axis);
      axis.corrected = hal::WrapRotationDeg(axis.corrected);
    }

    const bool no_bend = i == bends || (n.angle_deg == 0 && c.angle_deg == 0);
    if (no_bend || angle_rule.gain <= 0) {
      row.angle_deg = Keep(c.angle_deg, a.angle_deg, i == bends ? 0.0 : n.angle_deg - m.angle_deg,
                           kFlagNotCorrected);
      expected_angles_deg[i] = m.angle_deg;
    } else {
      AxisCorrection& axis = row.angle_deg;
      const AxisSolver solver(options, angle_rule, before.parts, AngleName(i), out);
      axis.commanded = c.angle_deg;
      axis.active = a.angle_deg;
      axis.deviation = n.angle_deg - m.angle_deg;
      OffsetEstimate& estimate = out.next.rows[i].angle_deg;
      const double model_deg = material.AngleAfterDeg(c.angle_deg);
      estimate = solver.Learn(estimate, m.angle_deg - model_deg - estimate.offset,
                              sigma.rows[i].angle_deg, axis);
      axis.wanted = material.AngleToCommandDeg(n.angle_deg - estimate.offset) - a.angle_deg;
      axis.sigma = std::sqrt(estimate.noise_variance) / material.AngleSlope();
      solver.Limit(before.base.rows[i].angle_deg, axis);
      if (!(axis.corrected > 0 && axis.corrected < 360)) {
        solver.Impossible("but a bend has more than 0 and less than 360", axis);
      }
      expected_angles_deg[i] = material.AngleAfterDeg(axis.corrected) + estimate.offset;
    }
  }

  const std::vector<double> measured_angles_deg = Angles(measured);
  for (std::size_t i = 0; i < nominal.rows.size(); ++i) {
    const double commanded_mm = commanded.rows[i].length_mm;
    const double active_mm = active.rows[i].length_mm;
    AxisCorrection& axis = out.rows[i].length_mm;
    const double deviation_mm = nominal.rows[i].length_mm - measured.rows[i].length_mm;
    if (length_rule.gain <= 0) {
      axis = Keep(commanded_mm, active_mm, deviation_mm, kFlagNotCorrected);
      continue;
    }
    const AxisSolver solver(options, length_rule, before.parts, LengthName(i, bends), out);
    axis.commanded = commanded_mm;
    axis.active = active_mm;
    axis.deviation = deviation_mm;
    OffsetEstimate& estimate = out.next.rows[i].length_mm;
    const double model_mm = commanded_mm + StretchMm(commanded, measured_angles_deg, i, material);
    estimate = solver.Learn(estimate, measured.rows[i].length_mm - model_mm - estimate.offset,
                            sigma.rows[i].length_mm, axis);
    axis.wanted = nominal.rows[i].length_mm - estimate.offset -
                  StretchMm(active, expected_angles_deg, i, material) - active_mm;
    axis.sigma = std::sqrt(estimate.noise_variance);
    if (nominal.rows[i].length_mm <= 0 && active_mm + axis.wanted < 0) {
      axis.flags |= kFlagAtZero;
      axis.wanted = -active_mm;
    }
    solver.Limit(before.base.rows[i].length_mm, axis);
    if (!(axis.corrected >= 0)) solver.Impossible("but no straight is shorter than 0", axis);
  }

  for (std::size_t i = 0; i < out.rows.size(); ++i) {
    out.corrected.rows[i].length_mm = out.rows[i].length_mm.corrected;
    out.corrected.rows[i].rotation_deg = out.rows[i].rotation_deg.corrected;
    out.corrected.rows[i].angle_deg = out.rows[i].angle_deg.corrected;
    out.changes_anything |= out.rows[i].length_mm.applied != 0 ||
                            out.rows[i].rotation_deg.applied != 0 ||
                            out.rows[i].angle_deg.applied != 0;
  }
  return out;
}

std::string FlagNames(std::uint32_t flags) {
  constexpr std::pair<CorrectionFlag, const char*> kNames[] = {
      {kFlagDeadband, "deadband"},      {kFlagStepLimit, "step limit"},
      {kFlagTotalLimit, "total limit"}, {kFlagNotCorrected, "not corrected"},
      {kFlagNoMeaning, "no meaning"},   {kFlagImpossible, "impossible"},
      {kFlagAtZero, "at zero"},         {kFlagUnexpected, "unexpected"},
  };
  std::string names;
  for (const auto& [flag, name] : kNames) {
    if ((flags & flag) == 0) continue;
    if (!names.empty()) names += ", ";
    names += name;
  }
  return names;
}

}  // namespace bendloop::pipeline
