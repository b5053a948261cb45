// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/convert/tube_table.h"

#include <utility>

#include "firmware-host/convert/table_rows.h"

namespace bendloop::host {
namespace {

using hal::ErrorKind;

tl::unexpected<hal::Error> Named(std::string_view name, const hal::Error& error) {
  return hal::Fail(error.kind, std::string(name) + ": " + error.message);
}

hal::Result<hal::Tube> TubeFromPoints(const RawTable& table) {
  pipeline::ControlPolygon polygon;
  for (std::size_t i = 0; i < table.rows.size(); ++i) {
    const TableRow& row = table.rows[i];
    polygon.points_mm.emplace_back(row.values[0], row.values[1], row.values[2]);
    if (i > 0 && i + 1 < table.rows.size()) polygon.bend_radii_mm.push_back(row.bend_radius_mm);
  }
  return pipeline::TubeFromPolygon(polygon);
}

hal::Result<hal::BendProgram> ProgramFromRows(const RawTable& table) {
  if (table.kind == TableKind::kYbc) {
    std::vector<pipeline::YbcRow> rows;
    for (const TableRow& row : table.rows) {
      rows.push_back({row.values[0], row.values[1], row.values[2], row.bend_radius_mm});
    }
    return pipeline::ProgramFromYbc(rows, table.style);
  }
  hal::BendProgram program;
  for (const TableRow& row : table.rows) {
    program.rows.push_back(
        {row.values[0], hal::WrapRotationDeg(row.values[1]), row.values[2], row.bend_radius_mm});
  }
  return program;
}

}  // namespace

std::string_view Name(TableKind kind) {
  switch (kind) {
    case TableKind::kXyz:
      return "xyz";
    case TableKind::kLra:
      return "lra";
    case TableKind::kYbc:
      return "ybc";
    case TableKind::kPose:
      return "pose";
  }
  return "unknown";
}

hal::Result<TubeTable> ReadTubeTable(std::string_view text, std::string_view name,
                                     const TableReadOptions& options) {
  if (text.size() > kMaxTableBytes) {
    return hal::Fail(ErrorKind::kBadInput, std::string(name) + ": more than " +
                                               std::to_string(kMaxTableBytes) +
                                               " bytes, expected a table of one tube");
  }
  if (text.starts_with("\xef\xbb\xbf")) text.remove_prefix(3);  // UTF-8 byte order mark
  const std::size_t first = text.find_first_not_of(" \t\r\n");
  if (first == std::string_view::npos) {
    return hal::Fail(ErrorKind::kBadInput,
                     std::string(name) + ": is empty, expected a table of XYZ, LRA, YBC or pose");
  }
  const bool json = text[first] == '{' || text[first] == '[';
  auto raw = json ? ReadJsonTableRows(text, name, options) : ReadTextTableRows(text, name, options);
  if (!raw) return hal::Fail(raw.error());

  TubeTable table;
  table.kind = raw->kind;
  if (!raw->note.empty()) table.notes.push_back(raw->note);
  const bool points = raw->kind == TableKind::kXyz;
  for (std::size_t i = 0; i < raw->rows.size(); ++i) {
    TableRow& row = raw->rows[i];
    const bool bend = i + 1 < raw->rows.size() && (!points || i > 0);
    if (row.bend_radius_mm == 0.0 || !bend) {
      row.bend_radius_mm.reset();  // 0 is how tables write "none"
    }
    const bool sharp = options.bend_radius_mm == 0.0;
    if (!bend || row.bend_radius_mm || sharp) continue;
    row.bend_radius_mm = options.bend_radius_mm;
    if (!row.bend_radius_mm && (points || row.values[2] != 0)) table.radii_known = false;
  }
  if (points) {
    auto tube = TubeFromPoints(*raw);
    if (!tube) return Named(name, tube.error());
    table.tube = std::move(*tube);
    for (std::size_t i = 0; i + 1 < table.tube.program.rows.size(); ++i) {
      if (table.tube.program.rows[i].angle_deg != 0) continue;
      table.notes.push_back("point " + std::to_string(i + 2) + " lies on a straight: row " +
                            std::to_string(i + 1) +
                            " has angle 0; remove the point if nothing is bent there");
    }
    return table;
  }
  auto program = ProgramFromRows(*raw);
  if (!program) return Named(name, program.error());
  if (const auto ok = pipeline::CheckProgram(*program); !ok) return Named(name, ok.error());
  table.tube = {raw->pipe_radius_mm, std::move(*program), {}};
  if (raw->kind == TableKind::kPose) table.tube.X_WT = raw->X_WT;
  return table;
}

}  // namespace bendloop::host
