// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "hal/bend_program.h"
#include "pipeline/correction/correction_options.h"
#include "pipeline/correction/lot_filter.h"

namespace bendloop::pipeline {

// Probability that a value of the next tube is in tolerance, 0..1; 1 where it has none.
struct RowForecast {
  double length_mm = 1;
  double rotation_deg = 1;
  double angle_deg = 1;
};

struct Forecast {
  std::vector<RowForecast> rows;  // none: there is nothing to forecast by
  double part = 0;                // that all of its values are
};

// Of the tube that `program` will be bent to, as the acting beliefs have it. Values that slip or
// jump meanwhile are counted in by how often this part's lots have shown it.
Forecast MakeForecast(const hal::BendProgram& nominal, const hal::BendProgram& program,
                      const std::vector<ActingBelief>& acting, const LotState& lot, unsigned ahead,
                      const CorrectionOptions& options);

}  // namespace bendloop::pipeline
