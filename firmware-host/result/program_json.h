// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "firmware-host/result/json.h"
#include "firmware-host/result/json_reader.h"
#include "hal/bend_program.h"

namespace bendloop::host {

// The rows of a program as an array of {length_mm, rotation_deg, angle_deg, bend_radius_mm}, each
// to 1e-6; the radius is null where there is none.
Json RowsJson(const hal::BendProgram& program);

// The same for 1 sigma of a program, in the shape of `shape`: what is missing or not finite is
// null, the rotation of the first row is 0 and so are the angle and rotation of the last.
Json SigmaRowsJson(const hal::BendProgram& sigma, const hal::BendProgram& shape);

// Reads the rows that RowsJson and SigmaRowsJson write; null numbers are NaN. Wrong ones are kept
// in the reader's error.
hal::BendProgram ReadRows(const JsonReader& rows);

}  // namespace bendloop::host
