// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "firmware-host/cloud/point_cloud.h"
#include "hal/result.h"
#include "hal/tube.h"
#include "pipeline/tube/representations.h"

namespace bendloop::host {

// The representations of a tube that people and machines exchange.
enum class TableKind {
  kXyz,   // control polygon: ends and intersection points
  kLra,   // length, rotation, angle in this project's convention
  kYbc,   // the same as a machine counts it (pipeline::YbcStyle)
  kPose,  // start point, orientation, LRA
};

enum class TableFormat { kText, kCsv, kJson };

std::string_view Name(TableKind kind);

// Larger files are no tube.
inline constexpr std::size_t kMaxTableBytes = std::size_t{16} << 20;
inline constexpr std::size_t kMaxTableRows = 10'000;

struct TableReadOptions {
  std::optional<TableKind> from;         // empty: columns or keys decide
  Units units = Units::kMillimetres;     // of all lengths in text; JSON says mm in its keys
  std::optional<double> bend_radius_mm;  // where the file has none; 0: sharp corners
  pipeline::YbcStyle style;              // of YBC in text; JSON of ours carries its own
  // Of results: the rows as the scan came along the tube, although the nominal's order is known.
  bool in_scan_order = false;
};

struct TubeTable {
  hal::Tube tube;  // a bend without a radius is a sharp corner
  TableKind kind = TableKind::kLra;
  bool radii_known = true;         // every bend has a radius, or was said to be a sharp corner
  std::vector<std::string> notes;  // for a person, one sentence each
};

// Reads text, CSV or JSON; `name` is the file's name for errors. kBadInput says where (line or JSON
// pointer), what was found and what was expected.
hal::Result<TubeTable> ReadTubeTable(std::string_view text, std::string_view name,
                                     const TableReadOptions& options);

struct TableWriteOptions {
  TableKind to = TableKind::kLra;
  TableFormat format = TableFormat::kText;
  pipeline::YbcStyle style;     // of YBC
  std::optional<int> decimals;  // empty: 4 in text, 6 in CSV and JSON
};

// kBadInput when the tube has no such representation (XYZ of a bend of 180 degrees).
hal::Result<std::string> WriteTubeTable(const hal::Tube& tube, const TableWriteOptions& options);

}  // namespace bendloop::host
