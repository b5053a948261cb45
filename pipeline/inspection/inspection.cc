// SPDX-License-Identifier: Apache-2.0
#include "pipeline/inspection/inspection.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <iterator>
#include <utility>

#include "hal/spine.h"
#include "pipeline/math/probability.h"
#include "pipeline/math/text.h"
#include "pipeline/tube/representations.h"
#include "pipeline/tube/row_names.h"

namespace bendloop::pipeline {
namespace {

Deviation Compare(double nominal, double deviation, double sigma, std::optional<double> tolerance,
                  double decision_sigmas) {
  return {nominal, nominal + deviation, deviation,
          sigma,   tolerance,           Judge(deviation, sigma, tolerance, decision_sigmas)};
}

std::vector<RowInspection> CompareRows(const hal::BendProgram& nominal,
                                       const hal::BendProgram& measured,
                                       const hal::BendProgram& sigma,
                                       const InspectionOptions& options) {
  const Tolerances& tolerances = options.tolerances;
  const double k = options.decision_sigmas;
  const std::size_t bends = nominal.bend_count();
  std::vector<RowInspection> rows(nominal.rows.size());
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const hal::BendRow& n = nominal.rows[i];
    const hal::BendRow& m = measured.rows[i];
    const hal::BendRow s = i < sigma.rows.size() ? sigma.rows[i] : hal::BendRow{};
    const bool bend = i < bends;
    const auto smallest = [i](const hal::BendProgram& program) {
      return std::min(program.rows[i - 1].angle_deg, program.rows[i].angle_deg);
    };
    const bool has_rotation =
        bend && i > 0 && std::min(smallest(nominal), smallest(measured)) >= options.least_angle_deg;
    rows[i].length_mm =
        Compare(n.length_mm, m.length_mm - n.length_mm, s.length_mm, tolerances.length_mm, k);
    rows[i].rotation_deg =
        Compare(n.rotation_deg, hal::WrapRotationDeg(m.rotation_deg - n.rotation_deg),
                s.rotation_deg, has_rotation ? tolerances.rotation_deg : std::nullopt, k);
    rows[i].angle_deg = Compare(n.angle_deg, m.angle_deg - n.angle_deg, s.angle_deg,
                                bend ? tolerances.angle_deg : std::nullopt, k);
    if (bend && n.bend_radius_mm && m.bend_radius_mm) {
      rows[i].bend_radius_mm =
          Compare(*n.bend_radius_mm, *m.bend_radius_mm - *n.bend_radius_mm,
                  s.bend_radius_mm.value_or(0.0), tolerances.bend_radius_mm, k);
    }
  }
  return rows;
}

// Collects the states of all numbers into the verdict and its reasons.
class Jury {
 public:
  explicit Jury(double decision_sigmas) : decision_sigmas_(decision_sigmas) {}

  void Hear(const std::string& name, const Deviation& number, const char* unit) {
    Weigh(number.deviation, number.sigma, number.tolerance, number.state);
    if (number.state == ToleranceState::kNotJudged || number.state == ToleranceState::kIn) return;
    Say(number.state,
        name + " " + Fixed(std::abs(number.deviation), 2) + " " + unit +
            (number.deviation < 0 ? " below nominal" : " above nominal"),
        number.deviation, number.tolerance.value_or(0.0), number.sigma, unit);
  }
  void Hear(const std::string& what, double value_mm, double sigma_mm, double tolerance_mm,
            ToleranceState state) {
    Weigh(value_mm, sigma_mm, tolerance_mm, state);
    if (state == ToleranceState::kNotJudged || state == ToleranceState::kIn) return;
    Say(state, what + " " + Fixed(value_mm, 2) + " mm off the nominal", value_mm, tolerance_mm,
        sigma_mm, "mm");
  }
  // A number that should be nothing.
  void HearForm(const std::string& what, double value_mm, double sigma_mm,
                std::optional<double> tolerance_mm, double decision_sigmas) {
    const ToleranceState state = Judge(value_mm, sigma_mm, tolerance_mm, decision_sigmas);
    Weigh(value_mm, sigma_mm, tolerance_mm, state);
    if (state == ToleranceState::kNotJudged || state == ToleranceState::kIn) return;
    Say(state, what + " " + Fixed(value_mm, 2) + " mm", value_mm, *tolerance_mm, sigma_mm, "mm");
  }
  // What is no number.
  void HearFact(bool out, std::string what) {
    out_ |= out;
    undecided_ |= !out;
    probability_ = 0;
    (out ? faults_ : doubts_).push_back(std::move(what));
  }
  Verdict verdict() const {
    return out_ ? Verdict::kFail : undecided_ ? Verdict::kUndecided : Verdict::kPass;
  }
  double probability() const { return probability_; }
  // What is out comes before what is undecided: alarm and status tell the first one only.
  std::vector<std::string> TakeReasons() {
    std::vector<std::string> reasons = std::move(faults_);
    std::move(doubts_.begin(), doubts_.end(), std::back_inserter(reasons));
    return reasons;
  }

