// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "config/cell_config.h"
#include "config/field_visitor.h"
#include "config/part_config.h"
#include "hal/register_map.h"

namespace bendloop::config {

// Every key of each file, once; README.md lists them for people. `schema` is the caller's.
void VisitCell(FieldVisitor& v, CellConfig& cell);
void VisitPart(FieldVisitor& v, PartConfig& part);
void VisitRegisterMap(FieldVisitor& v, hal::RegisterMap& map);

inline constexpr std::size_t kMaxRows = 200;  // of a nominal; the largest benders take about 100

}  // namespace bendloop::config
