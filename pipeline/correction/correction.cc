// SPDX-License-Identifier: Apache-2.0
#include "pipeline/correction/correction.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "pipeline/correction/limits.h"
#include "pipeline/correction/lot_filter.h"
#include "pipeline/correction/measured_covariance.h"
#include "pipeline/correction/tube_values.h"
#include "pipeline/math/text.h"

namespace bendloop::pipeline {
namespace {

bool IsFinite(const hal::BendProgram& program) {
  return std::all_of(program.rows.begin(), program.rows.end(), [](const hal::BendRow& row) {
    return std::isfinite(row.length_mm) && std::isfinite(row.rotation_deg) &&
           std::isfinite(row.angle_deg) && std::isfinite(row.bend_radius_mm.value_or(0.0));
  });
}

bool FitsRows(const LotState& lot, std::size_t rows) {
  if (lot.hypotheses.empty()) return true;
  const auto size =
      static_cast<std::size_t>(LotLayout::Size(TubeValues(rows == 0 ? 0 : rows - 1).size()));
  return lot.base.rows.size() == rows &&
         std::all_of(lot.hypotheses.begin(), lot.hypotheses.end(), [&](const auto& hypothesis) {
           return hypothesis.mean.size() == size &&
                  hypothesis.covariance.size() == size * (size + 1) / 2;
         });
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
  if (!FitsRows(lot, rows)) {
    return bad("the lot was started with " + std::to_string(lot.base.rows.size()) +
               " rows, the nominal has " + std::to_string(rows) + "; start a new lot");
  }
  if (!IsFinite(input.nominal) || !IsFinite(input.commanded) || !IsFinite(input.measured) ||
      !IsFinite(input.active) || !IsFinite(lot.base)) {
    return bad("a value that is not a finite number in nominal, commanded or measured rows");
  }
  return {};
}

// Why a value is not corrected at all, whatever was measured; 0: it is.
std::uint32_t FlagOf(const CorrectionInput& input, const RowValue& value,
                     const CorrectionOptions& options) {
  const auto& [row, kind] = value;
  if (OfKind(options.gain, kind) <= 0) return kFlagNotCorrected;
  if (kind == RowValueKind::kAngle) {
    const bool no_bend =
        input.nominal.rows[row].angle_deg == 0 && input.commanded.rows[row].angle_deg == 0;
    return no_bend ? std::uint32_t{kFlagNotCorrected} : 0u;
  }
  if (kind != RowValueKind::kRotation) return 0;
  const double smallest_deg =
      std::min({input.nominal.rows[row - 1].angle_deg, input.nominal.rows[row].angle_deg,
                input.measured.rows[row - 1].angle_deg, input.measured.rows[row].angle_deg});
  return smallest_deg < options.least_angle_deg ? std::uint32_t{kFlagNoMeaning} : 0u;
}

double Difference(RowValueKind kind, double a, double b) {
  return kind == RowValueKind::kRotation ? hal::WrapRotationDeg(a - b) : a - b;
}

SeenPart PartOf(const CorrectionInput& input, const CorrectionOptions& options) {
  const TubeValues values(input.nominal.bend_count());
  const std::vector<double> measured_deg = Angles(input.measured);
  const Eigen::VectorXd model = ModelValues(input.commanded, measured_deg, options.material);
  SeenPart part;
  part.matrix = ObservationMatrix(input.commanded, measured_deg);
  part.parts = input.since_last;
  part.off.resize(model.size());
  for (std::size_t j = 0; j < values.size(); ++j) {
    const auto [row, kind] = values[j];
    const auto at = Eigen::Index(j);
    part.off[at] = Difference(kind, ValueOf(input.measured.rows[row], kind), model[at]);
    part.is_known.push_back(FlagOf(input, values[j], options) != kFlagNoMeaning);
  }
  hal::BendProgram sigma = input.sigma;
  sigma.rows.resize(input.nominal.rows.size());
  part.covariance = MeasuredCovariance(sigma, input.correlations);
  return part;
}

AxisCorrection& AxisOf(std::vector<RowCorrection>& rows, const RowValue& value) {
  RowCorrection& row = rows[value.row];
  if (value.kind == RowValueKind::kAngle) return row.angle_deg;
  return value.kind == RowValueKind::kRotation ? row.rotation_deg : row.length_mm;
}

// Aims the active program at the nominal.
class Aim {
 public:
  Aim(const CorrectionInput& input, const CorrectionOptions& options, const LotState& before,
      Correction& out)
      : input_(input),
        options_(options),
        values_(input.nominal.bend_count()),
        active_(input.active.rows.empty() ? input.commanded : input.active),
        acting_(ActingBeliefs(out.next, input.ahead)),
        belief_(Mixture(acting_)),
        before_(before),
        out_(out) {
    matrix_ = ObservationMatrix(active_, Angles(input.nominal));
    off_ = matrix_ * belief_.mean;
    sigma_ = (matrix_ * belief_.covariance)
                 .cwiseProduct(matrix_)
                 .rowwise()
                 .sum()
                 .cwiseMax(0.0)
                 .cwiseSqrt();
    out_.corrected = active_;
    out_.rows.resize(input.nominal.rows.size());
  }