 private:
  void Weigh(double value, double sigma, std::optional<double> tolerance, ToleranceState state) {
    if (state == ToleranceState::kNotJudged || !tolerance) return;
    probability_ *= ProbabilityWithin(value, sigma, *tolerance);
  }

  // What would decide a number that lies this far from its limit.
  std::string Mend(double value, double tolerance, const char* unit) const {
    constexpr double kLeast = 1e-3;  // [mm, degrees] no scan is better
    const double needed = std::abs(std::abs(value) - tolerance) / decision_sigmas_;
    if (needed >= kLeast) {
      return "; a scan that knows it to " + Fixed(needed, 3) + " " + unit +
             " (1 sigma) would: slower, or from more sides";
    }
    return "; it lies on the limit, and no scan will: [verdict] rule = \"simple\" takes it as it "
           "is "
           "measured";
  }

  void Say(ToleranceState state, std::string what, double value, double tolerance, double sigma,
           const char* unit) {
    const bool out = state == ToleranceState::kOut;
    out_ |= out;
    undecided_ |= !out;
    const int decimals = sigma < 0.01 ? 3 : 2;
    (out ? faults_ : doubts_)
        .push_back(std::move(what) + " (tolerance " + Fixed(tolerance, 2) + " " + unit +
                   ", 1 sigma " + Fixed(sigma, decimals) + ")" +
                   (out ? std::string()
                        : ": too close to the tolerance to decide" + Mend(value, tolerance, unit)));
  }

