// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <string>

#include "firmware-host/convert/table_rows.h"
#include "firmware-host/result/json_reader.h"
#include "firmware-host/result/sections.h"

namespace bendloop::host {
namespace {

double Finite(const JsonReader& json) {
  const double value = json.Number();
  if (!std::isfinite(value)) json.Wrong("a number");
  return value;
}

double FiniteOr(const JsonReader& json, const char* key, double missing) {
  return json.Has(key) ? Finite(json.At(key)) : missing;
}

std::optional<double> Radius(const JsonReader& json) {
  if (!json.Has("bend_radius_mm")) return std::nullopt;
  return Finite(json.At("bend_radius_mm"));
}

void ReadPoints(const JsonReader& points, RawTable& table) {
  for (std::size_t i = 0, n = points.Size(kMaxTableRows); i < n; ++i) {
    const JsonReader item = points.Item(i);
    const bool bare = item.json().is_array();
    const Eigen::Vector3d p = ReadPoint(bare ? item : item.At("position_mm"));
    if (!p.allFinite()) item.Wrong("three numbers");
    table.rows.push_back({{p.x(), p.y(), p.z()}, bare ? std::nullopt : Radius(item)});
  }
}

void ReadLraRows(const JsonReader& rows, RawTable& table) {
  for (std::size_t i = 0, n = rows.Size(kMaxTableRows); i < n; ++i) {
    const JsonReader row = rows.Item(i);
    const bool last = i + 1 == n;
    const double angle_deg = last ? FiniteOr(row, "angle_deg", 0) : Finite(row.At("angle_deg"));
    const double rotation_deg =
        last || i == 0 ? FiniteOr(row, "rotation_deg", 0) : Finite(row.At("rotation_deg"));
    table.rows.push_back({{Finite(row.At("length_mm")), rotation_deg, angle_deg}, Radius(row)});
  }
}

void ReadYbcRows(const JsonReader& rows, RawTable& table) {
  for (std::size_t i = 0, n = rows.Size(kMaxTableRows); i < n; ++i) {
    const JsonReader row = rows.Item(i);
    table.rows.push_back(
        {{Finite(row.At("y_mm")), Finite(row.At("b_deg")), Finite(row.At("c_deg"))}, Radius(row)});
  }
}

// Our own files say how the machine counts; others are as the caller says.
void ReadStyle(const JsonReader& json, pipeline::YbcStyle& style) {
  if (json.Has("length")) {
    const std::string length = json.At("length").Text();
    if (length == "incremental") {
      style.feed = pipeline::FeedCount::kIncremental;
    } else if (length == "cumulative") {
      style.feed = pipeline::FeedCount::kAlongSpine;
    } else if (length == "straights") {
      style.feed = pipeline::FeedCount::kStraights;
    } else {
      json.At("length").WrongText("\"incremental\", \"cumulative\" or \"straights\"");
    }
  }
  if (json.Has("rotation")) {
    const std::string rotation = json.At("rotation").Text();
    if (rotation == "incremental") {
      style.rotation = pipeline::RotationCount::kIncremental;
    } else if (rotation == "cumulative") {
      style.rotation = pipeline::RotationCount::kCumulative;
    } else {
      json.At("rotation").WrongText("\"incremental\" or \"cumulative\"");
    }
  }
  if (json.Has("rotation_sign")) {
    const double sign = json.At("rotation_sign").Number();
    if (sign != 1 && sign != -1) json.At("rotation_sign").Wrong("1 or -1");
    style.rotation_sign = sign < 0 ? -1 : 1;
  }
}

// A result has its tube twice: as it was scanned, and, where it was inspected, in the nominal's
// order. The bender and the drawing know the second only.
JsonReader TubeOf(const JsonReader& result, bool in_scan_order, std::string& note) {
  const JsonReader tube = result.At("tube");
  if (!result.Has("inspection") || !result.At("inspection").Has("measured")) {
    note = "rows in the order of the scan: the result knows no nominal; --reverse turns them round";
    return tube;
  }
  const JsonReader inspection = result.At("inspection");
  const std::string state =
      inspection.Has("direction") ? inspection.At("direction").At("state").Text() : "";
  if (state != "forward" && state != "reverse") {
    note = "rows in the order of the scan: which end is the nominal's first is not settled (" +
           state.substr(0, 40) + "); --reverse turns them round";
    return tube;
  }
  const bool reversed = state == "reverse";
  if (in_scan_order) {
    note = std::string("rows in the order of the scan, ") +
           (reversed ? "against the nominal's" : "which is the nominal's, too");
    return tube;
  }
  note = std::string("rows in the nominal's order") +
         (reversed ? "; the scan came from the other end" : "");
  return inspection.At("measured");
}

TableKind KindOf(const JsonReader& json, const TableReadOptions& options) {
  if (json.Has("points")) return TableKind::kXyz;
  if (json.Has("orientation_wxyz")) return TableKind::kPose;
  if (json.Has("rows") && json.At("rows").json().is_array() && !json.At("rows").json().empty() &&
      json.At("rows").Item(0).json().is_object() && json.At("rows").Item(0).Has("y_mm")) {
    return TableKind::kYbc;
  }
  return options.from == TableKind::kYbc ? TableKind::kYbc : TableKind::kLra;
}

}  // namespace

hal::Result<RawTable> ReadJsonTableRows(std::string_view text, std::string_view name,
                                        const TableReadOptions& options) {
  Json root;
  try {
    root = Json::parse(text);
  } catch (const Json::parse_error& error) {
    const std::size_t byte = std::min(text.size(), error.byte);
    const auto line = 1 + std::count(text.begin(), text.begin() + static_cast<long>(byte), '\n');
    return hal::Fail(hal::ErrorKind::kBadInput, std::string(name) + ":" + std::to_string(line) +
                                                    ": byte " + std::to_string(byte) +
                                                    ": not JSON; expected a table or a result");
  } catch (const Json::out_of_range&) {
    return hal::Fail(
        hal::ErrorKind::kBadInput,
        std::string(name) + ": a number does not fit 64 bits; expected mm and degrees");
  }
  if (options.units != Units::kMillimetres) {
    return hal::Fail(hal::ErrorKind::kUsage,
                     std::string(name) + ": JSON is in mm, as its keys say; expected --units mm");
  }
  std::optional<hal::Error> error;
  const JsonReader top(root, name, error);
  const bool result = top.Has("tube");  // a result or what has one's shape
  RawTable table;
  const JsonReader json = result ? TubeOf(top, options.in_scan_order, table.note) : top;
  table.style = options.style;
  table.kind = KindOf(json, options);
  switch (table.kind) {
    case TableKind::kXyz:
      ReadPoints(json.At("points"), table);
      break;
    case TableKind::kYbc:
      ReadStyle(json, table.style);
      ReadYbcRows(json.At("rows"), table);
      break;
    case TableKind::kPose:
      table.X_WT.position_mm = ReadPoint(json.At("position_mm"));
      table.X_WT.orientation = ReadOrientation(json.At("orientation_wxyz"));
      [[fallthrough]];
    case TableKind::kLra:
      table.pipe_radius_mm = FiniteOr(json, "pipe_radius_mm", 0);
      ReadLraRows(json.At("rows"), table);
      break;
  }
  if (error) return hal::Fail(*error);
  if (!table.X_WT.position_mm.allFinite()) {
    return hal::Fail(hal::ErrorKind::kBadInput,
                     std::string(name) + "/position_mm: found null, expected three numbers");
  }
  // A pose holds an LRA program; anything else is not what was asked for.
  const bool part_of_it = options.from == TableKind::kLra && table.kind == TableKind::kPose;
  if (options.from && *options.from != table.kind && !part_of_it) {
    return hal::Fail(hal::ErrorKind::kBadInput, std::string(name) + ": found " +
                                                    std::string(Name(table.kind)) + ", expected " +
                                                    std::string(Name(*options.from)) + " (--from)");
  }
  if (part_of_it) table.kind = TableKind::kLra;
  return table;
}

}  // namespace bendloop::host
