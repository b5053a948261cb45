// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>

#include "hal/bend_program.h"
#include "pipeline/structure/nominal_die.h"
#include "pipeline/tube/measurement.h"

namespace bendloop::pipeline {

// Tells a person that the measured tube is another part than the nominal's: rows that are certainly
// others, the mirror image, or bends of another die, or that may be (`other_die`). Of another
// number of bends report_quality.h tells.
void SayOtherPart(const hal::BendProgram& nominal, const std::optional<OtherDie>& other_die,
                  Measurement& measurement);

}  // namespace bendloop::pipeline