  double decision_sigmas_;
  double probability_ = 1;
  bool out_ = false;
  bool undecided_ = false;
  std::vector<std::string> faults_;
  std::vector<std::string> doubts_;
};

// "hole 1", and what the scan shows it to be where that is something else.
std::string FoundName(const OpeningInspection& opening) {
  if (opening.found_as == opening.named) return opening.name;
  const std::string found = " (found: a " + std::string(Name(opening.found_as));
  if (opening.found_as == OpeningKind::kHole) {
    return opening.name + found + " of " + Fixed(opening.length_mm.measured, 2) + " mm)";
  }
  return opening.name + found + " of " + Fixed(opening.length_mm.measured, 2) + " x " +
         Fixed(opening.width_mm.measured, 2) + " mm" +
         (opening.found_as == OpeningKind::kLeaningHole
              ? ", drilled " + Fixed(opening.lean_deg.measured, 1) +
                    " degrees off the wall's normal)"
              : ")");
}

void JudgeOpening(const OpeningInspection& opening, Jury& jury) {
  const std::string name = FoundName(opening);
  const bool is_round =
      opening.named == OpeningKind::kHole && opening.found_as == OpeningKind::kHole;
  jury.Hear(name + " place along the tube", opening.along_mm, "mm");
  jury.Hear(name + " angle around", opening.around_deg, "degrees");
  jury.Hear(name + (is_round ? " diameter" : " length"), opening.length_mm, "mm");
  jury.Hear(name + " width", opening.width_mm, "mm");
  jury.Hear(name + " length less width", opening.out_of_round_mm, "mm");
  jury.Hear(name + " axis", opening.axis_deg, "degrees");
}

void JudgeFeatures(const FeatureInspection& features, const NominalFeatures& nominal, Jury& jury) {
  for (const OpeningInspection& opening : features.openings) {
    if (opening.state == OpeningState::kMissing) {
      jury.HearFact(true, opening.name + " is missing: the scan shows the wall where it should be");
      continue;
    }
    if (opening.state == OpeningState::kNotSeen) {
      jury.HearFact(false, opening.name +
                               " was not found, and the scan hardly saw where it should be: scan "
                               "that side, or more slowly");
      continue;
    }
    JudgeOpening(opening, jury);
  }
  for (const EndInspection* end : {&features.first_end, &features.last_end}) {
    if (!nominal.obliquity_tolerance_deg) continue;
    const std::string name = end == &features.first_end ? "first end" : "last end";
    if (!end->is_known) {
      jury.HearFact(false, name + ": the scan shows too little of it to tell how it is cut");
      continue;
    }
    jury.Hear(name + " is cut", end->obliquity_deg, "degrees");
  }
}

// `reversed`: the measurement's start is the nominal's end.
void JudgeForm(const Measurement& measurement, const InspectionOptions& options, bool reversed,
               Jury& jury) {
  const Tolerances& tolerances = options.tolerances;
  for (std::size_t i = 0; i < measurement.straights.size(); ++i) {
    const std::size_t of = reversed ? measurement.straights.size() - 1 - i : i;
    const StraightForm& straight = measurement.straights[of];
    if (!(straight.length_mm > 0)) continue;
    jury.HearForm("straight " + std::to_string(i + 1) + " is bowed by", straight.height_mm,
                  straight.sigma_mm, tolerances.straightness_mm, options.decision_sigmas);
  }
  for (const DentFound& dent : measurement.dents) {
    const double along_mm =
        reversed ? hal::SpineLength(measurement.tube.program) - dent.along_mm : dent.along_mm;
    jury.HearForm("dent at " + Fixed(along_mm, 0) + " mm along the tube, depth", dent.depth_mm,
                  dent.sigma_mm, tolerances.dent_depth_mm, options.decision_sigmas);
  }
}

void Decide(const InspectionOptions& options, const Measurement& measurement, bool reversed,
            Inspection& inspection) {
  const double noise_mm = measurement.noise_mm;
  Jury jury(options.decision_sigmas);
  const std::size_t bends = inspection.rows.size() - 1;
  for (std::size_t i = 0; i < inspection.rows.size(); ++i) {
    const RowInspection& row = inspection.rows[i];
    jury.Hear(LengthName(i, bends), row.length_mm, "mm");
    jury.Hear(RotationName(i), row.rotation_deg, "degrees");
    jury.Hear(AngleName(i), row.angle_deg, "degrees");
    if (row.bend_radius_mm) {
      jury.Hear("bend " + std::to_string(i + 1) + " radius", *row.bend_radius_mm, "mm");
    }
  }
  jury.Hear("pipe radius", inspection.pipe_radius_mm, "mm");
  for (const EnvelopePoint& point : inspection.envelope) {
    jury.Hear("tangent point '" + point.name + "'", point.distance_mm, point.sigma_mm,
              options.tolerances.envelope_mm.value_or(0.0), point.state);
  }
  jury.Hear("surface", inspection.surface.p99_abs_mm, noise_mm,
            inspection.surface.tolerance_mm.value_or(0.0), inspection.surface.state);
  JudgeForm(measurement, options, reversed, jury);
  JudgeFeatures(inspection.features, options.features, jury);
  inspection.verdict = jury.verdict();
  inspection.probability = jury.probability();
  inspection.reasons = jury.TakeReasons();
}

// Everything after the direction is chosen; rows of both programs agree in number.
void InspectOneWay(const Measurement& measurement, const hal::BendProgram& nominal,
                   std::optional<double> nominal_pipe_radius_mm, const InspectionOptions& options,
                   bool reversed, Inspection& inspection) {
  inspection.measured = reversed ? ReverseTube(measurement.tube) : measurement.tube;
  const bool has_sigma = measurement.sigma.rows.size() == measurement.tube.program.rows.size();
  inspection.sigma = !has_sigma ? hal::BendProgram{}
                     : reversed ? ReverseProgram(measurement.sigma)
                                : measurement.sigma;
  inspection.alignment = AlignTubes(nominal, inspection.measured);
  inspection.rows = CompareRows(nominal, inspection.measured.program, inspection.sigma, options);
  const double measured_radius_mm = inspection.measured.pipe_radius_mm;
  const double radius_mm = nominal_pipe_radius_mm.value_or(measured_radius_mm);
  inspection.pipe_radius_mm =
      Compare(radius_mm, measured_radius_mm - radius_mm, measurement.pipe_radius_sigma_mm,
              nominal_pipe_radius_mm ? options.tolerances.pipe_radius_mm : std::nullopt,
              options.decision_sigmas);
  inspection.envelope =
      Envelope(nominal, inspection.measured, inspection.sigma, inspection.alignment,
               options.tolerances.envelope_mm, options.decision_sigmas);
  inspection.envelope_max_mm = 0;
  for (const EnvelopePoint& point : inspection.envelope) {
    inspection.envelope_max_mm = std::max(inspection.envelope_max_mm, point.distance_mm);
  }
  const double end_excess_mm = std::max(inspection.rows.front().length_mm.deviation,
                                        inspection.rows.back().length_mm.deviation);
  inspection.surface = DistancesFromSurface(
      measurement.surface, nominal, radius_mm, inspection.alignment.X_NW, end_excess_mm,
      measurement.noise_mm, options.tolerances.surface_mm, options.decision_sigmas);
  inspection.features = InspectFeatures(measurement, options.features, inspection.measured,
                                        reversed, options.decision_sigmas);
  Decide(options, measurement, reversed, inspection);
}

}  // namespace

