// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "drivers/register_bender/register_image.h"
#include "drivers/simulated_bender/rule_mutant.h"
#include "hal/register_map.h"

namespace bendloop::drivers {

// What the mutants of R3 make of the rows in `area`: clipped, rounded, cut.
void SpoilRows(const hal::RegisterMap& map, const hal::ProgramArea& area,
               const RuleMutantSet& mutants, RegisterImage& image);

// Adds half a degree to the angle of the first row (takes it away where it does not fit).
void BendFirstRow(const hal::RegisterMap& map, const hal::ProgramArea& area, RegisterImage& image);

}  // namespace bendloop::drivers