  void Make() {
    DescribeEnds();
    // Angles first: the lengths depend on what they will become.
    std::vector<double> angles_deg = Angles(input_.measured);
    for (std::size_t j = 0; j < values_.size(); ++j) {
      if (values_[j].kind == RowValueKind::kLength) break;
      AimAt(j, angles_deg);
      if (values_[j].kind != RowValueKind::kAngle) continue;
      const AxisCorrection& axis = AxisOf(out_.rows, values_[j]);
      if (axis.flags & kFlagNotCorrected) continue;
      angles_deg[values_[j].row] =
          options_.material.AngleAfterDeg(axis.corrected) + off_[Eigen::Index(j)];
    }
    for (std::size_t row = 0; row <= values_.bends(); ++row) {
      AimAt(values_.Length(row), angles_deg);
    }
    for (std::size_t i = 0; i < out_.rows.size(); ++i) {
      const RowCorrection& row = out_.rows[i];
      out_.corrected.rows[i].length_mm = row.length_mm.corrected;
      out_.corrected.rows[i].rotation_deg = row.rotation_deg.corrected;
      out_.corrected.rows[i].angle_deg = row.angle_deg.corrected;
      out_.changes_anything |=
          row.length_mm.applied != 0 || row.rotation_deg.applied != 0 || row.angle_deg.applied != 0;
    }
    out_.forecast =
        MakeForecast(input_.nominal, out_.corrected, acting_, out_.next, input_.ahead, options_);
  }

 private:
  // The first rotation, and the last row's: kept as they are.
  void DescribeEnds() {
    const auto keep = [&](AxisCorrection& axis, double commanded, double active) {
      axis.commanded = commanded;
      axis.active = axis.corrected = active;
      axis.flags = kFlagNotCorrected;
    };
    const std::size_t last = values_.bends();
    for (const std::size_t row : {std::size_t{0}, last}) {
      keep(out_.rows[row].rotation_deg, input_.commanded.rows[row].rotation_deg,
           active_.rows[row].rotation_deg);
    }
    keep(out_.rows[last].angle_deg, input_.commanded.rows[last].angle_deg,
         active_.rows[last].angle_deg);
  }

  void AimAt(std::size_t j, const std::vector<double>& angles_deg) {
    const auto [row, kind] = values_[j];
    const auto at = Eigen::Index(j);
    AxisCorrection& axis = AxisOf(out_.rows, values_[j]);
    const double nominal = ValueOf(input_.nominal.rows[row], kind);
    axis.commanded = ValueOf(input_.commanded.rows[row], kind);
    axis.active = axis.corrected = ValueOf(active_.rows[row], kind);
    axis.deviation = Difference(kind, nominal, ValueOf(input_.measured.rows[row], kind));
    axis.flags = FlagOf(input_, values_[j], options_);
    if (axis.flags != 0) return;
    double slope = 1;
    if (kind == RowValueKind::kAngle) {
      // What the coil does besides changes with the command itself.
      slope = options_.material.AngleSlope() + CoilSlope();
      axis.wanted = (nominal - options_.material.AngleAfterDeg(axis.active) - off_[at]) / slope;
    } else if (kind == RowValueKind::kRotation) {
      axis.wanted = hal::WrapRotationDeg(nominal - off_[at] - axis.active);
    } else {
      axis.wanted =
          nominal - off_[at] - StretchMm(active_, angles_deg, row, options_.material) - axis.active;
    }
    axis.sigma = sigma_[at] / slope;
    if (kind == RowValueKind::kLength && nominal <= 0 && axis.active + axis.wanted < 0) {
      axis.flags |= kFlagAtZero;
      axis.wanted = -axis.active;
    }
    axis.gain = Gain(at);
    const double scatter = OfKind(out_.next.hypotheses.front().scatter, kind);
    ChangeLimits(options_, values_[j], values_.bends(), out_.next.held, out_)
        .Apply(ValueOf(before_.base.rows[row], kind), scatter, sigma_[at], axis);
  }

