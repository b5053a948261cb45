// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "firmware-host/convert/tube_table.h"
#include "hal/pose.h"

// What the readers of text and of JSON hand to the part that they share.
namespace bendloop::host {

// A line of a table: x y z of XYZ, y b c of YBC, or length, rotation, angle.
struct TableRow {
  double values[3] = {};
  std::optional<double> bend_radius_mm;
};

struct RawTable {
  TableKind kind = TableKind::kLra;
  std::vector<TableRow> rows;  // mm and degrees
  hal::Pose X_WT;              // of pose
  double pipe_radius_mm = 0;
  pipeline::YbcStyle style;  // of ybc
  std::string note;          // for a person; empty: none
};

hal::Result<RawTable> ReadTextTableRows(std::string_view text, std::string_view name,
                                        const TableReadOptions& options);
hal::Result<RawTable> ReadJsonTableRows(std::string_view text, std::string_view name,
                                        const TableReadOptions& options);

}  // namespace bendloop::host
