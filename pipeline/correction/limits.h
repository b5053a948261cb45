// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "pipeline/correction/correction.h"
#include "pipeline/tube/joint_uncertainty.h"

namespace bendloop::pipeline {

// What becomes of a wanted change: `axis` has active, wanted and sigma, and gets applied, corrected
// and flags; notices and refusals go to `out`.
class ChangeLimits {
 public:
  ChangeLimits(const CorrectionOptions& options, const RowValue& value, std::size_t bends,
               bool lot_is_held, Correction& out);

  // `base`: of the lot's first program. `scatter`: 1 sigma of the bender in this value. `known`: 1
  // sigma of what the tube's value is known to, the scatter left out.
  void Apply(double base, double scatter, double known, AxisCorrection& axis) const;

 private:
  void Decide(double scatter, double known, AxisCorrection& axis) const;
  void CheckTotal(double base, AxisCorrection& axis) const;
  void CheckPossible(AxisCorrection& axis) const;

  const CorrectionOptions& options_;
  RowValue value_;
  std::string name_;
  bool lot_is_held_;
  Correction& out_;
};

}  // namespace bendloop::pipeline