  // d off / d command, the same for every angle.
  double CoilSlope() const {
    hal::BendProgram one = active_;
    for (hal::BendRow& row : one.rows) row.angle_deg += 1;
    if (values_.bends() == 0) return 0;
    const Eigen::MatrixXd there = ObservationMatrix(one, Angles(input_.nominal));
    return (there.row(0) - matrix_.row(0)).dot(belief_.mean);
  }

  // Of one part: how much less is open than before it.
  double Gain(Eigen::Index at) const {
    const std::vector<ActingBelief> earlier = ActingBeliefs(before_, input_.since_last);
    const LotBelief before = Mixture(earlier);
    const double open = (matrix_.row(at) * before.covariance).dot(matrix_.row(at));
    const double left = sigma_[at] * sigma_[at];
    return open > 0 ? std::clamp(1 - left / open, 0.0, 1.0) : 0.0;
  }

  const CorrectionInput& input_;
  const CorrectionOptions& options_;
  TubeValues values_;
  const hal::BendProgram& active_;
  std::vector<ActingBelief> acting_;
  LotBelief belief_;
  const LotState& before_;
  Correction& out_;
  Eigen::MatrixXd matrix_;
  Eigen::VectorXd off_;    // of the next tube's values from the material model
  Eigen::VectorXd sigma_;  // of them
};

// What a setter should know of how this part was taken.
void Tell(const LotState& lot, std::size_t bends, Correction& out) {
  const LotHypothesis& best = out.next.hypotheses.front();
  const TubeValues values(bends);
  std::string names;
  for (const std::uint32_t j : best.values) {
    names += (names.empty() ? "" : ", ") + NameOf(values[j], bends);
  }
  if (names.empty()) names = "springback or stretch of the whole tube";
  if (best.event != LotEvent::kNone && best.parts_since == 0) {
    for (const std::uint32_t j : best.values) {
      AxisOf(out.rows, values[j]).flags |= kFlagUnexpected;
    }
    out.notices.push_back(names + ": far off what the lot's parts so far predict. Nothing is " +
                          "changed for one tube that may have slipped; if the next one is like "
                          "it, it is a jump and will be followed (a new coil or tool: announce it "
                          "with 'bendloop lot new')");
  }
  const bool was_open = !lot.hypotheses.empty() && lot.hypotheses.front().parts_since == 0 &&
                        lot.hypotheses.front().event != LotEvent::kNone;
  if (!was_open || best.parts_since != 1) return;
  if (best.event == LotEvent::kSlip) {
    out.notices.push_back("the tube before slipped (" + names + "): nothing was learnt from that");
  } else if (best.event != LotEvent::kNone) {
    out.notices.push_back(std::string(Name(best.event)) + " since the tube before (" + names +
                          "): it is followed from now on");
  }
}

}  // namespace

hal::Result<Correction> Correct(const CorrectionInput& input, const LotState& lot,
                                const CorrectionOptions& options) {
  if (const auto ok = CheckInput(input, lot, options); !ok) return hal::Fail(ok.error());
  LotState before = lot;
  if (lot.hypotheses.empty()) {
    before = StartLot(input.nominal, input.commanded, options);
    before.held = lot.held;
  }
  Correction out;
  out.next = LearnPart(before, PartOf(input, options), options);
  Aim(input, options, before, out).Make();
  Tell(before, input.nominal.bend_count(), out);
  if (out.next.held) {
    out.notices.push_back("the lot is held: it is learnt from, and no program is changed");
  }
  return out;
}

std::string FlagNames(std::uint32_t flags) {
  constexpr std::pair<CorrectionFlag, const char*> kNames[] = {
      {kFlagDeadband, "deadband"},      {kFlagStepLimit, "step limit"},
      {kFlagTotalLimit, "total limit"}, {kFlagNotCorrected, "not corrected"},
      {kFlagNoMeaning, "no meaning"},   {kFlagImpossible, "impossible"},
      {kFlagAtZero, "at zero"},         {kFlagUnexpected, "unexpected"},
      {kFlagUncertain, "uncertain"},    {kFlagLotHeld, "lot held"},
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
