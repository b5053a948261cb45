// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/result/program_json.h"

#include <limits>

namespace bendloop::host {
namespace {

Json Row(double length_mm, double rotation_deg, double angle_deg, std::optional<double> radius_mm) {
  return {{"length_mm", Number(length_mm)},
          {"rotation_deg", Number(rotation_deg)},
          {"angle_deg", Number(angle_deg)},
          {"bend_radius_mm", radius_mm ? Number(*radius_mm) : Json(nullptr)}};
}

}  // namespace

Json RowsJson(const hal::BendProgram& program) {
  Json rows = Json::array();
  for (const auto& row : program.rows) {
    rows.push_back(Row(row.length_mm, row.rotation_deg, row.angle_deg, row.bend_radius_mm));
  }
  return rows;
}

Json SigmaRowsJson(const hal::BendProgram& sigma, const hal::BendProgram& shape) {
  constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();
  Json rows = Json::array();
  for (std::size_t i = 0; i < shape.rows.size(); ++i) {
    const bool known = i < sigma.rows.size();
    const bool last = i + 1 == shape.rows.size();
    const hal::BendRow row = known ? sigma.rows[i] : hal::BendRow{kUnknown, kUnknown, kUnknown, {}};
    const bool has_radius = shape.rows[i].bend_radius_mm && row.bend_radius_mm;
    rows.push_back(Row(row.length_mm, i == 0 || last ? 0 : row.rotation_deg,
                       last ? 0 : row.angle_deg,
                       has_radius ? row.bend_radius_mm : std::optional<double>()));
  }
  return rows;
}

hal::BendProgram ReadRows(const JsonReader& rows) {
  hal::BendProgram program;
  for (std::size_t i = 0, n = rows.Size(kMaxRows); i < n; ++i) {
    const JsonReader row = rows.Item(i);
    program.rows.push_back({row.At("length_mm").Number(), row.At("rotation_deg").Number(),
                            row.At("angle_deg").Number(), row.At("bend_radius_mm").NumberOrNull()});
  }
  return program;
}

}  // namespace bendloop::host
