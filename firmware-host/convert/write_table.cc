// SPDX-License-Identifier: Apache-2.0
#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "firmware-host/convert/tube_table.h"
#include "firmware-host/result/json.h"
#include "firmware-host/text/table.h"

namespace bendloop::host {
namespace {

// An error of 1e-9 moves the end of a tube of a metre by a nanometre.
constexpr int kOrientationDecimals = 9;
constexpr const char* kSchema = "bendloop.convert/1";

using Value = std::pair<std::string, std::optional<double>>;  // column and number, if there is one
using Content = std::vector<std::vector<Value>>;              // the rows of every format

// A rotation of -179.99999 degrees must not be written as -180, which is outside of (-180, 180],
// nor one of 359.99999 as 360.
double InRangeWhenWritten(double rotation_deg, bool cumulative, int decimals) {
  const double half_a_step = 0.5 * std::pow(10.0, -decimals);
  if (cumulative) return rotation_deg >= 360.0 - half_a_step ? 0.0 : rotation_deg;
  return rotation_deg <= -180.0 + half_a_step ? 180.0 : rotation_deg;
}

hal::Result<Content> ContentOf(const hal::Tube& tube, const TableWriteOptions& options,
                               int decimals) {
  Content content;
  if (options.to == TableKind::kXyz) {
    const auto polygon = pipeline::PolygonFromTube(tube);
    if (!polygon) return hal::Fail(polygon.error());
    const std::size_t n = polygon->points_mm.size();
    for (std::size_t i = 0; i < n; ++i) {
      const Eigen::Vector3d& p = polygon->points_mm[i];
      const bool end = i == 0 || i + 1 == n;
      content.push_back({{"x_mm", p.x()},
                         {"y_mm", p.y()},
                         {"z_mm", p.z()},
                         {"bend_radius_mm", end ? std::nullopt : polygon->bend_radii_mm[i - 1]}});
    }
    return content;
  }
  if (options.to == TableKind::kYbc) {
    const auto ybc = pipeline::YbcFromProgram(tube.program, options.style);
    if (!ybc) return hal::Fail(ybc.error());
    for (const pipeline::YbcRow& row : *ybc) {
      content.push_back(
          {{"y_mm", row.y_mm},
           {"b_deg", InRangeWhenWritten(
                         row.b_deg, options.style.rotation == pipeline::RotationCount::kCumulative,
                         decimals)},
           {"c_deg", row.c_deg},
           {"bend_radius_mm", row.bend_radius_mm}});
    }
    return content;
  }
  for (const hal::BendRow& row : tube.program.rows) {
    content.push_back({{"length_mm", row.length_mm},
                       {"rotation_deg", InRangeWhenWritten(row.rotation_deg, false, decimals)},
                       {"angle_deg", row.angle_deg},
                       {"bend_radius_mm", row.bend_radius_mm}});
  }
  return content;
}

const char* NameOf(pipeline::FeedCount feed) {
  switch (feed) {
    case pipeline::FeedCount::kIncremental:
      return "incremental";
    case pipeline::FeedCount::kAlongSpine:
      return "cumulative";
    case pipeline::FeedCount::kStraights:
      return "straights";
  }
  return "unknown";
}

const char* NameOf(pipeline::RotationCount rotation) {
  return rotation == pipeline::RotationCount::kCumulative ? "cumulative" : "incremental";
}

Eigen::Quaterniond WithPositiveW(Eigen::Quaterniond q) {
  if (q.w() < 0) q.coeffs() = -q.coeffs();
  return q;
}

std::string Joined(const std::string& key, const std::vector<double>& values, char delimiter,
                   int decimals) {
  std::string line = key;
  for (const double value : values) line += delimiter + Fixed(value, decimals);
  return line + "\n";
}

// Lines of a pose that stand before its rows.
std::string PoseLines(const hal::Tube& tube, char delimiter, int decimals) {
  const Eigen::Vector3d& p = tube.X_WT.position_mm;
  const Eigen::Quaterniond q = WithPositiveW(tube.X_WT.orientation);
  std::string lines;
  if (tube.pipe_radius_mm > 0) {
    lines += Joined("pipe_radius_mm", {tube.pipe_radius_mm}, delimiter, decimals);
  }
  lines += Joined("position_mm", {p.x(), p.y(), p.z()}, delimiter, decimals);
  lines +=
      Joined("orientation_wxyz", {q.w(), q.x(), q.y(), q.z()}, delimiter, kOrientationDecimals);
  return lines;
}

std::string TextOf(const Content& content, const hal::Tube& tube, const TableWriteOptions& options,
                   int decimals) {
  std::string text;
  if (options.to == TableKind::kYbc) {
    text += std::string("# y ") + NameOf(options.style.feed) + ", b " +
            NameOf(options.style.rotation) + ", rotation sign " +
            (options.style.rotation_sign < 0 ? "-1" : "+1") + "\n";
  }
  if (options.to == TableKind::kPose) text += PoseLines(tube, ' ', decimals);
  std::vector<Column> columns;
  for (const auto& [name, value] : content.front()) columns.push_back({name, Align::kDecimal});
  Table table(columns);
  for (const auto& row : content) {
    std::vector<Cell> cells;
    for (const auto& [name, value] : row) cells.emplace_back(value ? Fixed(*value, decimals) : "-");
    table.Add(std::move(cells));
  }
  return text + table.Render(/*colour=*/false, /*indent=*/0);
}

std::string CsvOf(const Content& content, const hal::Tube& tube, const TableWriteOptions& options,
                  int decimals) {
  std::string csv;
  if (options.to == TableKind::kPose) csv += PoseLines(tube, ',', decimals);
  const auto& first = content.front();
  for (std::size_t i = 0; i < first.size(); ++i) csv += (i ? "," : "") + first[i].first;
  csv += "\n";
  for (const auto& row : content) {
    for (std::size_t i = 0; i < row.size(); ++i) {
      csv += i ? "," : "";
      if (row[i].second) csv += Fixed(*row[i].second, decimals);
    }
    csv += "\n";
  }
  return csv;
}

std::string JsonOf(const Content& content, const hal::Tube& tube, const TableWriteOptions& options,
                   int decimals) {
  Json json = {{"schema", kSchema}, {"kind", Name(options.to)}};
  const auto number = [&](const std::optional<double>& value) {
    return value ? Number(*value, decimals) : Json(nullptr);
  };
  if (options.to == TableKind::kYbc) {
    json["length"] = NameOf(options.style.feed);
    json["rotation"] = NameOf(options.style.rotation);
    json["rotation_sign"] = options.style.rotation_sign;
  }
  if (options.to == TableKind::kPose) {
    const Eigen::Quaterniond q = WithPositiveW(tube.X_WT.orientation);
    const Eigen::Vector3d& p = tube.X_WT.position_mm;
    if (tube.pipe_radius_mm > 0) json["pipe_radius_mm"] = number(tube.pipe_radius_mm);
    json["position_mm"] = {number(p.x()), number(p.y()), number(p.z())};
    json["orientation_wxyz"] = {
        Number(q.w(), kOrientationDecimals), Number(q.x(), kOrientationDecimals),
        Number(q.y(), kOrientationDecimals), Number(q.z(), kOrientationDecimals)};
  }
  Json rows = Json::array();
  for (const auto& row : content) {
    if (options.to == TableKind::kXyz) {
      rows.push_back(
          {{"position_mm", {number(row[0].second), number(row[1].second), number(row[2].second)}},
           {row[3].first, number(row[3].second)}});
      continue;
    }
    Json object = Json::object();
    for (const auto& [name, value] : row) object[name] = number(value);
    rows.push_back(std::move(object));
  }
  json[options.to == TableKind::kXyz ? "points" : "rows"] = std::move(rows);
  return Dump(json, 2) + "\n";
}

}  // namespace

hal::Result<std::string> WriteTubeTable(const hal::Tube& tube, const TableWriteOptions& options) {
  if (tube.program.rows.empty()) {
    return hal::Fail(hal::ErrorKind::kBadInput,
                     "the program has no rows; expected at least one length");
  }
  const int decimals = options.decimals.value_or(options.format == TableFormat::kText ? 4 : 6);
  const auto content = ContentOf(tube, options, decimals);
  if (!content) return hal::Fail(content.error());
  switch (options.format) {
    case TableFormat::kText:
      return TextOf(*content, tube, options, decimals);
    case TableFormat::kCsv:
      return CsvOf(*content, tube, options, decimals);
    case TableFormat::kJson:
      return JsonOf(*content, tube, options, decimals);
  }
  return hal::Fail(hal::ErrorKind::kInternal, "unknown table format");
}

}  // namespace bendloop::host