std::string_view Name(Verdict verdict) {
  switch (verdict) {
    case Verdict::kPass:
      return "pass";
    case Verdict::kFail:
      return "fail";
    case Verdict::kUndecided:
      return "undecided";
  }
  return "unknown";
}

Inspection Inspect(const Measurement& measurement, const hal::BendProgram& nominal,
                   std::optional<double> nominal_pipe_radius_mm, const InspectionOptions& options) {
  Inspection inspection;
  inspection.direction =
      MatchDirection(nominal, measurement.tube.program, measurement.sigma, options.direction);
  const DirectionState state = inspection.direction.state;
  if (state == DirectionState::kWrongBends) {
    inspection.measured = measurement.tube;
    inspection.sigma = measurement.sigma;
    inspection.verdict = Verdict::kFail;
    inspection.reasons = {inspection.direction.message};
    return inspection;
  }
  const bool reversed = inspection.direction.reversed;
  InspectOneWay(measurement, nominal, nominal_pipe_radius_mm, options, reversed, inspection);
  if (inspection.direction.settled()) return inspection;
  if (state == DirectionState::kAmbiguous) {
    // Good either way round is good; bad must be bad either way round.
    if (inspection.verdict == Verdict::kFail) {
      Inspection other;
      InspectOneWay(measurement, nominal, nominal_pipe_radius_mm, options, !reversed, other);
      if (other.verdict != Verdict::kFail) inspection.verdict = Verdict::kUndecided;
    }
  } else {
    inspection.verdict = Verdict::kFail;
  }
  inspection.reasons.insert(inspection.reasons.begin(), inspection.direction.message);
  return inspection;
}

}  // namespace bendloop::pipeline
