// SPDX-License-Identifier: Apache-2.0
#include "pipeline/correction/limits.h"

#include <algorithm>
#include <cmath>

#include "pipeline/correction/tube_values.h"
#include "pipeline/math/text.h"

namespace bendloop::pipeline {

ChangeLimits::ChangeLimits(const CorrectionOptions& options, const RowValue& value,
                           std::size_t bends, bool lot_is_held, Correction& out)
    : options_(options),
      value_(value),
      name_(NameOf(value, bends)),
      lot_is_held_(lot_is_held),
      out_(out) {}

void ChangeLimits::Apply(double base, double scatter, double known, AxisCorrection& axis) const {
  Decide(scatter, known, axis);
  axis.corrected = axis.active + axis.applied;
  CheckTotal(base, axis);
  CheckPossible(axis);
  if (value_.kind == RowValueKind::kRotation) {
    axis.corrected = hal::WrapRotationDeg(axis.corrected);
  }
}

void ChangeLimits::Decide(double scatter, double known, AxisCorrection& axis) const {
  const double hold = OfKind(options_.hold_sigma, value_.kind);
  const double limit = OfKind(options_.step_limit, value_.kind);
  const char* unit = UnitOf(value_.kind);
  if (lot_is_held_) {
    axis.flags |= kFlagLotHeld;
    axis.applied = 0;
    return;
  }
  if (!(known <= hold)) {
    axis.flags |= kFlagUncertain;
    axis.applied = 0;
    out_.notices.push_back(name_ + " is known to " + Fixed(known, 2) + " " + unit +
                           " (1 sigma, from all parts of the lot), limit " + Fixed(hold, 2) +
                           ": it is held, the others are corrected");
    return;
  }
  axis.applied = OfKind(options_.gain, value_.kind) * axis.wanted;
  const double band =
      std::min(options_.deadband_sigmas * axis.sigma, options_.deadband_scatter * scatter);
  if (std::abs(axis.wanted) <= band) {
    axis.flags |= kFlagDeadband;
    axis.applied = 0;
  } else if (std::abs(axis.applied) > limit) {
    axis.flags |= kFlagStepLimit;
    axis.applied = std::copysign(limit, axis.applied);
    out_.notices.push_back(name_ + ": a change of " + Fixed(axis.wanted, 2) + " " + unit +
                           " is cut to the limit of one step, " + Fixed(axis.applied, 2));
  }
}

void ChangeLimits::CheckTotal(double base, AxisCorrection& axis) const {
  const double limit = OfKind(options_.total_limit, value_.kind);
  double from_base = axis.corrected - base;
  // The base on the turn nearest to the command.
  if (value_.kind == RowValueKind::kRotation) {
    from_base = hal::WrapRotationDeg(axis.active - base) + axis.applied;
  }
  if (std::abs(from_base) <= limit) return;
  axis.flags |= kFlagTotalLimit;
  out_.refusals.push_back(name_ + ": the corrected program would be " +
                          Fixed(std::abs(from_base), 2) + " " + UnitOf(value_.kind) +
                          " from the lot's first program, limit " + Fixed(limit, 2) +
                          " (check tube, die, clamp and nominal)");
}

void ChangeLimits::CheckPossible(AxisCorrection& axis) const {
  const char* why = nullptr;
  if (value_.kind == RowValueKind::kAngle && !(axis.corrected > 0 && axis.corrected < 360)) {
    why = "but a bend has more than 0 and less than 360";
  }
  if (value_.kind == RowValueKind::kLength && !(axis.corrected >= 0)) {
    why = "but no straight is shorter than 0";
  }
  if (why == nullptr) return;
  axis.flags |= kFlagImpossible;
  out_.refusals.push_back(name_ + ": the corrected program would need " + Fixed(axis.corrected, 2) +
                          " " + UnitOf(value_.kind) + ", " + why);
}

}  // namespace bendloop::pipeline
